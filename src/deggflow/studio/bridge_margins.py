"""Where and when a trial comes closest to each of its failures."""

from typing import Any

import numpy as np
from jaxtyping import Float

from deggflow.tasks.bridge import world
from deggflow.tasks.bridge.arcs import moved
from deggflow.tasks.bridge.trial import Trial
from deggflow.tasks.bridge.verdict import corners, decisive_times, margins, robot_places

_LOW = np.array([world.X_MIN, world.Y_MIN])
_HIGH = np.array([world.X_MAX, world.Y_MAX])

Point = Float[np.ndarray, " 2"]
Gap = tuple[Point, Point]


def least_margins(trial: Trial) -> list[dict[str, Any]]:
    """The least distance to each kind of failure over the whole trial, the least of all first.

    Returns:
        Rows with "name", "margin" (m, negative where the trial fails), "time" (s) and "gap": the two points whose
        distance the margin is.
    """
    starts, twists = trial.poses[:-1], trial.twists
    times = np.zeros(1)
    poses = trial.poses[:1]
    if len(twists):
        within = decisive_times(starts, twists, trial.condition.contacts)
        on_the_way = moved(starts[:, None], twists[:, None], within)
        poses = np.concatenate([poses, on_the_way.reshape(-1, 3)])
        begun = world.DT * np.arange(len(twists))[:, None]
        times = np.concatenate([times, (begun + within).ravel()])
    found = margins(poses, trial.condition.contacts)
    kinds: list[tuple[str, Float[np.ndarray, " poses"], Any]] = [
        ("plank to the wall", found.plank, _plank_to_wall),
        ("plank's support", found.support, _support),
    ]
    for robot in range(len(trial.condition.contacts)):
        kinds += [
            (f"robot {robot + 1} to the wall", found.wall[:, robot], _to_wall(robot)),
            (f"robot {robot + 1} to the gap", found.gap[:, robot], _to_gap(robot)),
        ]
    rows = []
    for name, distances, gap in kinds:
        at = int(np.argmin(distances))
        robots = robot_places(poses[at], trial.condition.contacts)
        ends = gap(corners(poses[at]), robots)
        rows.append(
            {
                "name": name,
                "margin": float(distances[at]),
                "time": float(times[at]),
                "gap": np.round(ends, 5).tolist(),
            }
        )
    return sorted(rows, key=lambda row: row["margin"])


def _plank_to_wall(plank: Float[np.ndarray, "corners 2"], robots: Any) -> Gap:
    away = np.stack([plank - _LOW, _HIGH - plank])
    side, corner, axis = np.unravel_index(int(np.argmin(away)), away.shape)
    return _along(plank[corner], int(axis), (_LOW, _HIGH)[side][axis])


def _support(plank: Float[np.ndarray, "corners 2"], robots: Any) -> Gap:
    first, last = plank[plank[:, 0].argmin()], plank[plank[:, 0].argmax()]
    if world.GAP_LEFT - first[0] > last[0] - world.GAP_RIGHT:
        return _along(first, 0, world.GAP_LEFT - world.SUPPORT)
    return _along(last, 0, world.GAP_RIGHT + world.SUPPORT)


def _to_wall(robot: int) -> Any:
    def gap(plank: Any, robots: Float[np.ndarray, "robots 2"]) -> Gap:
        away = np.stack([robots[robot] - _LOW, _HIGH - robots[robot]])
        side, axis = np.unravel_index(int(np.argmin(away)), away.shape)
        edge = robots[robot].copy()
        edge[axis] += (-1, 1)[side] * world.ROBOT_RADIUS
        return _along(edge, int(axis), (_LOW, _HIGH)[side][axis])

    return gap


def _to_gap(robot: int) -> Any:
    def gap(plank: Any, robots: Float[np.ndarray, "robots 2"]) -> Gap:
        x, y = robots[robot]
        left = world.GAP_LEFT - x > x - world.GAP_RIGHT
        edge = x + (world.ROBOT_RADIUS if left else -world.ROBOT_RADIUS)
        return _along(np.array([edge, y]), 0, world.GAP_LEFT if left else world.GAP_RIGHT)

    return gap


def _along(point: Point, axis: int, to: float) -> Gap:
    """The point, and the same with another coordinate along an axis."""
    other = point.copy()
    other[axis] = to
    return point, other
