"""`deggflow reproduce`: measures what is missing, then writes the report anew."""

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
    """Measure every table and figure of the paper and put them into one report beside the paper's.

    Results are kept as they come; rerun the command to resume. Exit code 0: everything asked for
    was measured; 3: it was, and a guided result that should be satisfied is not (the report says which); 2: bad input.

    Args:
        out: Folder that receives report.html, figures (PNG, PDF), tables (CSV, JSON) and results (JSON).
        quick: Few cases of everything, to see that it works.
        retrain: Train all three seeds of both tasks again for the training curves; takes hours without --quick.
        seed: Seed of cases and of z(0).
        only: Measure these experiments alone; others are shown if their results are there.
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
    chosen = _chosen(entries(sources), only)
    if retrain and TrainingCurves.name not in chosen:
        raise InputError(f"--retrain is for {TrainingCurves.name}, which --only leaves out")
    with _watch(len(chosen)) as watch:
        if retrain:
            sources = _trained(out, quick, watch)
        todo = entries(sources)
        found = results(out, todo, settings, chosen, watch)
    parts = write_report(out, todo, found, settings)
    return _told(out, parts)


def _chosen(entries: "Sequence[Entry]", only: Sequence[str]) -> list[str]:
    names = [entry.experiment.name for entry in entries]
    for name in only:
        if name not in names:
            raise InputError(f"--only: there is no experiment {name}; known are {', '.join(names)}")
    return [name for name in names if not only or name in only]


def _trained(out: Path, quick: bool, watch: "Watch") -> "Sources":
    from .curves import TASKS
    from .registry import weights
    from .retrain import retrain

    folder = out / ("retrain-quick" if quick else "retrain")
    watch.begins("training")
    return retrain({task: weights(task) for task in TASKS}, folder, quick=quick, say=watch.says)


@contextmanager
def _watch(count: int) -> "Iterator[Watch]":
    """Bars where somebody watches, else a line for each thing that is begun."""
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
            took = "there already" if fresh is None else f"measured in {duration(fresh.seconds)}"
            bars.console.print(f"{name}: {took}", highlight=False)
            bars.advance(bar)

        yield Watch(begins, lambda text: tell(f"{current[0]}: {text}"), ends)


def write_report(
    out: Path, entries: "Sequence[Entry]", found: "dict[str, Stored]", settings: "Settings"
) -> "list[Part]":
    """Presents every result, writes tables, figures and report.html."""
    from deggflow.files import write_atomically

    from .artefacts import check_names, write
    from .page import Part, page
    from .run import code_digest

    shown = [entry.experiment for entry in entries if entry.experiment.name in found]
    missing = [e.experiment.name for e in entries if e.experiment.name not in found]
    sections = [each.present(found[each.name].result, settings) for each in shown]
    check_names(sections)
    parts = [
        Part(each.name, section, found[each.name], write(section, out))
        for each, section in zip(shown, sections, strict=True)
    ]
    write_atomically(out / "report.html", page(parts, missing, settings, code_digest()))
    return parts


def _told(out: Path, parts: "Sequence[Part]") -> int:
    unmet = [text for part in parts for text in part.stored.unmet]
    for text in unmet:
        console().print(f"not as it should be: {text}")
    output().print(f"The report of {len(parts)} experiments is {out / 'report.html'}.")
    return NOT_SATISFIED if unmet else SATISFIED
