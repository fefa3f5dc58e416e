"""Tables of `deggflow bridge evaluate`."""

from collections.abc import Callable, Iterable
from pathlib import Path
from typing import Any

from rich.table import Table

from deggflow.tasks.bridge.evaluate import (
    SOURCES,
    Evaluation,
    Modes,
    Passes,
    count_modes,
    evaluate,
    passes,
)
from deggflow.tasks.bridge.field import BridgeField
from deggflow.tasks.bridge.hard import HardPolicies, blocked_texts, evaluate_hard
from deggflow.view.bridge import PathGroup, draw_paths

from .runs import run_jobs
from .session import NOT_SATISFIED, SATISFIED, output

_FAILURES = {
    "plank_leaves": "plank leaves",
    "support_lost": "plank loses support",
    "robot_leaves": "robot leaves",
    "robot_in_gap": "robot in the gap",
    "time_out": "time ran out",
    "other": "other",
}
_COLOURS = dict(zip(SOURCES, ("#4d4d4d", "#D55E00", "#0072B2"), strict=True))


def _print_table(title: str, headings: Iterable[str], rows: Iterable[Iterable[object]]) -> None:
    table = Table(title=title, title_justify="left")
    for heading in headings:
        table.add_column(heading, no_wrap=True)
    for row in rows:
        table.add_row(*map(str, row))
    output().print(table)


def run_evaluation(field: BridgeField, settings: dict[str, Any], out: Path | None) -> int:
    """Nominal beside guided for each size; exit code 3 if a guided trial fails or an outcome is refuted."""
    trials, seed, max_draws = settings["trials"], settings["seed"], settings["max_draws"]

    def job(size: int) -> Callable[[], Evaluation]:
        return lambda: evaluate(field, size, trials, seed, max_draws)

    rows = run_jobs([job(size) for size in settings["sizes"]], Evaluation, settings, out)
    _print_success(rows, f"{trials} trials a row, seed {seed}, 95% Wilson intervals")
    _print_policies(rows, max_draws)
    for heading, texts in (
        ("Guided trials that do not bridge the gap:", [t for row in rows for t in row.blocked]),
        ("Outcomes that the replay refutes:", [t for row in rows for t in row.refuted]),
    ):
        if texts:
            output().print("\n".join([heading, *(f"- {text}" for text in texts)]), markup=False)
    complete = all(row.guided == row.trials and not row.refuted for row in rows)
    return SATISFIED if complete else NOT_SATISFIED


def run_hard(field: BridgeField, settings: dict[str, Any], out: Path | None) -> int:
    """Policies from hard states; exit code 3 if an accepted one misses a bound or is refuted."""
    each, seed, max_draws = settings["hard"], settings["seed"], settings["max_draws"]

    def job(size: int) -> Callable[[], HardPolicies]:
        return lambda: evaluate_hard(field, size, each, seed, max_draws)

    rows = run_jobs([job(size) for size in settings["sizes"]], HardPolicies, settings, out)
    headings = [
        "N",
        "first draw met",
        f"accepted, <= {max_draws} draws",
        "above a bound",
        "refuted",
        "conditions held",
        "forced",
        "largest miss refused",
    ]
    _print_table(
        f"Bridge: guided policies from hard states, {each} a row, seed {seed}, 95% Wilson intervals",
        headings,
        (
            (
                row.size,
                row.rate(row.met_at_once),
                row.rate(row.accepted),
                row.missed,
                row.refuted,
                row.rate(row.held),
                row.forced,
                f"{row.excess:.3g}",
            )
            for row in rows
        ),
    )
    output().print(
        "Hard: within 0.1 m, either way, of the factors' buffers to a wall, to the gap or to lost support; three of four "
        "on the move. above a bound: accepted, and q_task or q_safe ends above it in float64; refuted: accepted, and "
        "Shapely finds something broken on the way; conditions held: accepted, and so at every point of the generation; "
        "forced: accepted, with a step taken above a limit on the way; largest miss refused: of a factor over its bound."
    )
    texts = blocked_texts(rows)
    if texts:
        output().print("\n".join(["No draw accepted, the team stops:", *texts]), markup=False)
    return NOT_SATISFIED if any(row.missed or row.refuted for row in rows) else SATISFIED


def _print_success(rows: list[Evaluation], counted: str) -> None:
    headings = ("N", "nominal", "guided", "blocked", "least margin", "refuted")
    _print_table(
        f"Bridge: success, {counted}",
        headings,
        (
            (
                row.size,
                row.rate(row.nominal),
                row.rate(row.guided),
                len(row.blocked),
                f"{1000 * row.least_margin:.0f} mm",
                len(row.refuted),
            )
            for row in rows
        ),
    )
    output().print(
        "The same starts and z(0) in both columns. blocked: guided trials that do not bridge the gap; least "
        "margin: of everything guided trials executed, to any failure; refuted: outcomes, nominal or guided, that "
        "a replay by Shapely found false."
    )
    _print_table(
        "Bridge: how nominal trials fail",
        ("N", "failed", *_FAILURES.values()),
        (
            (row.size, row.trials - row.nominal, *(row.failures[kind] for kind in _FAILURES))
            for row in rows
        ),
    )


def _print_policies(rows: list[Evaluation], max_draws: int) -> None:
    nominal = [row.policies["nominal"] for row in rows]
    guided = [row.policies["guided"] for row in rows]
    _print_table(
        "Bridge: policies that end with q_task and q_safe below their bounds",
        (
            "N",
            "nominal policies",
            "both met",
            "guided policies",
            "both met, first draw",
            f"both met, <= {max_draws} draws",
            "most draws",
        ),
        (
            (
                row.size,
                before.generated,
                before.rate(before.met) if before.generated else "-",
                after.generated,
                after.rate(after.met_at_once) if after.generated else "-",
                after.rate(after.met) if after.generated else "-",
                after.most_draws,
            )
            for row, before, after in zip(rows, nominal, guided, strict=True)
        ),
    )


def run_modes(
    field: BridgeField, settings: dict[str, Any], out: Path | None, figure: Path | None
) -> int:
    """On which side planks pass from one symmetric start: demonstrations, nominal, guided."""
    count, seed = settings["modes"], settings["seed"]
    known: dict[str, list[Passes]] = {}

    def ways(source: str) -> list[Passes]:
        if source not in known:
            known[source] = passes(field, source, count, seed, settings["max_draws"])
        return known[source]

    def job(source: str) -> Callable[[], Modes]:
        return lambda: count_modes(source, ways(source))

    rows = run_jobs([job(source) for source in SOURCES], Modes, settings, out)
    _print_table(
        f"Bridge: sides, {count} from one symmetric start, seed {seed}, 95% Wilson intervals",
        ("", "bridged", "left", "right", "farthest from the middle: 5%", "median", "95%"),
        (
            (
                row.source,
                row.rate(row.bridged),
                row.rate(row.left),
                row.rate(row.trials - row.left),
                *(f"{value:.2f} m" for value in (row.low, row.median, row.high)),
            )
            for row in rows
        ),
    )
    output().print(
        "left, right: where the plank's centre is farthest from the straight way between start and goal; "
        "farthest: how far that is."
    )
    if figure is not None:
        groups = [
            PathGroup(source, _COLOURS[source], [way.poses[:, :2] for way in ways(source)])
            for source in SOURCES
        ]
        draw_paths(figure, groups)
    return SATISFIED
