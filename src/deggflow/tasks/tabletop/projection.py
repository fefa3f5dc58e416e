"""Scenes near given ones that satisfy their requirements, by a local solver: estimates of the distance from above."""

from collections.abc import Sequence

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float
from scipy.optimize import nnls

from .baselines import flat_margins
from .codec import decode_exactly
from .condition import SceneCondition, TabletopCondition, padded_size, to_arrays
from .verdict import judge

STEPS = 30
DAMPED = 12  # steps after which only half of each is taken, as kinks make full ones alternate
NEAR = 0.15  # m, margins that a step considers
SLACK = 0.01  # in z per metre of a row that can't be met
SOLVABLE = 1e-7  # residual of the least-squares problem below which its rows contradict each other
AHEAD = 2e-6  # m, least margin that a step aims at: float32 margins have errors of 1e-7

Scenes = Float[np.ndarray, "scenes objects 3"]


@eqx.filter_jit
def _linearised(
    z: Float[Array, "scenes agents 3"], condition: TabletopCondition
) -> tuple[Float[Array, "scenes constraints"], Float[Array, "scenes constraints agents 3"]]:
    def one(z: Float[Array, "agents 3"], condition: TabletopCondition) -> tuple[Array, Array]:
        return flat_margins(z, condition), jax.jacfwd(flat_margins)(z, condition)

    return jax.vmap(one)(z, condition)


def project(conditions: Sequence[SceneCondition], target: Scenes, start: Scenes) -> Scenes:
    """For each scene the nearest one to `target` found that the verdict accepts; NaN if there was none.

    Sequential quadratic programming: each step goes to the point nearest to the target at which the margins, linearised
    at the present point, hold. It ends in a local minimum at best, so the distances are upper estimates.

    Args:
        conditions: Of the scenes.
        target: States z to which the distance counts.
        start: Where the steps begin; also considered itself.
    """
    scenes, objects, _ = target.shape
    agents = padded_size(objects)
    arrays = jax.tree.map(jnp.asarray, to_arrays(conditions, agents))
    best, least = np.full(target.shape, np.nan), np.full(scenes, np.inf)
    z = start.astype(np.float64)
    for step in range(STEPS + 1):
        poses = [decode_exactly(one, c) for one, c in zip(z, conditions, strict=True)]
        feasible = np.array([verdict.satisfied for verdict in judge(conditions, poses)])
        square = np.sum((z - target) ** 2, axis=(1, 2))
        better = feasible & (square < least)
        best[better], least[better] = z[better], square[better]
        padded = np.zeros((scenes, agents, 3), np.float32)
        padded[:, :objects] = z
        margin, slope = (
            np.asarray(each, np.float64) for each in _linearised(jnp.asarray(padded), arrays)
        )
        slope = slope[:, :, :objects].reshape(*margin.shape, -1)
        share = 1.0 if step < DAMPED else 0.5
        for k in range(scenes):
            ahead = _nearest(margin[k], slope[k], z[k].ravel(), target[k].ravel())
            z[k] += share * (ahead.reshape(objects, 3) - z[k])
    return best


def _nearest(
    margin: Float[np.ndarray, " constraints"],
    slope: Float[np.ndarray, "constraints size"],
    z: Float[np.ndarray, " size"],
    target: Float[np.ndarray, " size"],
) -> Float[np.ndarray, " size"]:
    """The point nearest to the target at which the linearised margins hold, or hold least badly."""
    rows = margin < NEAR
    least = AHEAD - margin[rows] - slope[rows] @ (target - z)
    step = _shortest(slope[rows], least)
    if step is None:  # contradictory: each row has slack of its own
        step = _shortest(np.hstack([slope[rows], SLACK * np.eye(len(least))]), least)
    return z if step is None else target + step[: len(z)]


def _shortest(
    rows: Float[np.ndarray, "rows size"], least: Float[np.ndarray, " rows"]
) -> Float[np.ndarray, " size"] | None:
    """The shortest x with rows x >= least; None if there is none, or if the solver fails.

    Source: Lawson and Hanson, Solving Least Squares Problems, chapter 23 (LDP).
    """
    goal = np.append(np.zeros(rows.shape[1]), 1.0)
    matrix = np.vstack([rows.T, least])
    try:
        residual = goal - matrix @ nnls(matrix, goal)[0]
    except RuntimeError:  # too many iterations
        return None
    return -residual[:-1] / residual[-1] if residual[-1] > SOLVABLE else None
