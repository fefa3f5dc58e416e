"""What a notebook shows of samples, certificates and generations: HTML that holds its own pictures.

Text and lines have the colour of the notebook's text, so that they can be read on light and dark pages.
"""

from collections.abc import Sequence
from html import escape
from typing import TYPE_CHECKING

import numpy as np
from jaxtyping import Float

if TYPE_CHECKING:
    from .certificate import Certificate, GenerationRecord, TraceRecord
    from .generation import Generation
    from .sampling import Samples

GUIDED, FAULT, GREY = "#0072b2", "#d4201f", "#8a8a8a"  # as in the report
SHOWN = 64  # samples in one picture
_WIDTH, _HEIGHT = 300.0, 170.0  # pixels of a chart
_LEFT, _RIGHT, _TOP, _BOTTOM = 54.0, 10.0, 18.0, 22.0  # pixels around its axes
_SIDE, _EDGE = 260.0, 12.0  # pixels of a picture, and around it
_LEAST = 1e-12  # of a logarithmic axis

Curve = Float[np.ndarray, " points"]


def certificate_html(certificate: "Certificate") -> str:
    """The verdict, a table of the requirements and, if the trace was kept, every value below its bound."""
    parts = [_verdict(certificate)]
    record = certificate.generation
    if record is not None:
        parts.append(_records(record, {each.name: each.margin for each in certificate.verdicts}))
        if record.trace is not None:
            parts.append(_charts([each.name for each in record.requirements], record.trace))
    return _block(parts)


def samples_html(samples: "Samples") -> str:
    """How many are satisfied, why others are not, and their first two coordinates."""
    lines = [escape(line) for line in str(samples).splitlines()]
    picture = _picture(samples.z[:SHOWN], samples.satisfied[:SHOWN])
    note = f"<p>The first {SHOWN} of them.</p>" if picture and len(samples) > SHOWN else ""
    return _block([f"<p>{'<br/>'.join(lines)}</p>", picture, note])


def generation_html(generation: "Generation") -> str:
    """The state at tau = 1 with the way there, if it was kept, and every value below its bound."""
    z = np.asarray(generation.z, np.float64)
    batch = z if z.ndim == 3 else z[None]
    ways = None
    if generation.path is not None and z.ndim == 2:
        ways = np.asarray(generation.path, np.float64)
    shape = " x ".join(map(str, z.shape))
    parts = [f"<p>A generation: z(1) of shape {shape}.</p>", _picture(batch[:SHOWN], None, ways)]
    trace = generation.trace
    if trace is not None and np.ndim(trace.tau) == 1:
        curves = [np.asarray(each, np.float64) for each in (trace.value, trace.bound, trace.limit)]
        tau = np.asarray(trace.tau, np.float64)
        parts += [
            _chart(f"requirement {row + 1}", tau, *(each[:, row] for each in curves))
            for row in range(curves[0].shape[1])
        ]
    return _block(parts)


def _block(parts: Sequence[str]) -> str:
    return f'<div style="font-size:13px">{"".join(parts)}</div>'


def _verdict(certificate: "Certificate") -> str:
    draws = f"{certificate.draws} draw" + "s" * (certificate.draws != 1)
    facts = f"least margin {certificate.min_margin:.3g}, V {certificate.violation:.3g}, {draws}"
    if certificate.satisfied:
        return f"<p><b>Satisfied</b>; {facts}.</p>"
    reason = escape(str(certificate.reason))
    return f'<p><b style="color:{FAULT}">Not satisfied</b>: {reason}; {facts}.</p>'


def _records(record: "GenerationRecord", margins: dict[str, float]) -> str:
    head = ("requirement", "margin", "value at the end", "limit", "largest excess", "active at")
    rows = [
        (
            each.name,
            f"{margins[each.name]:.3g}" if each.name in margins else "-",
            *(f"{number:.3g}" for number in (each.value, each.limit, each.excess)),
            f"{each.active_points} points",
        )
        for each in record.requirements
    ]
    cells = "".join(f'<th scope="col">{name}</th>' for name in head)
    lines = "".join(
        f"<tr>{''.join(f'<td>{escape(cell)}</td>' for cell in row)}</tr>" for row in rows
    )
    hold = "hold" if record.hypotheses_hold else f"fail: {record.first_failure}"
    return (
        f"<p>The hypotheses of the theorems {escape(hold)} ({record.steps} steps).</p>"
        f"<table><thead><tr>{cells}</tr></thead><tbody>{lines}</tbody></table>"
    )


def _charts(names: Sequence[str], trace: "TraceRecord") -> str:
    tau = np.array(trace.tau, np.float64)
    curves = [np.array(each, np.float64) for each in (trace.value, trace.bound, trace.limit)]
    return "".join(
        _chart(name, tau, *(each[:, row] for each in curves)) for row, name in enumerate(names)
    )


def _chart(name: str, tau: Curve, value: Curve, bound: Curve, limit: Curve) -> str:
    """A value below its bound (dashed) and its limit (dotted); on a logarithmic axis where it is never negative."""
    curves = np.stack([value, bound, limit])
    logarithmic = bool(np.all(value >= 0))
    if logarithmic:
        curves = np.log10(np.maximum(curves, _LEAST))
    finite = curves[np.isfinite(curves)]
    if finite.size == 0:
        return ""
    low, high = float(finite.min()), float(finite.max())
    spread = max(high - low, 1e-12)
    x = _LEFT + tau * (_WIDTH - _LEFT - _RIGHT)
    foot = _HEIGHT - _BOTTOM
    y = foot - (curves - low) / spread * (foot - _TOP)
    styles = (
        f'stroke="{GUIDED}" stroke-width="1.8"',
        'stroke="currentColor" stroke-dasharray="5 3"',
        f'stroke="{GREY}" stroke-dasharray="1.5 2.5"',
    )
    lines = [
        f'<path d="{_path(x, row)}" fill="none" {style}/>' for row, style in zip(y, styles, strict=True)
    ]  # fmt: skip
    texts = [
        _text(_LEFT, 12.0, f"{name}; bound dashed, limit dotted", "start"),
        *(
            _text(_LEFT - 5, at + 4, f"{10**number if logarithmic else number:.1g}", "end")
            for number, at in ((low, foot), (high, _TOP))
        ),
        *(_text(x[k], _HEIGHT - 6, f"{tau[k]:g}", "middle") for k in (0, -1)),
    ]
    axes = f'<path d="M{_LEFT} {_TOP}V{foot}H{_WIDTH - _RIGHT}" fill="none" stroke="currentColor" stroke-width=".7"/>'
    return _svg(_WIDTH, _HEIGHT, f"{name} over tau", [axes, *lines, *texts])


def _picture(
    z: Float[np.ndarray, "samples agents dim"],
    satisfied: Sequence[bool] | np.ndarray | None,
    ways: Float[np.ndarray, "points agents dim"] | None = None,
) -> str:
    """The first two coordinates of agents; samples that are not satisfied are red."""
    if z.shape[-1] < 2 or z.size == 0:
        return ""
    points = z[..., :2].astype(np.float64)
    everything = points.reshape(-1, 2)
    if ways is not None:
        everything = np.concatenate([everything, ways[..., :2].reshape(-1, 2)])
    everything = everything[np.isfinite(everything).all(axis=1)]
    if len(everything) == 0:
        return ""
    low, high = everything.min(axis=0), everything.max(axis=0)
    scale = (_SIDE - 2 * _EDGE) / max(float((high - low).max()), 1e-12)

    def place(at: Float[np.ndarray, "*some 2"]) -> Float[np.ndarray, "*some 2"]:
        position = (at - (low + high) / 2) * scale * [1.0, -1.0] + _SIDE / 2
        return np.asarray(position)

    parts = []
    if ways is not None:
        for way in np.moveaxis(place(ways[..., :2]), 1, 0):
            parts.append(
                f'<path d="{_path(*way.T)}" fill="none" stroke="{GREY}" stroke-width=".8"/>'
            )
    for k, sample in enumerate(place(points)):
        colour = GUIDED if satisfied is None or satisfied[k] else FAULT
        for x, y in sample[np.isfinite(sample).all(axis=1)]:
            parts.append(
                f'<circle cx="{x:.1f}" cy="{y:.1f}" r="2.4" fill="{colour}" fill-opacity=".6"/>'
            )
    return _svg(_SIDE, _SIDE, "First two coordinates of all agents", parts)


def _path(x: Curve, y: Curve) -> str:
    """The curve as the data of an SVG path, broken where it is not finite."""
    data, pen = [], "M"
    for a, b in zip(x, y, strict=True):
        if np.isfinite(a) and np.isfinite(b):
            data.append(f"{pen}{a:.1f} {b:.1f}")
            pen = "L"
        else:
            pen = "M"
    return "".join(data)


def _text(x: float, y: float, words: str, anchor: str) -> str:
    return (
        f'<text x="{x:.1f}" y="{y:.1f}" text-anchor="{anchor}" fill="currentColor" '
        f'font-size="10">{escape(words)}</text>'
    )


def _svg(width: float, height: float, label: str, parts: Sequence[str]) -> str:
    return (
        f'<svg width="{width:.0f}" height="{height:.0f}" viewBox="0 0 {width:.0f} {height:.0f}" '
        f'role="img" aria-label="{escape(label)}" xmlns="http://www.w3.org/2000/svg">{"".join(parts)}</svg>'
    )
