"""Where pictures of scenes are taken: a MuJoCo model whose objects are moved, or a drawn top view."""

from typing import NamedTuple

import numpy as np
from jaxtyping import Float

from deggflow.tasks.tabletop.condition import SceneCondition
from deggflow.tasks.tabletop.verdict import Verdict
from deggflow.view.picture import Picture
from deggflow.view.stage import MovableModel, Shot, Stage, open_stage

from .marks import Marks, centre_of_mass, discs_of, marks_of
from .mjcf import (
    ASPECT,
    BALANCE,
    BLOCKED,
    CENTRE_OF_MASS,
    FREE,
    HIDDEN,
    OUTLINE,
    balance_names,
    outline_names,
    region_name,
    stage_mjcf,
)


class Arrangement(NamedTuple):
    """A scene in one of its states.

    Attributes:
        poses: x, y (m) and theta (rad) of each object.
        verdict: Decides what is red.
    """

    poses: Float[np.ndarray, "agents 3"]
    verdict: Verdict


class TabletopModel(MovableModel[Arrangement]):
    """The objects of one condition, to be moved and recoloured."""

    def __init__(self, condition: SceneCondition, aspect: float) -> None:
        super().__init__(stage_mjcf(condition))
        self._condition = condition
        self._fit_cameras(aspect)
        self._regions = {
            (i, k): self.model.geom(region_name(name, k)).id
            for i, name in enumerate(condition.objects)
            for k in range(len(discs_of(condition, name)))
        }
        self._outlines = [
            [self.model.geom(part).id for part in outline_names(name)] for name in condition.objects
        ]
        names = [] if condition.balance is None else balance_names()
        self._balance = [self.model.geom(name).id for name in names]

    def place(self, state: Arrangement) -> None:
        """Moves the objects; reddens what the verdict finds wrong."""
        for name, (x, y, theta) in zip(self._condition.objects, state.poses, strict=True):
            self.move(name, x, y, theta=theta)
        if self._balance:
            self.move(CENTRE_OF_MASS, *centre_of_mass(self._condition, state.poses))
        self._colour(marks_of(state.verdict))

    def _fit_cameras(self, aspect: float) -> None:
        """Widens the view for pictures narrower than the cameras were framed for."""
        if aspect < ASPECT:
            tangent = np.tan(np.radians(self.model.cam_fovy) / 2) * ASPECT / aspect
            self.model.cam_fovy[:] = np.degrees(2 * np.arctan(tangent))

    def _colour(self, marks: Marks) -> None:
        for region, geom in self._regions.items():
            self.model.geom_rgba[geom] = BLOCKED if region in marks.blocked else FREE
        for i, parts in enumerate(self._outlines):
            self.model.geom_rgba[parts] = OUTLINE if i in marks.outlined else HIDDEN
        if self._balance:
            self.model.geom_rgba[self._balance] = OUTLINE if marks.unbalanced else BALANCE


def tabletop_stage(condition: SceneCondition, shot: Shot) -> Stage[Arrangement]:
    """A stage for one condition."""

    def draw(state: Arrangement, width: int, height: int) -> Picture:
        from .topview import topview_image  # brings matplotlib, which MuJoCo's pictures do without

        return topview_image(condition, *state, width, height)

    return open_stage(lambda: TabletopModel(condition, shot.width / shot.height), draw, shot)
