"""What runs share: which conditions are wanted, results and rows that survive a kill, training shown."""

import json
import sys
from collections import deque
from collections.abc import Callable, Iterator, Mapping, Sequence
from concurrent.futures import ThreadPoolExecutor
from contextlib import contextmanager
from dataclasses import dataclass
from hashlib import sha256
from pathlib import Path
from typing import TYPE_CHECKING, Any, Generic, TypeVar

from deggflow.jsonl import InputError
from deggflow.output import ADVICE, ResumableOutput
from deggflow.schema import parse_as
from deggflow.task import (
    AbstractGenerator,
    AbstractTask,
    GenerateOptions,
    RunSettings,
    check_range,
)
from deggflow.task.interface import Result, Written
from deggflow.task.options import MAX_COUNT

from .session import progress

if TYPE_CHECKING:
    from rich.progress import Progress

    from deggflow.train import Curve

R = TypeVar("R", bound=Result)
Row = TypeVar("Row", bound=Written)
C = TypeVar("C", bound=Written)


def printable(text: str) -> str:
    """Text of a file without anything that could move the cursor or can't be printed; lines stay."""
    return "\n".join(
        "".join(c if c.isprintable() else c.encode("unicode_escape").decode() for c in line)
        for line in text.split("\n")
    )


def digest_of_weights(path: Path | None) -> str | None:
    """What tells one weights file from another, its card included: content, whatever the file is called."""
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


def check_output(out: Path | None, settings: Mapping[str, Any]) -> None:
    """Refuses a file of another run before anything is computed; it is looked at again once it is locked."""
    if out is not None:
        ResumableOutput(out, settings)


@dataclass(frozen=True)
class ConditionSource(Generic[C]):
    """Conditions of a run by number, from a file or drawn."""

    count: int
    size: int  # of drawn conditions; 0 if a file gives them
    part: Callable[[int, int], list[C]]  # number of the first, how many
    digest: str | None = None  # of a file's conditions as they were read; None if they are drawn

    def belongs(self, number: int, row: Any) -> bool:
        """Whether a line holds the result for the condition of its number."""
        (condition,) = self.part(number, 1)
        return bool(row.get("condition") == json.loads(json.dumps(condition.to_json())))


def generated(
    generator: AbstractGenerator[C, R],
    asked: ConditionSource[C],
    options: GenerateOptions,
    first: int,
    bars: "Progress",
) -> Iterator[list[R]]:
    """Results from number `first` on, some at a time, as soon as they are finished.

    A chunk that a kill cut in two is generated again whole, as another batch rounds differently; what is written of it
    already is passed over.
    """
    chunking = generator.chunking(*asked.part(0, 1))
    bar = None

    def tell(status: str) -> None:
        nonlocal bar
        bar = bars.add_task("", total=None) if bar is None else bar
        bars.update(bar, description=status)

    def results(start: int) -> Iterator[list[R]]:
        number = start
        conditions = asked.part(start, min(chunking.size, asked.count - start))
        run = RunSettings(options.seed, start, options.max_draws if options.guided else 1)
        for some in generator.generate(conditions, run, tell):
            yield some[max(0, first - number) :]
            number += len(some)

    starts = range(first // chunking.size * chunking.size, asked.count, chunking.size)
    if chunking.concurrent and len(starts) > 1:
        yield from _ahead(lambda start: list(results(start)), starts)
    else:
        for start in starts:
            yield from results(start)


def _ahead(results: Callable[[int], list[list[R]]], starts: Sequence[int]) -> Iterator[list[R]]:
    """Results of every start in order; two more are begun while those of one are judged and written."""
    yield from results(starts[0])  # compiles for the others
    pool = ThreadPoolExecutor(2)
    try:
        coming = deque(pool.submit(results, start) for start in starts[1:3])
        for start in starts[3:]:
            yield from coming.popleft().result()
            coming.append(pool.submit(results, start))
        while coming:
            yield from coming.popleft().result()
    finally:
        pool.shutdown(cancel_futures=True)


def wanted(task: AbstractTask[C, R], options: GenerateOptions) -> ConditionSource[C]:
    """What --conditions, or --size and --count, ask for.

    Raises:
        InputError: The arguments do not go together, or the file is bad.
    """
    if (options.conditions is None) == (options.size is None):
        raise InputError("give either --conditions FILE or --size N (with --count M)")
    if options.conditions is not None:
        if options.count is not None:
            raise InputError("--count goes with --size, not with --conditions")
        conditions = task.read_conditions(options.conditions)
        # Of what was read, not of the file: a pipe can be read only once.
        content = json.dumps([condition.to_json() for condition in conditions]).encode()
        return ConditionSource(
            len(conditions),
            0,
            lambda first, many: conditions[first : first + many],
            sha256(content).hexdigest(),
        )
    size, count = options.size or 0, 1 if options.count is None else options.count
    check_range("size", size, *task.sizes)
    check_range("count", count, 1, MAX_COUNT)
    return ConditionSource(
        count, size, lambda first, many: task.random_conditions(size, many, first, options)
    )


def write_results(
    out: Path | None,
    settings: Mapping[str, Any],
    asked: ConditionSource[Any],
    label: str,
    fails: Callable[[Mapping[str, Any]], bool],
    chunks: "Callable[[int, Progress], Iterator[list[R]]]",
) -> int:
    """Results to stdout, or to the end of a file that may hold some already; returns how many fail.

    Args:
        out: The file, or None for stdout.
        settings: JSON values that tell this run from others.
        asked: What results are of.
        label: What they are called beside the progress bar.
        fails: Whether a result, as it stands in the file, does not do what it should.
        chunks: Results from a number on, a few at a time; may show more progress.
    """
    failed = 0

    def look(row: Mapping[str, Any]) -> None:
        nonlocal failed
        try:
            failed += fails(row)
        except (KeyError, TypeError):
            raise InputError("a finished line is no result of this command", file=out) from None

    with progress(hidden=out is None) as bars:
        bar = bars.add_task(label, total=asked.count)
        if out is None:
            return sum(_print(found, fails) for found in chunks(0, bars))
        target = ResumableOutput(
            out, settings, count=asked.count, belongs=asked.belongs, on_row=look
        )
        with target as lines:
            bars.update(bar, completed=lines.done)
            for results in chunks(lines.done, bars):
                found = [result.to_json() for result in results]
                lines.append(found)
                failed += sum(map(fails, found))
                bars.advance(bar, len(found))
    return failed


def _print(results: Sequence[Written], fails: Callable[[Mapping[str, Any]], bool]) -> int:
    failed = 0
    for result in results:
        found = result.to_json()
        print(json.dumps(found, allow_nan=False), flush=True)
        failed += fails(found)
    return failed


def run_jobs(
    jobs: Sequence[Callable[[], Row]],
    kind: type[Row],
    settings: Mapping[str, Any],
    out: Path | None,
) -> list[Row]:
    """Runs the jobs that are not done yet; each row is written to `out` as soon as it is known.

    Args:
        jobs: What makes each row.
        kind: A dataclass, which the rows are of.
        settings: JSON values that tell this run from others.
        out: The file, or None.
    """
    with progress() as bars:
        bar = bars.add_task("evaluating", total=len(jobs))
        if out is None:
            found = []
            for job in jobs:
                found.append(job())
                bars.advance(bar)
            return found
        return resumed_rows(
            jobs, kind, settings, out, lambda done: bars.update(bar, completed=done)
        )


def resumed_rows(
    jobs: Sequence[Callable[[], Row]],
    kind: type[Row],
    settings: Mapping[str, Any],
    out: Path,
    on_progress: Callable[[int], None] = lambda done: None,
) -> list[Row]:
    """Rows of `out`, and behind them those of the jobs that it does not hold yet; arguments as of `run_jobs`."""
    with ResumableOutput(out, settings, count=len(jobs)) as lines:
        found = []
        for number, row in enumerate(lines.finished, start=1):
            try:
                found.append(parse_as(kind, row))
            except InputError as error:
                raise InputError(
                    f"was damaged after it was written: {error.reason}; {ADVICE}",
                    file=out, line=number, field=error.field,
                ) from None  # fmt: skip
        on_progress(len(found))
        for job in jobs[len(found) :]:
            found.append(job())
            lines.append([found[-1].to_json()])
            on_progress(len(found))
        return found


@contextmanager
def shown_training(steps: int, out: Path) -> "Iterator[Callable[[Curve], None]]":
    """Shows the points of the curves as they come; at the end the curves are drawn into `out`."""
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
