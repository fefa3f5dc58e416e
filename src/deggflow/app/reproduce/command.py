"""`deggflow reproduce`: measures what is missing, then rewrites the report."""

import sys
from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from pathlib import Path
from typing import TYPE_CHECKING

from deggflow.app.session import NOT_SATISFIED, SATISFIED, console, output, prepare_jax, progress
from deggflow.jsonl import InputError
from deggflow.task import check_range
from deggflow.task.options import MAX_SEED

if TYPE_CHECKING:
    from .curves import Sources
    from .experiment import Settings
    from .page import Part
    from .run import Entry, Stored, Watch


def reproduce(
    out: Path = Path("reproduction"),
    quick: bool = False,
    retrain: bool = False,
    seed: int = 1,
    only: tuple[str, ...] = (),
) -> int:
    """Measure every table and figure of the paper and compare them with the paper's in one report.

    Each result is kept as soon as it is measured; rerun the command to resume. Exit code 0: all selected experiments
    were measured; 3: they were measured, but a guided result or a claim failed (the report lists them);
    2: bad input.

    Args:
        out: Folder that receives report.html, figures (PNG, PDF), tables (CSV, JSON) and results (JSON).
        quick: A short run with few cases, to check that everything works.
        retrain: Train all three seeds of both tasks again for the training curves. Takes hours without --quick.
        seed: Seed of cases and of z(0).
        only: Measure only these experiments; others are shown if their results exist.
    """
    check_range("seed", seed, 0, MAX_SEED)
    if out.exists() and not out.is_dir():
        raise InputError("is not a folder; --out names a folder", file=out)
    prepare_jax()
    from .curves import TrainingCurves, shipped_curves
    from .experiment import Settings
    from .registry import entries
    from .run import results

    settings, sources = Settings(seed, quick, out / "results"), shipped_curves()
    selection = _selection(entries(sources), only)
    if retrain and TrainingCurves.name not in selection:
        raise InputError(f"--retrain is for {TrainingCurves.name}, which --only leaves out")
    with _watch(len(selection)) as watch:
        if retrain:
            sources = _retrain(out, quick, watch)
        todo = entries(sources)
        stored = results(out, todo, settings, selection, watch)
    parts = write_report(out, todo, stored, settings)
    return _report_outcome(out, parts)


def _selection(entries: "Sequence[Entry]", only: Sequence[str]) -> list[str]:
    names = [entry.experiment.name for entry in entries]
    for name in only:
        if name not in names:
            raise InputError(f"--only: there is no experiment {name}; known are {', '.join(names)}")
    return [name for name in names if not only or name in only]


def _retrain(out: Path, quick: bool, watch: "Watch") -> "Sources":
    from .curves import TASKS
    from .registry import weights
    from .retrain import retrain

    folder = out / ("retrain-quick" if quick else "retrain")
    watch.begins("training")
    return retrain({task: weights(task) for task in TASKS}, folder, quick=quick, say=watch.says)


@contextmanager
def _watch(count: int) -> "Iterator[Watch]":
    """Progress bars on a terminal; elsewhere a line for each new activity."""
    from .page import duration
    from .run import Watch

    with progress() as bars:
        bar = bars.add_task("experiments", total=count)
        current = [""]

        def tell(text: str) -> None:
            if bars.disable:
                print(text, file=sys.stderr, flush=True)
            else:
                bars.update(bar, description=text)

        def begins(name: str) -> None:
            current[0] = name

        def ends(name: str, fresh: "Stored | None") -> None:
            took = (
                "kept from an earlier run"
                if fresh is None
                else f"measured in {duration(fresh.seconds)}"
            )
            bars.console.print(f"{name}: {took}", highlight=False)
            bars.advance(bar)

        yield Watch(begins, lambda text: tell(f"{current[0]}: {text}"), ends)


def write_report(
    out: Path, entries: "Sequence[Entry]", stored: "dict[str, Stored]", settings: "Settings"
) -> "list[Part]":
    """Writes the tables, the figures and report.html of all results."""
    from deggflow.files import write_atomically

    from .artefacts import check_names, write
    from .page import Part, page
    from .run import code_digest

    experiments = [entry.experiment for entry in entries if entry.experiment.name in stored]
    missing = [e.experiment.name for e in entries if e.experiment.name not in stored]
    sections = [each.present(stored[each.name].result, settings) for each in experiments]
    check_names(sections)
    parts = [
        Part(each.name, section, stored[each.name], write(section, out))
        for each, section in zip(experiments, sections, strict=True)
    ]
    write_atomically(out / "report.html", page(parts, missing, settings, code_digest()))
    return parts


def _report_outcome(out: Path, parts: "Sequence[Part]") -> int:
    unmet = [text for part in parts for text in part.stored.unmet]
    for text in unmet:
        console().print(f"not as expected: {text}")
    output().print(f"The report of {len(parts)} experiments is {out / 'report.html'}.")
    return NOT_SATISFIED if unmet else SATISFIED
