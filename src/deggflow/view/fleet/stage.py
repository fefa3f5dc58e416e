"""Where pictures of a playback are taken: MuJoCo's model in a state of the playback, or a top view."""

from functools import cache
from typing import Any, NamedTuple

import numpy as np
from jaxtyping import Float

from deggflow.view.colours import FAULT, rgb
from deggflow.view.picture import Picture
from deggflow.view.stage import MovableModel, Shot, Stage, open_stage

from .mjcf import fleet_mjcf
from .playback import Playback
from .robots import robot_name


class Moment(NamedTuple):
    """A playback at a tick.

    Attributes:
        state: MuJoCo's generalised positions.
        places: Of the robots' centres, in map units.
    """

    state: Float[np.ndarray, " coordinates"]
    places: Float[np.ndarray, "robots 2"]


def moment_of(playback: Playback, tick: int) -> Moment:
    """A playback at a tick."""
    return Moment(playback.states[tick], playback.positions[tick] / playback.scale.metres)


class FleetModel(MovableModel[Moment]):
    """The robots of a playback; those that miss a requirement of their plan are red."""

    def __init__(self, playback: Playback, aspect: float) -> None:
        super().__init__(fleet_mjcf(playback.plan, playback.drive, playback.scale, aspect=aspect))
        for robot in playback.plan.verdict().blocked:
            self.model.geom(f"{robot_name(robot)}_hull").rgba[:3] = rgb(FAULT)

    def place(self, state: Moment) -> None:
        """Puts the robots where they are."""
        self.data.qpos[:] = state.state


def playback_stage(playback: Playback, shot: Shot) -> Stage[Moment]:
    """A stage for one playback.

    Raises:
        RuntimeError: If MuJoCo is asked for and OpenGL cannot be used.
    """

    @cache
    def drawn() -> Any:
        from .topview import MovingRobots  # brings matplotlib, which MuJoCo's pictures do without

        return MovingRobots(playback.plan, (shot.width, shot.height))

    def draw(state: Moment, width: int, height: int) -> Picture:
        return drawn().picture(state.places)

    return open_stage(lambda: FleetModel(playback, shot.width / shot.height), draw, shot)
