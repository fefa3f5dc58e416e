"""What the page draws: the objects of the library, and judgements on scenes."""

from functools import cache
from typing import Any

import numpy as np
from jaxtyping import Float

from deggflow.tasks.tabletop.condition import SceneCondition
from deggflow.tasks.tabletop.library import LIBRARY, TABLE_DEPTH, TABLE_WIDTH
from deggflow.tasks.tabletop.oracle import least_margin
from deggflow.tasks.tabletop.verdict import BUFFER, Poses, all_margins, describe, judge
from deggflow.view.tabletop.gaps import gap_of
from deggflow.view.tabletop.marks import marks_of
from deggflow.view.tabletop.outlines import footprints, silhouettes

NAMED = 6  # breaches that are named on a picture


@cache
def library() -> dict[str, Any]:
    """Outlines, looks and default regions of all objects, in their body frames (m)."""
    objects = {
        kind.name: {
            "footprint": [rounded(part) for part in footprints(kind.name)],
            "looks": [
                {"outline": rounded(outline), "colour": _code(colour)}
                for outline, colour in silhouettes(kind.name)
            ],
            "mass": kind.mass,
            "regions": [{"x": r.x, "y": r.y, "radius": r.radius} for r in kind.regions],
        }
        for kind in LIBRARY
    }
    table = {"width": TABLE_WIDTH, "depth": TABLE_DEPTH}
    return {"objects": objects, "table": table, "buffer": BUFFER}


def _code(colour: tuple[float, float, float]) -> str:
    return "#" + "".join(f"{round(255 * part):02x}" for part in colour)


def judgement(
    condition: SceneCondition, poses: Poses, *, breaches_only: bool = False
) -> dict[str, Any]:
    """What exact geometry says of a scene, and whether Shapely agrees.

    Args:
        condition: Objects, requirements and table.
        poses: x, y (m) and theta (rad) of each object.
        breaches_only: Leave out margins that are met.
    """
    (verdict,) = judge([condition], [poses])
    marks = marks_of(verdict)
    rows = all_margins(condition, poses)
    breaches = [row for row in rows if not row.margin >= 0]
    return {
        "satisfied": verdict.satisfied,
        "min_margin": verdict.min_margin,
        "violation": verdict.violation,
        "reason": verdict.reason(condition.objects),
        "oracle_margin": least_margin(condition, poses),
        "margins": [
            {
                "kind": row.kind.value,
                "owner": row.owner,
                "region": row.region,
                "other": row.other,
                "margin": row.margin,
                "gap": np.round(gap_of(condition, poses, row), 5).tolist(),
            }
            for row in (breaches if breaches_only else rows)
        ],
        "breaches": [describe(each, condition.objects) for each in breaches[:NAMED]],
        "blocked": sorted(marks.blocked),
        "outlined": sorted(marks.outlined),
        "unbalanced": marks.unbalanced,
    }


def rounded(points: Float[np.ndarray, "points dim"]) -> list[list[float]]:
    """Numbers for drawing, to a hundredth of a millimetre."""
    rows: list[list[float]] = np.round(points, 5).tolist()
    return rows
