"""What a policy is conditioned on, and the vectors lambda_i, pi_ij and c_i that the robots observe.

Source: paper, App. on Task 1 (representation, conditioning).
"""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from typing import Any, NamedTuple

import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Bool, Float

from .factors import TASK_SCALES, task_margins
from .motion import contact_velocity, rotate
from .world import (
    ANGULAR_SPEED,
    CENTRE_SIDE,
    COEFFICIENTS,
    GAP_LEFT,
    GAP_RIGHT,
    HORIZON,
    LINEAR_SPEED,
    MAX_ROBOTS,
    PLANK_LENGTH,
    ROBOT_GOALS_MIN,
    ROBOT_SPEED,
    X_MAX,
    X_MIN,
    Y_MAX,
    Y_MIN,
)

HALF_X, HALF_Y = (X_MAX - X_MIN) / 2, (Y_MAX - Y_MIN) / 2  # X and Y of the paper
OWN_SIZE, OTHER_SIZE, CONTACT_SIZE = 23, 8, 5 + 2 * HORIZON


@dataclass(frozen=True)
class TrialCondition:
    """One trial as a user states it; SI units, radians."""

    plank: tuple[float, float, float]
    goal: tuple[float, float, float]
    contacts: tuple[tuple[float, float], ...]  # in the plank's frame
    given: Mapping[str, Any] | None = field(
        default=None, compare=False
    )  # the JSON object it was read from

    def to_json(self) -> Mapping[str, Any]:
        """As it stands in a file."""
        if self.given is not None:
            return self.given
        pose = ("x", "y", "theta")
        return {
            "plank": dict(zip(pose, self.plank, strict=True)),
            "goal": dict(zip(pose, self.goal, strict=True)),
            "contacts": [list(r) for r in self.contacts],
        }


class Scales(NamedTuple):
    """Statistics of the training set by which the encoder, the conditions and the loss are scaled."""

    eta: tuple[float, ...] = (1.0,) * (3 * COEFFICIENTS)  # m/s, m/s, rad/s of each coefficient
    continuation_mean: tuple[float, ...] = (0.0,) * (2 * HORIZON)  # m/s
    continuation_std: tuple[float, ...] = (1.0,) * (2 * HORIZON)  # m/s
    contact: tuple[float, ...] = (1.0, 1.0)  # m/s, sigma_c
    twist: tuple[float, ...] = (1.0, 1.0, 1.0)  # m/s, m/s, rad/s, sigma_xi


class BridgeCondition(NamedTuple):
    """What is known before a policy is generated; arrays, for compiled programs."""

    plank: Float[Array, "... 3"]  # x, y, theta
    twist: Float[Array, "... 3"]  # current body twist
    goal: Float[Array, "... 3"]
    contacts: Float[Array, "... agents 2"]  # r_i, plank frame
    mask: Bool[Array, "... agents"]  # False: padding
    continuation: Float[Array, "... horizon 3"]  # body twists of the previous policy, shifted


class Observation(NamedTuple):
    """The condition chi as the robots observe it; zero for absent robots."""

    own: Float[Array, "agents 23"]  # lambda_i
    other: Float[Array, "agents agents 8"]  # pi_ij, [robot i, robot j]
    contact: Float[Array, "agents 45"]  # c_i


def to_arrays(conditions: Sequence[TrialCondition], agents: int) -> BridgeCondition:
    """Conditions at the start of their trials (at rest), padded to `agents` robots (float32)."""
    count = len(conditions)
    contacts = np.zeros((count, agents, 2), np.float32)
    mask = np.zeros((count, agents), bool)
    for k, condition in enumerate(conditions):
        contacts[k, : len(condition.contacts)] = condition.contacts
        mask[k, : len(condition.contacts)] = True
    plank, goal = (
        np.array([getattr(c, name) for c in conditions], np.float32).reshape(count, 3)
        for name in ("plank", "goal")
    )
    rest = np.zeros((count, 3), np.float32)
    ahead = np.zeros((count, HORIZON, 3), np.float32)
    return BridgeCondition(
        *(jnp.asarray(leaf) for leaf in (plank, rest, goal, contacts, mask, ahead))
    )


def padded_robots(robots: int) -> int:
    """Number of robots to which compiled programs are padded."""
    return 6 if robots <= 6 else MAX_ROBOTS


def centres(contacts: Float[Array, "agents 2"]) -> Float[Array, "agents 2"]:
    """Robots' centres in the plank's frame (m): disks that touch the plank at the contact points from outside."""
    side = jnp.where(contacts[:, 1] < 0, -CENTRE_SIDE, CENTRE_SIDE)
    return jnp.stack([contacts[:, 0], side], -1)


def _surroundings(plank: Float[Array, " 3"]) -> Float[Array, " 11"]:
    """e_B: the plank's orientation and its position in the workspace."""
    cos, sin = jnp.cos(plank[2]), jnp.sin(plank[2])
    edges_x = jnp.array([X_MIN, GAP_LEFT, GAP_RIGHT, ROBOT_GOALS_MIN, X_MAX])
    edges_y = jnp.array([Y_MIN, Y_MAX])
    return jnp.concatenate(
        [
            jnp.stack([cos, -sin, sin, cos]),
            (edges_x - plank[0]) / HALF_X,
            (edges_y - plank[1]) / HALF_Y,
        ]
    )


def _grounds(x: Float[Array, " agents"]) -> Float[Array, "agents 3"]:
    """o_i: whether the robot is on the initial side's ground, on the plank, or on the opposite side's ground."""
    left, right = x <= GAP_LEFT, x >= GAP_RIGHT
    return jnp.stack([left, ~(left | right), right], -1).astype(x.dtype)


def _contact_vectors(condition: BridgeCondition, scales: Scales) -> Float[Array, "agents 45"]:
    r = condition.contacts
    gap = rotate(-condition.plank[2], condition.goal[:2] - condition.plank[:2])
    turn = condition.goal[2] - condition.plank[2]
    turn = -(jnp.mod(-turn + jnp.pi, 2 * jnp.pi) - jnp.pi)  # in (-pi, pi]
    ahead = contact_velocity(condition.continuation[None], r[:, None])  # J(r_i) xi_bar_t
    standard = (ahead.reshape(r.shape[0], -1) - jnp.array(scales.continuation_mean)[None]) / (
        jnp.array(scales.continuation_std)[None]
    )
    # vec stacks columns: all x velocities, then all y velocities.
    stacked = standard.reshape(-1, HORIZON, 2).swapaxes(1, 2).reshape(r.shape[0], -1)
    shared = jnp.stack([gap[0] / PLANK_LENGTH, gap[1] / HALF_Y, turn / (jnp.pi / 3)])
    return jnp.concatenate(
        [
            (r[:, 0] / (PLANK_LENGTH / 2))[:, None],
            jnp.sign(r[:, 1])[:, None],
            jnp.broadcast_to(shared, (r.shape[0], 3)),
            stacked,
        ],
        axis=-1,
    )


def observe(condition: BridgeCondition, scales: Scales) -> Observation:
    """lambda_i, pi_ij and c_i of every robot of one trial."""
    place = centres(condition.contacts)  # R_B^T (p_i - p_B)
    velocity = contact_velocity(condition.twist[None], place)  # R_B^T v_i
    ground = _grounds(condition.plank[0] + rotate(condition.plank[2], place)[:, 0])
    agents, room = place.shape[0], jnp.array([HALF_X, HALF_Y])[None]
    bridged = jnp.all(task_margins(condition.plank)[: len(TASK_SCALES) - 2] >= 0)
    common = jnp.concatenate(
        [
            condition.twist[:2] / LINEAR_SPEED,
            condition.twist[2:] / ANGULAR_SPEED,
            bridged[None].astype(place.dtype),
            jnp.ones(1),  # a_i: every robot holds the plank while the bridge is built
            _surroundings(condition.plank),
        ]
    )
    shared = jnp.broadcast_to(common, (agents, common.shape[0]))
    own = jnp.concatenate([place / room, velocity / ROBOT_SPEED, ground, shared], axis=-1)
    other = jnp.concatenate(
        [
            (place[None, :] - place[:, None]) / room[None],
            (velocity[None, :] - velocity[:, None]) / ROBOT_SPEED,
            jnp.broadcast_to(ground[None], (agents, agents, 3)),
            jnp.ones((agents, agents, 1)),  # a_j
        ],
        axis=-1,
    )
    present = condition.mask[:, None]
    return Observation(
        jnp.where(present, own, 0.0),
        jnp.where(present[:, None] & present[None], other, 0.0),
        jnp.where(present, _contact_vectors(condition, scales), 0.0),
    )


def take(condition: BridgeCondition, index: Any) -> BridgeCondition:
    """Some trials of a batch."""
    return jax.tree.map(lambda leaf: leaf[index], condition)
