"""Verdicts on generated scenes, including those whose generation diverged."""

from collections.abc import Sequence
from typing import NamedTuple

import numpy as np

from deggflow.divergence import has_diverged

from .condition import SceneCondition
from .verdict import Poses, Verdict, judge

MAX_COORDINATE = 1e4  # m and rad; states beyond have diverged, and are not stored in files


class Settled(NamedTuple):
    """Generated scenes and their verdicts, in order.

    Attributes:
        poses: As stored in files; a scene that diverged lies beyond the table's corner.
        verdicts: Of these poses.
        diverged: Whether each generation did.
    """

    poses: list[Poses]
    verdicts: list[Verdict]
    diverged: list[bool]


def judge_generated(conditions: Sequence[SceneCondition], poses: Sequence[Poses]) -> Settled:
    """Judges scenes; one that diverged is judged at a place off the table, where every requirement fails."""
    diverged = [has_diverged(each, MAX_COORDINATE) for each in poses]
    settled = [
        np.full_like(each, [condition.width, condition.depth, 0.0]) if lost else each
        for each, condition, lost in zip(poses, conditions, diverged, strict=True)
    ]
    return Settled(settled, judge(conditions, settled), diverged)
