"""Conversion between generative states and motion policies: B-spline corrections of the continuation sequence.

Source: paper, App. on Task 1 (representation).
"""

from functools import cache

import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Bool, Float
from scipy.interpolate import BSpline

from deggflow.shapes import States

from .condition import BridgeCondition, Scales
from .motion import contact_jacobian, contact_velocity
from .world import COEFFICIENTS, EXECUTED, HORIZON

DEGREE = 3
BLENDED = 5  # first values of the continuation, which blend from the current motion


@cache
def spline_matrix() -> Float[np.ndarray, "horizon coefficients"]:
    """B_spl: clamped cubic B-splines at equal steps over the horizon."""
    inner = np.linspace(0.0, 1.0, COEFFICIENTS - DEGREE + 1)
    knots = np.concatenate([np.zeros(DEGREE), inner, np.ones(DEGREE)])
    points = np.linspace(0.0, 1.0, HORIZON)
    return BSpline.design_matrix(points, knots, DEGREE).toarray()


def _weights(
    contacts: Float[Array, "agents 2"], mask: Bool[Array, " agents"]
) -> tuple[Float[Array, "agents 3 3"], Float[Array, "3 3"]]:
    """M_i = J_i^T J_i (zero for absent robots) and the inverse of G = sum_i M_i."""
    jacobian = contact_jacobian(contacts)
    each = jnp.where(mask[:, None, None], jnp.einsum("nji,njk->nik", jacobian, jacobian), 0.0)
    return each, jnp.linalg.inv(jnp.sum(each, axis=0))


def team_shares(
    contacts: Float[Array, "agents 2"], mask: Bool[Array, " agents"]
) -> Float[Array, "agents 3 3"]:
    """G^-1 M_i: weights of the robots' coefficients in the team's twist; they add up to I."""
    each, inverse = _weights(contacts, mask)
    return jnp.einsum("ij,njk->nik", inverse, each)


def decode_twists(
    z: States, condition: BridgeCondition, scales: Scales
) -> Float[Array, "horizon 3"]:
    """Body twists xi_{B,t} of the policy."""
    eta = (z * jnp.array(scales.eta)[None]).reshape(-1, COEFFICIENTS, 3)
    shares = team_shares(condition.contacts, condition.mask)
    team = jnp.einsum("nij,nkj->ki", shares, eta)
    return condition.continuation + jnp.asarray(spline_matrix(), team.dtype) @ team


def executed_twists(
    z: States, condition: BridgeCondition, scales: Scales
) -> Float[Array, "executed 3"]:
    """Those of the executed actions, for guidance: by one matrix, which stays the same along a generation."""
    shares = team_shares(condition.contacts, condition.mask)
    splines = jnp.asarray(spline_matrix()[:EXECUTED], shares.dtype)
    eta = jnp.array(scales.eta, shares.dtype).reshape(COEFFICIENTS, 3)
    linear = jnp.einsum("tk,nij,kj->tinkj", splines, shares, eta).reshape(EXECUTED * 3, -1)
    return condition.continuation[:EXECUTED] + (linear @ z.reshape(-1)).reshape(EXECUTED, 3)


def decode(
    z: States, condition: BridgeCondition, scales: Scales
) -> Float[Array, "agents horizon 2"]:
    """The motion policy: velocities c_{i,t} of the contact points, in the plank's frame (m/s)."""
    twists = decode_twists(z, condition, scales)
    return contact_velocity(twists[None], condition.contacts[:, None])


def team_twist(
    velocities: Float[Array, "agents steps 2"],
    contacts: Float[Array, "agents 2"],
    mask: Bool[Array, " agents"],
) -> Float[Array, "steps 3"]:
    """The body twists that fit given contact-point velocities best, by least squares."""
    _, inverse = _weights(contacts, mask)
    pull = jnp.where(mask[:, None, None], contact_jacobian(contacts), 0.0)
    return jnp.einsum("ij,nkj,ntk->ti", inverse, pull, velocities)


def encode(
    velocities: Float[Array, "agents horizon 2"], condition: BridgeCondition, scales: Scales
) -> States:
    """The generative state of a motion policy: least squares, with the same coefficients for every robot.

    Inverse of `decode` on policies whose difference from the continuation lies in the splines' span.
    """
    twists = team_twist(velocities, condition.contacts, condition.mask)
    eta = spline_coefficients(twists - condition.continuation).reshape(-1)
    return jnp.broadcast_to(eta / jnp.array(scales.eta), (velocities.shape[0], eta.size))


def spline_coefficients(
    twists: Float[Array, "... horizon 3"],
) -> Float[Array, "... coefficients 3"]:
    """Coefficients of the splines nearest to a sequence, in least squares."""
    inverse = np.linalg.pinv(spline_matrix())
    return jnp.einsum("kt,...td->...kd", jnp.asarray(inverse), twists)


def continuation(
    previous: Float[Array, "... horizon 3"], current: Float[Array, "... 3"]
) -> Float[Array, "... horizon 3"]:
    """The remainder of the previous policy, shifted by the executed actions and blended from the current motion."""
    last = jnp.broadcast_to(previous[..., -1:, :], (*previous.shape[:-2], EXECUTED, 3))
    remainder = jnp.concatenate([previous[..., EXECUTED:, :], last], axis=-2)
    weight = jnp.minimum(jnp.arange(1, HORIZON + 1) / (BLENDED + 1), 1.0)
    weight = weight.reshape((1,) * (previous.ndim - 2) + (HORIZON, 1))
    return current[..., None, :] + weight * (remainder - current[..., None, :])
