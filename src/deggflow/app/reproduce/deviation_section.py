"""The section on the deviation: ratios compared with the paper's, and the theorem's two sides."""

import math
from collections.abc import Callable, Mapping, Sequence
from typing import Any

from deggflow.tasks.tabletop.codec import ANGLE_SCALE
from deggflow.tasks.tabletop.deviation import TURN_LENGTH
from deggflow.tasks.tabletop.field import SPREAD
from deggflow.tasks.tabletop.library import TABLE_DEPTH, TABLE_WIDTH
from deggflow.view.distances import (
    POSES,
    STATES,
    BoundLine,
    Measured,
    RatioSeries,
    draw_bounds_over_size,
    draw_ratios,
)

from .experiment import DataTable, Finding, Plot, Section
from .paper import (
    TASK2_SPREAD_POSE,
    TASK2_SPREAD_STATE,
    TASK2_W2_POSE,
    TASK2_W2_SCENES,
    TASK2_W2_STATE,
)
from .words import from_log

KINDS = {
    "scenes": "as in the paper",
    "many": "more scenes",
    "own": "the paper's allocation",
    "same": "one condition",
}
"""The samples of each N, in the order of the table."""

_METRICS = (
    ("states", "generative state z", STATES, TASK2_W2_STATE, TASK2_SPREAD_STATE),
    ("poses", "poses", POSES, TASK2_W2_POSE, TASK2_SPREAD_POSE),
)
_BOUNDS = {
    "secant": "Euler steps, growth of each pair",
    "quotient": "Euler steps, least L of the pairs",
    "samples": "Euler steps, each sample's own L",
    "held": "Euler steps, the theorem's L",
    "theorem": "theorem's bound",
}
"""From the sharpest to the theorem's own bound; keys as in `deggflow.deviation.Bounds`."""


def section_of(result: Mapping[str, Any]) -> Section:
    """The section of a result."""
    rows = result["rows"]
    theorem = {row["size"]: row["theorem"] for row in rows if "theorem" in row}
    return Section(
        title="Task 2: deviation from the nominal distribution",
        paper=f"fig:task2_w2. W2 between {TASK2_W2_SCENES} nominal and guided scenes over the RMS distance between two nominal ones: "
        f"{_paper_ends(TASK2_W2_STATE)} in the generative state, {_paper_ends(TASK2_W2_POSE)} in poses. Spread of guided over that "
        f"of nominal scenes: {TASK2_SPREAD_STATE} and {TASK2_SPREAD_POSE}.",
        text=(_method(result), _differences(rows), _theorem_text(theorem)),
        tables=(_ratio_table(rows), _theorem_table(theorem)),
        plots=(
            Plot(
                "deviation",
                f"Left: W2 between nominal and guided scenes over the RMS distance between two nominal scenes; right: spread of "
                f"guided over that of nominal scenes; {result['scenes']} scenes of each N, 95% jackknife intervals over scenes. "
                "Open markers and bands: the paper's.",
                draw_ratios(_panels(rows)),
            ),
            Plot(
                "deviation_bounds",
                f"The theorem's two sides for one condition of each N, {result['paths']} samples: the measured W2 and its bounds, "
                "from the sharpest growth of the field to the theorem's own L(τ).",
                draw_bounds_over_size(_lines(theorem)),
            ),
        ),
        summary=tuple(_finding(rows, *metric) for metric in _METRICS),
    )


def _paper_ends(ratios: Mapping[int, float]) -> str:
    return ", ".join(f"{100 * ratio:.1f}% (N = {size})" for size, ratio in ratios.items())


def _percent(estimate: Mapping[str, Any], name: str, interval: str) -> str:
    low, high = estimate[interval]
    return f"{100 * estimate[name]:.1f}% [{100 * low:.1f}, {100 * high:.1f}]"


def _ratio_table(rows: Sequence[Mapping[str, Any]]) -> DataTable:
    lines: list[list[Any]] = []
    for kind, title in KINDS.items():
        for row in (row for row in rows if kind in row):
            sample, cells = row[kind], []
            for metric, _, _, paper, _ in _METRICS:
                ratio = paper.get(row["size"]) if kind == "scenes" else None
                cells.append(None if ratio is None else f"{100 * ratio:.1f}%")
                cells.append(_percent(sample[metric], "ratio", "ratio_interval"))
            spreads = [_percent(sample[m[0]], "spread_ratio", "spread_interval") for m in _METRICS]
            own = f"{100 * sample['states']['identity']:.0f}%"
            lines.append([row["size"], sample["states"]["samples"], title, *cells, *spreads, own])
    return DataTable(
        "deviation",
        "W2 over the nominal scenes' RMS distance (W2/S), and spread of guided over that of nominal scenes, with 95% jackknife "
        "intervals. Own: scenes that the optimal assignment pairs with the scene of the same z(0).",
        (
            "N", "scenes", "sample", "W2/S in z, paper", "W2/S in z", "W2/S in poses, paper",
            "W2/S in poses", "spread in z", "spread in poses", "own",
        ),
        lines,
    )  # fmt: skip


def _theorem_table(theorem: Mapping[int, Mapping[str, Any]]) -> DataTable:
    lines = [
        [
            size,
            sides["samples"],
            sides["w2"],
            sides["paired"],
            *(from_log(sides["log_bounds"][name]) for name in _BOUNDS),
            sides["integral"],
            sides["largest"],
            sides["decoder"],
            sides["poses_w2"],
            sides["decoder"] * sides["w2"],
        ]
        for size, sides in theorem.items()
    ]
    return DataTable(
        "deviation_theorem",
        "Both sides of the Wasserstein bound, for one condition and fixed steps; distances are of joint states in z, not "
        "divided by N. Paired: RMS distance of a nominal sample to the guided one of the same z(0). W2 of poses is in the "
        "units of the decoder's entries (m, m, rad).",
        (
            "N", "samples", "W2", "paired", *_BOUNDS.values(), "∫ L", "largest L", "L_D",
            "W2 of poses", "L_D W2",
        ),
        lines,
    )  # fmt: skip


def _panels(rows: Sequence[Mapping[str, Any]]) -> list[tuple[str, list[RatioSeries]]]:
    def series(what: str, interval: str) -> Callable[[str], dict[int, Measured]]:
        return lambda metric: {
            row["size"]: Measured(row["scenes"][metric][what], *row["scenes"][metric][interval])
            for row in rows
        }

    ratio, spread = series("ratio", "ratio_interval"), series("spread_ratio", "spread_interval")
    return [
        (
            r"$W_2 / S_{\mathrm{Nom}}$ (%)",
            [RatioSeries(label, colour, ratio(key), paper) for key, label, colour, paper, _ in _METRICS],
        ),
        (
            r"$S_{\mathrm{Gui}} / S_{\mathrm{Nom}}$ (%)",
            [RatioSeries(label, colour, spread(key), {}, (band.low, band.high)) for key, label, colour, _, band in _METRICS],
        ),
    ]  # fmt: skip


def _lines(theorem: Mapping[int, Mapping[str, Any]]) -> list[BoundLine]:
    w2 = {size: math.log(sides["w2"]) for size, sides in theorem.items()}
    return [
        BoundLine("$W_2$, measured", w2, promised=False),
        *(
            BoundLine(label, {n: sides["log_bounds"][name] for n, sides in theorem.items()}, True)
            for name, label in _BOUNDS.items()
        ),
    ]


def _method(result: Mapping[str, Any]) -> str:
    return (
        f"{result['scenes']} scenes of each N, seed {result['seed']}, nominal and guided from the same z(0), first draws. As in the "
        "paper, every scene has its own condition. The theorem concerns a single condition, so rows for one condition are added. "
        "Intervals are by the jackknife, which leaves out one pair of nominal and guided scenes at a time."
    )


def _differences(rows: Sequence[Mapping[str, Any]]) -> str:
    states, poses = _heading_shares()
    text = (
        f"In the paper the two ratios are similar; here the ratio of poses is larger. Headings are uniform in our training scenes "
        f"and account for {100 * states:.0f}% of the variance in z, but for {100 * poses:.0f}% in poses, where a radian counts as "
        f"{TURN_LENGTH} m. Displacements of objects therefore weigh more in poses."
    )
    ends = [row for row in (rows[0], rows[-1]) if "own" in row]
    if not ends:
        return text
    ratios = " and ".join(
        f"{100 * row['own']['states']['ratio']:.1f}% instead of {100 * row['many']['states']['ratio']:.1f}% (N = {row['size']})"
        for row in ends
    )
    return (
        f"{text} The allocation explains another part of the difference: with the paper's allocation, c from V(0) and fixed "
        f"steps, W2/S in z is {ratios}. The remaining difference lies in the nominal fields and in the "
        "distribution of changed requirements, which the paper does not specify in full."
    )


def _heading_shares() -> tuple[float, float]:
    """The headings' share of the training scenes' variance, in z and in poses."""
    lengths = TABLE_WIDTH / 2, TABLE_DEPTH / 2, ANGLE_SCALE * TURN_LENGTH
    squares = [each**2 for each in SPREAD]
    pose_squares = [(each * length) ** 2 for each, length in zip(SPREAD, lengths, strict=True)]
    return squares[2] / sum(squares), pose_squares[2] / sum(pose_squares)


def _theorem_text(theorem: Mapping[int, Mapping[str, Any]]) -> str:
    def over(name: str) -> str:
        logs = [sides["log_bounds"][name] - math.log(sides["w2"]) for sides in theorem.values()]
        ends = dict.fromkeys(from_log(log) for log in (min(logs), max(logs)))
        return " to ".join(ends)

    return (
        "The theorem's L(τ) is a Lipschitz constant of the nominal field, which is not known for a trained network. The value used "
        "here comes from power iteration on the Jacobian between nominal and guided states (and from their difference quotient). It "
        "is a lower estimate of the constant over all states, and sufficient for these samples. The theorem has its integral in an "
        f"exponent, so the bound is {over('theorem')} times W2. The bound is loose because of L, not because of the corrections: with "
        f"the factor by which each Euler step actually stretched the gap of each pair, the bound is {over('secant')} times W2. All "
        "bounds except the theorem's integral are such recursions over the Euler steps, without quadrature error. The decoder is "
        "linear, so its L_D is exact: the largest entry of its diagonal."
    )


def _finding(
    rows: Sequence[Mapping[str, Any]], key: str, label: str, _: str, paper: Mapping[int, float], band: Any
) -> Finding:  # fmt: skip
    ours = {row["size"]: row["scenes"][key] for row in rows}
    ends = [size for size in paper if size in ours]
    spreads = [deviation["spread_ratio"] for deviation in ours.values()]
    return Finding(
        f"Task 2, W2/S in {label}, N = {' and '.join(map(str, ends))}; spread ratio",
        " and ".join(f"{100 * paper[n]:.1f}%" for n in ends) + f"; {band}",
        " and ".join(f"{100 * ours[n]['ratio']:.1f}%" for n in ends)
        + f"; {100 * min(spreads):.1f}% to {100 * max(spreads):.1f}%",
    )
