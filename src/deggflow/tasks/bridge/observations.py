"""The robots' observations and the factors in NumPy, for one moment at a time and without compilation.

The values are those of `condition.observe` and `factors`; a test compares them.
"""

import math
from typing import NamedTuple

import numpy as np
from jaxtyping import Float

from .condition import CONTACT_SIZE, HALF_X, HALF_Y, OTHER_SIZE, OWN_SIZE, Scales
from .factors import (
    EITHER_SIDE,
    EPSILON,
    PLANK_BUFFER,
    ROBOT_BUFFER,
    SAFE_SCALE,
    SAFE_SHARPNESS,
    TASK_SCALES,
    TASK_SHARPNESS,
    plank_margins,
)
from .verdict import robot_centres
from .world import (
    ANGULAR_SPEED,
    GAP_LEFT,
    GAP_RIGHT,
    HORIZON,
    LINEAR_SPEED,
    PLANK_LENGTH,
    PLANK_WIDTH,
    ROBOT_GOALS_MIN,
    ROBOT_RADIUS,
    ROBOT_SPEED,
    SUPPORT,
    X_MAX,
    X_MIN,
    Y_MAX,
    Y_MIN,
)

_ROOM = ROBOT_RADIUS + ROBOT_BUFFER  # m
_SPEEDS = np.array([LINEAR_SPEED, LINEAR_SPEED, ANGULAR_SPEED])


class ObservationParts(NamedTuple):
    """Positions of the paper's vectors in a robot's observation."""

    own: slice  # lambda_i, 23
    other: slice  # pi_ij of the other robots in the order of their numbers, 8 each
    contact: slice  # c_i, 45

    @classmethod
    def of(cls, robots: int) -> "ObservationParts":
        """For a team of so many robots."""
        ends = OWN_SIZE, OWN_SIZE + OTHER_SIZE * (robots - 1)
        return cls(slice(0, ends[0]), slice(*ends), slice(ends[1], ends[1] + CONTACT_SIZE))


def _soft_supports(theta: float) -> tuple[float, float, float]:
    """|cos| of the angle, and the plank's extent from its centre along x and y (m), smoothed as in `factors`."""
    cos, sin = math.hypot(math.cos(theta), EPSILON), math.hypot(math.sin(theta), EPSILON)
    along = (PLANK_LENGTH * cos + PLANK_WIDTH * sin) / 2
    return cos, along, (PLANK_LENGTH * sin + PLANK_WIDTH * cos) / 2


def _task_margins(pose: Float[np.ndarray, " 3"]) -> list[float]:
    x, y, theta = pose.tolist()
    cos, reach, side = _soft_supports(theta)
    return plank_margins(x, y, (reach, side), cos)


def _largest(values: Float[np.ndarray, " values"], sharpness: float) -> float:
    """Smooth maximum (log-sum-exp)."""
    top = values.max()
    return float(top + math.log(np.exp(sharpness * (values - top)).sum()) / sharpness)


def task_value(pose: Float[np.ndarray, " 3"]) -> float:
    """q_task at a pose of the plank; at most 0 only where it bridges the gap inside the workspace."""
    return _largest(-np.array(_task_margins(pose)) / TASK_SCALES, TASK_SHARPNESS)


def safe_value(pose: Float[np.ndarray, " 3"], places: Float[np.ndarray, "robots 2"]) -> float:
    """q_safe at a pose of the plank and the robots' centres there (world, m); at most 0 only where safe."""
    x, y, theta = pose.tolist()
    _, reach, side = _soft_supports(theta)
    before, beyond = GAP_LEFT - x + reach - SUPPORT, x + reach - GAP_RIGHT - SUPPORT
    support = (before + beyond + math.hypot(before - beyond, EITHER_SIDE) - EITHER_SIDE) / 2
    plank = [Y_MAX - PLANK_BUFFER - y - side, y - side - PLANK_BUFFER - Y_MIN, support]
    at_x, at_y = places[:, 0], places[:, 1]
    clearances = np.concatenate(
        [plank, GAP_LEFT - _ROOM - at_x, Y_MAX - _ROOM - at_y, at_y - _ROOM - Y_MIN]
    )
    return _largest(-clearances / SAFE_SCALE, SAFE_SHARPNESS)


def contact_map(points: Float[np.ndarray, "points 2"]) -> Float[np.ndarray, "components 3"]:
    """J_B of points in the plank's frame, stacked: `contact_map(r) @ twist` are their velocities."""
    out = np.zeros((len(points), 2, 3))
    out[:, 0, 0] = out[:, 1, 1] = 1.0
    out[:, 0, 2], out[:, 1, 2] = -points[:, 1], points[:, 0]
    return out.reshape(-1, 3)


class Observations:
    """lambda_i, pi_ij and c_i of every robot of one trial; constant parts are computed once."""

    def __init__(
        self,
        contacts: Float[np.ndarray, "robots 2"],
        goal: Float[np.ndarray, " 3"],
        scales: Scales,
    ) -> None:
        """Args: contacts: plank frame (m); goal: pose of the plank; scales: of the continuation."""
        robots = len(contacts)
        self.goal, self.centres = goal, robot_centres(contacts.tolist())
        self.others = np.array([[j for j in range(robots) if j != i] for i in range(robots)])
        self._of_centres, self._of_contacts = contact_map(self.centres), contact_map(contacts)
        mean, std = (
            np.array(values).reshape(HORIZON, 2).T
            for values in (scales.continuation_mean, scales.continuation_std)
        )
        # Standardised velocities of the continuation, x before y, are (map @ ahead - mean) / std.
        self._mean, self._std = mean, std
        self._parts = ObservationParts.of(robots)
        self._blank = np.zeros((robots, self._parts.contact.stop))
        room = np.array([HALF_X, HALF_Y])
        self._blank[:, 0:2] = self.centres / room
        self._blank[:, 11] = 1.0  # a_i
        pairs = self._pairs(self._blank)
        pairs[..., 0:2] = (self.centres[self.others] - self.centres[:, None]) / room
        pairs[..., 7] = 1.0  # a_j
        contact = self._blank[:, self._parts.contact]
        contact[:, 0], contact[:, 1] = contacts[:, 0] / (PLANK_LENGTH / 2), np.sign(contacts[:, 1])

    def _pairs(
        self, rows: Float[np.ndarray, "robots entries"]
    ) -> Float[np.ndarray, "robots others 8"]:
        """A view of the rows' pi_ij."""
        return rows[:, self._parts.other].reshape(len(rows), -1, OTHER_SIZE)

    def places(self, pose: Float[np.ndarray, " 3"]) -> Float[np.ndarray, "robots 2"]:
        """The robots' centres in the world (m)."""
        cos, sin = math.cos(pose[2]), math.sin(pose[2])
        return pose[:2] + self.centres @ np.array([[cos, sin], [-sin, cos]])

    def __call__(
        self,
        pose: Float[np.ndarray, " 3"],
        twist: Float[np.ndarray, " 3"],
        ahead: Float[np.ndarray, "horizon 3"],
    ) -> Float[np.ndarray, "robots entries"]:
        """One row per robot, in the order of `ObservationParts`.

        Args:
            pose: Of the plank.
            twist: Of the last action.
            ahead: The continuation, body twists.
        """
        rows, robots = self._blank.copy(), len(self.centres)
        velocity = (self._of_centres @ twist).reshape(robots, 2) / ROBOT_SPEED
        x = self.places(pose)[:, 0]
        left, right = x <= GAP_LEFT, x >= GAP_RIGHT
        ground = np.array([left, ~(left | right), right], np.float64).T
        rows[:, 2:4], rows[:, 4:7] = velocity, ground
        rows[:, 7:11] = [
            *(twist / _SPEEDS).tolist(),
            min(_task_margins(pose)[:4]) >= 0,
        ]
        rows[:, 12:OWN_SIZE] = _surroundings(pose)
        pairs = self._pairs(rows)
        pairs[..., 2:4] = velocity[self.others] - velocity[:, None]
        pairs[..., 4:7] = ground[self.others]
        contact = rows[:, self._parts.contact]
        contact[:, 2:5] = _to_goal(pose, self.goal)
        velocities = (self._of_contacts @ ahead.T).reshape(robots, 2, HORIZON)
        contact[:, 5:] = ((velocities - self._mean) / self._std).reshape(robots, -1)
        return rows


def _surroundings(pose: Float[np.ndarray, " 3"]) -> list[float]:
    """e_B: the plank's orientation and its position in the workspace."""
    x, y, theta = pose.tolist()
    cos, sin = math.cos(theta), math.sin(theta)
    edges = (X_MIN, GAP_LEFT, GAP_RIGHT, ROBOT_GOALS_MIN, X_MAX)
    along, across = (
        [(edge - x) / HALF_X for edge in edges],
        [(e - y) / HALF_Y for e in (Y_MIN, Y_MAX)],
    )
    return [cos, -sin, sin, cos, *along, *across]


def _to_goal(pose: Float[np.ndarray, " 3"], goal: Float[np.ndarray, " 3"]) -> list[float]:
    """The goal seen from the plank, as in c_i."""
    dx, dy, turn = (goal - pose).tolist()
    cos, sin = math.cos(pose[2]), math.sin(pose[2])
    turn = -((-turn + math.pi) % (2 * math.pi) - math.pi)  # in (-pi, pi]
    ahead, aside = cos * dx + sin * dy, cos * dy - sin * dx
    return [ahead / PLANK_LENGTH, aside / HALF_Y, turn / (math.pi / 3)]
