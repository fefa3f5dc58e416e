"""The deviation of every guidance method between a lower bound that holds for all and an upper bound of its own."""

from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np
from jaxtyping import Bool, Float

from deggflow.deviation import lower_confidence
from deggflow.schema import parse_as
from deggflow.tasks.tabletop.baselines import Method
from deggflow.tasks.tabletop.field import load_field
from deggflow.tasks.tabletop.two_sided import LOWER, NEAREST, CaseDeviations, jobs
from deggflow.view.standing import Standing, StandingPanel, draw_standing

from .baselines import BY_NAME, LOOKS, compared
from .experiment import UNMET, DataTable, Experiment, Finding, Plot, Progress, Section, Settings
from .rows import kept_rows
from .run import code_digest

SIZES, QUICK_SIZES = (4, 8, 12), (8,)
NEARBY = "predict, then pooled"  # the second start of the search for near scenes
ROUNDING = 1e-6  # relative, of paths in float32 and of the bounds computed from them

_METHOD = (
    "Every method runs at its selected setting on the same field, from the same z(0), under the same randomly changed "
    "requirements; the deviation is the RMS distance to the nominal sample of the same z(0), and so bounds W2 from above. "
    "The lower bound holds for any samples that satisfy the requirements: two parts that are in each other's way must be "
    "separated along some direction, and every direction costs the two objects some displacement. It is certified, and "
    "only its expected value is estimated from the cases. The upper bounds are recursions over the steps of each sample's "
    "path, with the factor by which each step stretched its distance to the nominal path."
)


class LeastDeviation:
    """Both bounds and all methods."""

    name = "least_deviation"

    def measure(self, settings: Settings, say: Progress) -> Mapping[str, Any]:
        """The bounds and every method's deviations, case by case."""
        sizes = QUICK_SIZES if settings.quick else SIZES
        methods: list[Method | str] = [LOWER, NEAREST, *compared(settings)]
        grid = [(size, method) for size in sizes for method in methods]
        cases = settings.cases(256, 16)
        identity = {
            "cases": cases,
            "seed": settings.seed,
            "code": code_digest(),
            "rows": [[size, m if isinstance(m, str) else m.name] for size, m in grid],
        }
        todo = jobs(load_field(), grid, cases, settings.seed, BY_NAME[NEARBY], say)
        rows = kept_rows(settings, self.name, identity, todo, CaseDeviations)
        return {
            "cases": cases,
            "seed": settings.seed,
            "rows": [row.to_json() for row in rows],
            UNMET: [
                text for row in rows for text in _contradictions(row, _lower_of(rows, row.size))
            ],
        }

    def present(self, result: Mapping[str, Any], settings: Settings) -> Section:
        """A table and a figure of all methods between the bounds."""
        rows = [parse_as(CaseDeviations, row) for row in result["rows"]]
        sizes = sorted({row.size for row in rows})
        lower = {size: _lower_of(rows, size) for size in sizes}
        table = DataTable(
            "least_deviation",
            f"RMS deviation from the nominal sample in z, per object; {result['cases']} cases of each N, seed {result['seed']}. "
            "95% limit: lower confidence limit of the expected value. Satisfied: success with 95% Wilson intervals. Times the "
            "lower bound and times the nearest scenes: over the cases that the method satisfies, the only ones that the bounds "
            "concern. Upper bound: from the steps of each sample's path; without diverged samples.",
            ("N", "method", "satisfied", "deviation", "95% limit", "times lower bound", "times nearest", "upper bound"),
            [_line(row, lower[row.size], _of(rows, NEAREST, row.size)) for row in rows],
        )  # fmt: skip
        plot = Plot(
            "least_deviation",
            "RMS deviation of each method between the lower bound for any method that always succeeds (dark) and its own upper "
            "bound (ticks). In the light range, it is not known whether a method could be as close. Open markers: some samples "
            "fail, so the lower bound does not apply.",
            draw_standing([_panel(rows, size) for size in sizes], unit="$z$, per object"),
        )
        biggest = sizes[-1]
        return Section(
            title="Task 2: deviation between a lower and an upper bound",
            paper="No such table: the paper has the upper bound of thm:wasserstein.",
            text=(_METHOD, *(_in_words(rows, size) for size in sizes)),
            tables=(table,),
            plots=(plot,),
            summary=(
                Finding(
                    f"Task 2, N = {biggest}: least possible RMS deviation / pooled guidance / {NEARBY}",
                    "-",
                    f"{_between(rows, biggest)} / "
                    + " / ".join(
                        f"{_rms(_squares(_of(rows, name, biggest))):.3f}"
                        if _has(rows, name)
                        else "-"
                        for name in ("pooled", NEARBY)
                    ),
                ),
            ),
        )


def _of(rows: Sequence[CaseDeviations], name: str, size: int) -> CaseDeviations:
    return next(row for row in rows if (row.method, row.size) == (name, size))


def _has(rows: Sequence[CaseDeviations], name: str) -> bool:
    return any(row.method == name for row in rows)


def _lower_of(rows: Sequence[CaseDeviations], size: int) -> CaseDeviations:
    return _of(rows, LOWER, size)


def _squares(row: CaseDeviations) -> Float[np.ndarray, " cases"]:
    return np.array(row.squared, np.float64)


def _uppers(row: CaseDeviations) -> Float[np.ndarray, " cases"]:
    return np.array(row.upper, np.float64)


def _rms(squares: Float[np.ndarray, " cases"]) -> float:
    """Over the cases that have a value; NaN if none has."""
    finite = squares[np.isfinite(squares)]
    return float(np.sqrt(np.mean(finite))) if len(finite) else float("nan")


def _contradictions(row: CaseDeviations, lower: CaseDeviations) -> list[str]:
    """Messages on cases that violate a bound, which cannot be if the bounds are right."""
    squares, satisfied = _squares(row), np.array(row.satisfied)
    below = satisfied & (squares < _squares(lower) * (1 - ROUNDING))
    above = squares > _uppers(row) * (1 + ROUNDING) ** 2 + ROUNDING**2
    counts = {"below the lower bound": below, "above the upper bound": above}
    place = f"deviation, N = {row.size}, {row.method}"
    return [
        f"{place}: {cases.sum()} cases {what}"
        for what, cases in counts.items()
        if row.method != LOWER and cases.any()
    ]


def _ratio(
    row: CaseDeviations, other: CaseDeviations, counted: Bool[np.ndarray, " cases"]
) -> float | None:
    """RMS deviation over that of another row, over the same cases."""
    theirs = _rms(_squares(other)[counted])
    return round(_rms(_squares(row)[counted]) / theirs, 2) if theirs > 0 else None


def _line(row: CaseDeviations, lower: CaseDeviations, nearest: CaseDeviations) -> list[Any]:
    squares, upper = _squares(row), _uppers(row)
    deviation = round(_rms(squares), 4) if np.any(np.isfinite(squares)) else None
    bound = round(_rms(upper), 4) if np.any(np.isfinite(upper)) else None
    if row.method == LOWER:
        limit = round(lower_confidence(squares), 4)
        return [row.size, row.method, None, deviation, limit, None, None, None]
    counted = np.array(row.satisfied)
    ratios = [_ratio(row, lower, counted), _ratio(row, nearest, counted)]
    return [row.size, row.method, str(row.rate()), deviation, None, *ratios, bound]


def _panel(rows: Sequence[CaseDeviations], size: int) -> StandingPanel:
    names = [name for name in LOOKS if _has(rows, name)]
    standings = []
    for name in names:
        row = _of(rows, name, size)
        deviation, upper = _rms(_squares(row)), _rms(_uppers(row))
        standings.append(
            Standing(
                name,
                LOOKS[name][0],
                deviation if np.isfinite(deviation) else None,
                upper if np.isfinite(upper) else None,
                complete=all(row.satisfied),
            )
        )
    lower, nearest = (_rms(_squares(_of(rows, name, size))) for name in (LOWER, NEAREST))
    return StandingPanel(f"$N = {size}$", lower, nearest, standings)


def _between(rows: Sequence[CaseDeviations], size: int) -> str:
    lower, nearest = (_rms(_squares(_of(rows, name, size))) for name in (LOWER, NEAREST))
    return f"{lower:.4f} to {nearest:.4f}"


def _in_words(rows: Sequence[CaseDeviations], size: int) -> str:
    complete = [
        row for row in rows if row.size == size and row.method in BY_NAME and all(row.satisfied)
    ]
    words = (
        f"N = {size}: the least RMS deviation of a method that always succeeds is {_between(rows, size)} "
        f"(95% lower confidence limit {lower_confidence(_squares(_lower_of(rows, size))):.4f})."
    )
    if not complete:
        return f"{words} No method satisfies every case."
    nearest = min(complete, key=lambda row: _rms(_squares(row)))
    return (
        f"{words} Of the methods that satisfy every case, {nearest.method} is the closest to nominal, "
        f"{_rms(_squares(nearest)):.4f}."
    )


EXPERIMENTS: tuple[Experiment, ...] = (LeastDeviation(),)
