"""The section on the deviation: ratios beside the paper's, and the theorem's two sides."""

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
    "scenes": "as the paper",
    "many": "more scenes",
    "own": "the paper's own shares",
    "same": "one condition",
}
"""What was measured of each N, in the order of the table."""

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
"""From the sharpest to the theorem's own, as `deggflow.deviation.Bounds` has them."""


def section_of(result: Mapping[str, Any]) -> Section:
    """Tables, figures and texts of a result."""
    rows = result["rows"]
    theorem = {row["size"]: row["theorem"] for row in rows if "theorem" in row}
    return Section(
        title="Task 2: deviation from the nominal distribution",
        paper=f"fig:task2_w2. W2 between {TASK2_W2_SCENES} nominal and guided scenes over the RMS distance between two nominal ones: "
        f"{_paper_ends(TASK2_W2_STATE)} in the generative state, {_paper_ends(TASK2_W2_POSE)} in poses. Spread of guided over that "
        f"of nominal scenes: {TASK2_SPREAD_STATE} and {TASK2_SPREAD_POSE}.",
        text=(_ways(result), _differences(rows), _theorem_text(theorem)),
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
                f"The theorem's two sides for one condition of each N, {result['paths']} samples: W2 as measured, and what bounds it, "
                "from the sharpest growth of the field to the theorem's own L(τ).",
                draw_bounds_over_size(_lines(theorem)),
            ),
        ),
        summary=tuple(_finding(rows, *metric) for metric in _METRICS),
    )


def _paper_ends(ratios: Mapping[int, float]) -> str:
    return ", ".join(f"{100 * ratio:.1f}% (N = {size})" for size, ratio in ratios.items())


def _percent(found: Mapping[str, Any], what: str, interval: str) -> str:
    low, high = found[interval]
    return f"{100 * found[what]:.1f}% [{100 * low:.1f}, {100 * high:.1f}]"


def _ratio_table(rows: Sequence[Mapping[str, Any]]) -> DataTable:
    lines: list[list[Any]] = []
    for kind, title in KINDS.items():
        for row in (row for row in rows if kind in row):
            found, cells = row[kind], []
            for metric, _, _, quoted, _ in _METRICS:
                known = quoted.get(row["size"]) if kind == "scenes" else None
                cells.append(None if known is None else f"{100 * known:.1f}%")
                cells.append(_percent(found[metric], "ratio", "ratio_interval"))
            spreads = [_percent(found[m[0]], "spread_ratio", "spread_interval") for m in _METRICS]
            own = f"{100 * found['states']['identity']:.0f}%"
            lines.append([row["size"], found["states"]["samples"], title, *cells, *spreads, own])
    return DataTable(
        "deviation",
        "W2 over the nominal scenes' RMS distance (W2/S), and spread of guided over that of nominal scenes, with 95% jackknife "
        "intervals. Own: scenes whose partner in the best assignment is the scene of the same z(0).",
        (
            "N", "scenes", "", "W2/S in z, paper", "W2/S in z", "W2/S in poses, paper",
            "W2/S in poses", "spread in z", "spread in poses", "own",
        ),
        lines,
    )  # fmt: skip


def _theorem_table(theorem: Mapping[int, Mapping[str, Any]]) -> DataTable:
    lines = [
        [
            size,
            found["samples"],
            found["w2"],
            found["paired"],
            *(from_log(found["log_bounds"][name]) for name in _BOUNDS),
            found["integral"],
            found["largest"],
            found["decoder"],
            found["poses_w2"],
            found["decoder"] * found["w2"],
        ]
        for size, found in theorem.items()
    ]
    return DataTable(
        "deviation_theorem",
        "Both sides of the Wasserstein bound, for one condition and fixed steps; distances are of joint states in z, not "
        "divided by N. Paired: RMS distance of a nominal sample to the guided one of the same z(0). W2 of poses in the units "
        "of the decoder's entries (m, m, rad).",
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
            [RatioSeries(label, colour, ratio(key), quoted) for key, label, colour, quoted, _ in _METRICS],
        ),
        (
            r"$S_{\mathrm{Gui}} / S_{\mathrm{Nom}}$ (%)",
            [RatioSeries(label, colour, spread(key), {}, (band.low, band.high)) for key, label, colour, _, band in _METRICS],
        ),
    ]  # fmt: skip


def _lines(theorem: Mapping[int, Mapping[str, Any]]) -> list[BoundLine]:
    measured = {size: math.log(found["w2"]) for size, found in theorem.items()}
    return [
        BoundLine("$W_2$, measured", measured, promised=False),
        *(
            BoundLine(label, {n: found["log_bounds"][name] for n, found in theorem.items()}, True)
            for name, label in _BOUNDS.items()
        ),
    ]


def _ways(result: Mapping[str, Any]) -> str:
    return (
        f"{result['scenes']} scenes of each N, seed {result['seed']}, nominal and guided from the same z(0), first draws. As in the "
        "paper every scene has a condition of its own; the theorem is about one condition, so rows of one condition stand beside "
        "them. Intervals are by the jackknife: scenes are left out one by one, with their guided ones."
    )


def _differences(rows: Sequence[Mapping[str, Any]]) -> str:
    states, poses = _heading_shares()
    text = (
        f"In the paper both ratios are alike, here that of poses is the larger one. Headings are uniform in our training scenes "
        f"and make {100 * states:.0f}% of their variance in z, but {100 * poses:.0f}% of it in poses, where a radian counts as "
        f"{TURN_LENGTH} m: there, what moves objects weighs more."
    )
    ends = [row for row in (rows[0], rows[-1]) if "own" in row]
    if not ends:
        return text
    shares = " and ".join(
        f"{100 * row['own']['states']['ratio']:.1f}% instead of {100 * row['many']['states']['ratio']:.1f}% (N = {row['size']})"
        for row in ends
    )
    return (
        f"{text} How agents share the work is another part of the difference: with the paper's own shares, c from V(0) and fixed "
        f"steps, W2/S in z is {shares}. What is left lies in the nominal fields and in how changed requirements "
        "are drawn, neither of which the paper gives in full."
    )


def _heading_shares() -> tuple[float, float]:
    """Of the training scenes' variance: headings' share in z, and in poses."""
    lengths = TABLE_WIDTH / 2, TABLE_DEPTH / 2, ANGLE_SCALE * TURN_LENGTH
    squares = [each**2 for each in SPREAD]
    scaled = [(each * length) ** 2 for each, length in zip(SPREAD, lengths, strict=True)]
    return squares[2] / sum(squares), scaled[2] / sum(scaled)


def _theorem_text(theorem: Mapping[int, Mapping[str, Any]]) -> str:
    def over(name: str) -> str:
        logs = [found["log_bounds"][name] - math.log(found["w2"]) for found in theorem.values()]
        ends = dict.fromkeys(from_log(log) for log in (min(logs), max(logs)))
        return " to ".join(ends)

    return (
        "The theorem's L(τ) is a Lipschitz constant of the nominal field. For a trained network nobody knows it; what stands here was "
        "found by power iteration on the Jacobian between nominal and guided states (and by their difference quotient), so it is an "
        "estimate from below of a constant for all states, and enough for these samples. Its integral stands in an exponent: the "
        f"theorem's bound is {over('theorem')} times W2. What makes it loose is L, not the corrections: if every Euler step stretches the gap "
        f"of each pair by the factor that it had, the bound is {over('secant')} times W2. All bounds but the theorem's integral are such "
        "recursions over the Euler steps, without an error of quadrature. The decoder is linear, so its L_D is exact: the "
        "largest entry of its diagonal."
    )


def _finding(
    rows: Sequence[Mapping[str, Any]], key: str, label: str, _: str, quoted: Mapping[int, float], band: Any
) -> Finding:  # fmt: skip
    known = {row["size"]: row["scenes"][key] for row in rows}
    ends = [size for size in quoted if size in known]
    spreads = [found["spread_ratio"] for found in known.values()]
    return Finding(
        f"Task 2, W2/S in {label}, N = {' and '.join(map(str, ends))}; spread ratio",
        " and ".join(f"{100 * quoted[n]:.1f}%" for n in ends) + f"; {band}",
        " and ".join(f"{100 * known[n]['ratio']:.1f}%" for n in ends)
        + f"; {100 * min(spreads):.1f}% to {100 * max(spreads):.1f}%",
    )
