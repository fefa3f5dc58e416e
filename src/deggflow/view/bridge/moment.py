"""What one moment of a process looks like: where everything stands and what is red."""

from typing import NamedTuple

import numpy as np
from jaxtyping import Bool, Float

from deggflow.tasks.bridge import world
from deggflow.tasks.bridge.process import Process

THICKNESS = 0.06  # m, of the drawn plank
PIT_DEPTH = 0.9  # m, of the drawn pit
_RAMP = 0.1  # m before the plank's edge over which a robot rises onto it


class Moment(NamedTuple):
    """Where plank and robots are drawn, and which of them are red.

    Attributes:
        plank: x, y (m) and theta (rad).
        robots: x, y and z of the underside, 0 on the ground, m.
        red_plank: Whether the plank is red.
        red_robots: Which robots are red.
        lost_robots: Which robots were lost; they are pale.
    """

    plank: Float[np.ndarray, " 3"]
    robots: Float[np.ndarray, "robots 3"]
    red_plank: bool
    red_robots: Bool[np.ndarray, " robots"]
    lost_robots: Bool[np.ndarray, " robots"]


def moment_of(process: Process, tick: int) -> Moment:
    """The moment of one tick.

    A robot is as high as what it stands on: ground, plank, or the pit's floor if its centre is over
    the gap and not on the plank. The last tick of a process that failed shows what is at fault.

    Args:
        process: The process.
        tick: Counted from 0; a negative one from the end.

    Raises:
        IndexError: If the process has no such tick.
        ValueError: If a position is not finite.
    """
    count = len(process.stage)
    if not -count <= tick < count:
        raise IndexError(f"`tick` must be one of the process's {count}; got {tick}.")
    tick %= count
    plank = np.asarray(process.plank[tick], np.float64)
    robots = np.asarray(process.robots[tick], np.float64)
    if not (np.isfinite(plank).all() and np.isfinite(robots).all()):
        raise ValueError(f"`process` must be finite to be drawn; it is not at tick {tick}.")
    away = _distances_to_plank(robots, plank)
    fallen = (robots[:, 0] > world.GAP_LEFT) & (robots[:, 0] < world.GAP_RIGHT) & (away > 0.0)
    ended_badly = process.failure is not None and tick == count - 1
    return Moment(
        plank,
        _standing(robots, away, fallen),
        ended_badly,
        fallen | (_off_limits(robots, away) & ended_badly),
        np.isin(np.arange(len(robots)), process.lost_by(tick)),
    )


def _standing(
    robots: Float[np.ndarray, "robots 2"],
    away: Float[np.ndarray, " robots"],
    fallen: Bool[np.ndarray, " robots"],
) -> Float[np.ndarray, "robots 3"]:
    """Undersides; in the pit, a robot stands clear of the walls."""
    part = np.clip(1.0 - away / _RAMP, 0.0, 1.0)
    height = THICKNESS * part**2 * (3.0 - 2.0 * part)
    clear = np.clip(
        robots[:, 0], world.GAP_LEFT + world.ROBOT_RADIUS, world.GAP_RIGHT - world.ROBOT_RADIUS
    )
    x = np.where(fallen, clear, robots[:, 0])
    return np.column_stack([x, robots[:, 1], np.where(fallen, -PIT_DEPTH, height)])


def _distances_to_plank(
    points: Float[np.ndarray, "robots 2"], plank: Float[np.ndarray, " 3"]
) -> Float[np.ndarray, " robots"]:
    """Distance of each point to the plank's rectangle, 0 within it."""
    cos, sin = np.cos(plank[2]), np.sin(plank[2])
    local = (points - plank[:2]) @ np.array([[cos, -sin], [sin, cos]])
    beyond = np.abs(local) - np.array([world.PLANK_LENGTH / 2, world.PLANK_WIDTH / 2])
    return np.linalg.norm(np.maximum(beyond, 0.0), axis=-1)


def _off_limits(
    robots: Float[np.ndarray, "robots 2"], away: Float[np.ndarray, " robots"]
) -> Bool[np.ndarray, " robots"]:
    """Whose disks reach out of the workspace or, beside the plank, over the gap."""
    low = np.array([world.X_MIN, world.Y_MIN]) + world.ROBOT_RADIUS
    high = np.array([world.X_MAX, world.Y_MAX]) - world.ROBOT_RADIUS
    outside = ((robots < low) | (robots > high)).any(axis=-1)
    x = robots[:, 0]
    over_gap = (x > world.GAP_LEFT - world.ROBOT_RADIUS) & (
        x < world.GAP_RIGHT + world.ROBOT_RADIUS
    )
    return outside | (over_gap & (away > 0.0))
