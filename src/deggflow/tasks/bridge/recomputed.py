"""Factors and speeds of a policy's record, recomputed in NumPy from poses and twists (paper, App. on Task 1).

Shares only the dimensions in `world` with the factors that guide and judge the generation.
"""

import numpy as np
from jaxtyping import Float

from . import world

PROGRESS = 0.05  # by which a policy must lower q_task
_ROUNDED = 1e-6  # epsilon of the smooth absolute value
_TASK, _SAFE = 80.0, 60.0  # sharpness of both factors
_WIDE, _NARROW, _CLOSE = 0.55, 0.2, 0.1  # m, scales of margins: of support, of the rest, of safety
_PLANK_ROOM, _ROBOT_ROOM = 0.2, world.ROBOT_RADIUS + 0.1  # m
_EITHER = 0.02  # m, width of the smooth maximum of the two supports
_HINGE = 0.02  # m/s, delta of a speed limit

Poses = Float[np.ndarray, "poses 3"]
Twists = Float[np.ndarray, "actions 3"]
Contacts = Float[np.ndarray, "robots 2"]


def _extents(theta: Float[np.ndarray, "*_"]) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """The plank's extent from its centre along x and y (m), and the smoothed |cos|."""
    cos = np.hypot(np.cos(theta), _ROUNDED)
    sin = np.hypot(np.sin(theta), _ROUNDED)
    along, across = world.PLANK_LENGTH / 2, world.PLANK_WIDTH / 2
    return along * cos + across * sin, along * sin + across * cos, cos


def q_task(poses: Poses) -> Float[np.ndarray, " poses"]:
    """The task factor at each pose."""
    x, y, theta = poses.T
    reach, side, cos = _extents(theta)
    way = (world.PLANK_LENGTH / 2 - world.ROBOT_RADIUS - world.END_CLEARANCE) * cos
    ratios = [
        (world.GAP_LEFT - (x - reach) - world.SUPPORT) / _WIDE,
        ((x + reach) - world.GAP_RIGHT - world.SUPPORT) / _WIDE,
        (world.GAP_LEFT - (x - way) - world.CORRIDOR) / _NARROW,
        ((x + way) - world.GAP_RIGHT - world.CORRIDOR) / _NARROW,
        (world.Y_MAX - (y + side)) / _NARROW,
        ((y - side) - world.Y_MIN) / _NARROW,
    ]
    return np.asarray(np.logaddexp.reduce(-_TASK * np.array(ratios), axis=0) / _TASK)


def q_safe(poses: Poses, contacts: Contacts) -> float:
    """The safety factor of a path along these poses; additional poses never lower it."""
    x, y, theta = poses.T
    reach, side, _ = _extents(theta)
    left = world.GAP_LEFT - (x - reach) - world.SUPPORT
    right = (x + reach) - world.GAP_RIGHT - world.SUPPORT
    support = (left + right + np.hypot(left - right, _EITHER) - _EITHER) / 2
    aside = np.where(contacts[:, 1] < 0, -world.CENTRE_SIDE, world.CENTRE_SIDE)
    centres = contacts[:, 0] + 1j * aside
    place = (x + 1j * y)[:, None] + np.exp(1j * theta)[:, None] * centres
    margins = [
        *(world.Y_MAX - _PLANK_ROOM - (y + side), (y - side) - _PLANK_ROOM - world.Y_MIN, support),
        *(world.GAP_LEFT - _ROBOT_ROOM - place.real).T,
        *(world.Y_MAX - _ROBOT_ROOM - place.imag).T,
        *(place.imag - _ROBOT_ROOM - world.Y_MIN).T,
    ]
    exponents = -_SAFE * np.concatenate(margins) / _CLOSE
    return float(np.logaddexp.reduce(exponents) / _SAFE)


def speeds(twists: Twists, contacts: Contacts) -> Float[np.ndarray, "actions robots"]:
    """Speed of every contact point in every action, m/s."""
    v, turn = twists[:, :1] + 1j * twists[:, 1:2], 1j * twists[:, 2:]
    return np.abs(v + turn * (contacts[:, 0] + 1j * contacts[:, 1]))


def speed_violation(twists: Twists, contacts: Contacts, limit: float) -> float:
    """V of a private speed limit (m/s) on the contact points: half the sum of squared hinges of each action and robot."""
    room = (limit**2 - speeds(twists, contacts) ** 2) / (2 * limit)
    return float(np.sum(np.maximum(_HINGE - room, 0.0) ** 2) / 2)
