"""Shared by the commands: sources of conditions, results and rows that survive a kill, progress of training."""

import json
import sys
import time
from collections import deque
from collections.abc import Callable, Iterator, Mapping, Sequence
from concurrent.futures import ThreadPoolExecutor
from contextlib import contextmanager
from dataclasses import dataclass, replace
from hashlib import sha256
from pathlib import Path
from typing import TYPE_CHECKING, Any, Generic, NamedTuple, TypeVar

from deggflow import __version__
from deggflow.jsonl import InputError
from deggflow.output import ADVICE, ResumableOutput
from deggflow.schema import parse_as
from deggflow.shards import Part, Shard
from deggflow.task import (
    AbstractGenerator,
    AbstractModel,
    AbstractTask,
    Chunking,
    GenerateOptions,
    RunSettings,
    check_range,
)
from deggflow.task.formats import Result, Written
from deggflow.task.options import MAX_RESULTS

from .session import progress

if TYPE_CHECKING:
    from rich.progress import Progress

    from deggflow.train import Curve

R = TypeVar("R", bound=Result)
Row = TypeVar("Row", bound=Written)
C = TypeVar("C", bound=Written)


def printable(text: str) -> str:
    """Text of a file with unprintable characters escaped, except line breaks: nothing can move the cursor."""
    return "\n".join(
        "".join(c if c.isprintable() else c.encode("unicode_escape").decode() for c in line)
        for line in text.split("\n")
    )


def digest_of_weights(path: Path | None) -> str | None:
    """Digest of the content of a weights file and its card, regardless of the file's name."""
    if path is None:
        return None
    from deggflow.weights import card_path

    card = card_path(path)
    try:
        return sha256(path.read_bytes() + b"\0" + card.read_bytes()).hexdigest()
    except OSError as error:
        raise InputError(
            f"--weights can't be used: {error.strerror}", file=error.filename
        ) from None


def provenance(model: AbstractModel, weights: Path | None) -> dict[str, Any]:
    """What a run is made with besides its settings: version of the package, and digest of the weights, shipped or not."""
    used = model.shipped if weights is None else weights
    return {"deggflow": __version__, "weights": digest_of_weights(used)}


def check_output(out: Path | None, settings: Mapping[str, Any]) -> None:
    """Refuses a file of another run before anything is computed; the file is checked again once it is locked."""
    if out is not None:
        ResumableOutput(out, settings)


class FinishedLines(NamedTuple):
    """Results as they stand in a file.

    Attributes:
        lines: Their JSON objects as text.
        failed: Whether each failed.
    """

    lines: Sequence[str]
    failed: Sequence[bool]


@dataclass(frozen=True)
class ConditionSource(Generic[C]):
    """Conditions of a run by number, from a file or drawn; or those of one shard, numbered from its first one.

    Attributes:
        count: Number of conditions.
        size: Number of agents of drawn conditions; 0 if the conditions come from a file.
        part: Maps (number of the first condition, how many) to the conditions.
        digest: Digest of a file's conditions as they were read; None if they are drawn.
        first: Number in the run of a shard's first condition.
    """

    count: int
    size: int
    part: Callable[[int, int], list[C]]
    digest: str | None = None
    first: int = 0

    def of_part(self, part: Part) -> "ConditionSource[C]":
        """The conditions of a part of the run."""
        return replace(
            self,
            count=part.lines,
            part=lambda first, many: self.part(part.first + first, many),
            first=part.first,
        )

    def belongs(self, number: int, row: Any) -> bool:
        """Whether a line holds the result for the condition of its number."""
        (condition,) = self.part(number, 1)
        return bool(row.get("condition") == json.loads(json.dumps(condition.to_json())))


def generate_results(
    generator: AbstractGenerator[C, R],
    source: ConditionSource[C],
    options: GenerateOptions,
    first: int,
    bars: "Progress",
    chunking: Chunking | None = None,
) -> Iterator[list[R]]:
    """Yields results from number `first` on, some at a time, as soon as they are finished.

    A chunk that a kill cut in two is generated again as a whole, since a batch of another size rounds differently.
    Its results that are already written are skipped. `chunking` is that of the whole run, if the source is a shard's.
    """
    if source.count == 0:
        return
    if chunking is None:
        chunking = generator.chunking(*source.part(0, 1))
    bar = None

    def tell(status: str) -> None:
        nonlocal bar
        bar = bars.add_task("", total=None) if bar is None else bar
        bars.update(bar, description=status)

    def results(start: int) -> Iterator[list[R]]:
        number = start
        conditions = source.part(start, min(chunking.size, source.count - start))
        number_in_run = source.first + start
        run = RunSettings(options.seed, number_in_run, options.max_draws if options.guided else 1)
        for some in generator.generate(conditions, run, tell):
            yield some[max(0, first - number) :]
            number += len(some)

    starts = range(first // chunking.size * chunking.size, source.count, chunking.size)
    if chunking.concurrent and len(starts) > 1:
        yield from _ahead(lambda start: list(results(start)), starts)
    else:
        for start in starts:
            yield from results(start)


def _ahead(results: Callable[[int], list[list[R]]], starts: Sequence[int]) -> Iterator[list[R]]:
    """Results of every start in order; two more chunks are computed while one is judged and written."""
    yield from results(starts[0])  # compiles the programs for the other chunks
    pool = ThreadPoolExecutor(2)
    try:
        futures = deque(pool.submit(results, start) for start in starts[1:3])
        for start in starts[3:]:
            yield from futures.popleft().result()
            futures.append(pool.submit(results, start))
        while futures:
            yield from futures.popleft().result()
    finally:
        pool.shutdown(cancel_futures=True)


def condition_source(task: AbstractTask[C, R], options: GenerateOptions) -> ConditionSource[C]:
    """The conditions that the options --conditions, or --size and --count, select.

    Raises:
        InputError: The options exclude each other, or the file is invalid.
    """
    if (options.conditions is None) == (options.size is None):
        raise InputError("give either --conditions FILE or --size N (with --count M)")
    if options.conditions is not None:
        if options.count is not None:
            raise InputError("--count goes with --size, not with --conditions")
        conditions = task.read_conditions(options.conditions)
        # Digest of the conditions, not of the file: a pipe can be read only once.
        content = json.dumps([condition.to_json() for condition in conditions]).encode()
        return ConditionSource(
            len(conditions),
            0,
            lambda first, many: conditions[first : first + many],
            sha256(content).hexdigest(),
        )
    size, count = options.size or 0, 1 if options.count is None else options.count
    check_range("size", size, *task.sizes)
    check_range("count", count, 1, MAX_RESULTS)
    return ConditionSource(
        count, size, lambda first, many: task.random_conditions(size, many, first, options)
    )


def write_results(
    out: Path | None,
    settings: Mapping[str, Any],
    source: ConditionSource[Any],
    label: str,
    fails: Callable[[Mapping[str, Any]], bool],
    chunks: "Callable[[int, Progress], Iterator[Sequence[R] | FinishedLines]]",
) -> int:
    """Writes results to stdout or appends them to a file; returns the number of failed ones.

    Args:
        out: The file, which may hold some results already, or None for stdout.
        settings: JSON values that distinguish this run from others.
        source: Conditions of the results.
        label: Text beside the progress bar.
        fails: Whether a result, as a JSON object, fails.
        chunks: Maps the number of the first result to results, a few at a time, as objects or as text; may add progress bars.
    """
    failed = 0

    def count_failure(row: Mapping[str, Any]) -> None:
        nonlocal failed
        try:
            failed += fails(row)
        except (KeyError, TypeError):
            raise InputError("a finished line is no result of this command", file=out) from None

    with progress(hidden=out is None) as bars:
        bar = bars.add_task(label, total=source.count)
        if out is None:
            for results in chunks(0, bars):
                some = finished_lines(results, fails)
                for line in some.lines:
                    print(line, flush=True)
                failed += sum(some.failed)
            return failed
        target = ResumableOutput(
            out, settings, count=source.count, belongs=source.belongs, on_row=count_failure
        )
        with target as lines:
            bars.update(bar, completed=lines.done)
            for results in chunks(lines.done, bars):
                some = finished_lines(results, fails)
                lines.append_lines(some.lines)
                failed += sum(some.failed)
                bars.advance(bar, len(some.lines))
    return failed


def finished_lines(
    results: Sequence[Written] | FinishedLines, fails: Callable[[Mapping[str, Any]], bool]
) -> FinishedLines:
    """Results as text, unless they are text already."""
    if isinstance(results, FinishedLines):
        return results
    rows = [result.to_json() for result in results]
    return FinishedLines([json.dumps(row, allow_nan=False) for row in rows], [*map(fails, rows)])


def run_jobs(
    jobs: Sequence[Callable[[], Row]],
    kind: type[Row],
    settings: Mapping[str, Any],
    out: Path | None,
    shard: Shard | None = None,
) -> list[Row]:
    """Runs the jobs whose rows `out` does not hold yet; each row is written as soon as it is measured.

    Args:
        jobs: One function per row, which measures it.
        kind: Dataclass of the rows.
        settings: JSON values that distinguish this run from others.
        out: The file, or None.
        shard: Runs only its jobs, and returns their rows; None: all.
    """
    if shard is not None:
        part = shard.equal_part(len(jobs), 1)
        jobs = jobs[part.first : part.first + part.lines]
        settings = {**settings, **shard.settings(part)}
    with progress() as bars:
        bar, start = bars.add_task("evaluating", total=len(jobs)), time.monotonic()

        def show(count: int) -> None:
            bars.update(bar, completed=count)
            if bars.disable:
                elapsed = f"{time.monotonic() - start:.0f} s"
                text = f"evaluated {count} of {len(jobs)} rows in {elapsed}"
                print(text, file=sys.stderr, flush=True)

        if out is not None:
            return resumed_rows(jobs, kind, settings, out, show)
        rows = []
        for job in jobs:
            rows.append(job())
            show(len(rows))
        return rows


def resumed_rows(
    jobs: Sequence[Callable[[], Row]],
    kind: type[Row],
    settings: Mapping[str, Any],
    out: Path,
    on_progress: Callable[[int], None] = lambda count: None,
) -> list[Row]:
    """The rows of `out`, followed by those of the remaining jobs. Args: as for `run_jobs`."""
    with ResumableOutput(out, settings, count=len(jobs)) as lines:
        rows = []
        for number, row in enumerate(lines.finished, start=1):
            try:
                rows.append(parse_as(kind, row))
            except InputError as error:
                raise InputError(
                    f"was damaged after it was written: {error.reason}; {ADVICE}",
                    file=out, line=number, field=error.field,
                ) from None  # fmt: skip
        on_progress(len(rows))
        for job in jobs[len(rows) :]:
            rows.append(job())
            lines.append([rows[-1].to_json()])
            on_progress(len(rows))
        return rows


@contextmanager
def training_progress(
    steps: int, out: Path, *, hidden: bool = False
) -> "Iterator[Callable[[Curve], None]]":
    """Shows the losses during training; plots the curves into `out` at the end; neither if hidden."""
    if hidden:
        yield lambda curve: None
        return
    with progress() as bars:
        bar = bars.add_task("training", total=steps)

        def show(curve: "Curve") -> None:
            loss = f"loss {curve.training:.4f}, validation {curve.validation:.4f}"
            bars.update(bar, completed=curve.step, description=f"training ({loss})")
            if bars.disable:
                print(f"step {curve.step}: {loss}", file=sys.stderr, flush=True)

        yield show
    from deggflow.view.curves import draw_curves

    draw_curves(out / "curves.csv", out / "curves.png")
