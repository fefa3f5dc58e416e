"""Baseline: prioritised planning with the same denoiser, robots one after the other, as MMD does it.

Source: Shaoul et al., Multi-Robot Motion Planning with Diffusion Models (MMD, ICLR 2025; yoraish/mmd). Written anew: a
robot draws paths under soft costs, whose gradients move the expected path at every later step of the denoising; where the
best of its paths meets one of an earlier robot, that robot's place about that time becomes a constraint, and it draws again.
"""

from collections.abc import Callable
from dataclasses import dataclass
from typing import Any, NamedTuple

import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Bool, Float

from deggflow.flow import Field
from deggflow.shapes import Scalar

from .clearance import clearance, within
from .condition import APART, NOWHERE, FleetArrays, FleetCondition, padding, to_arrays
from .paths import BASIS, DIM, SCALES, WAYPOINTS, to_path
from .surroundings import surroundings

STEPS = 25  # of the denoising
BEGIN = 0.4  # tau from which costs act
PUSHES = 10  # gradient steps on the expected path, at each step of the denoising
RATE = 0.5  # of a gradient step
SMOOTH = 0.1  # weight of squared second differences
ROOM = 0.01  # map units, kept beyond what is required
AROUND = 2  # waypoints before and after a conflict that become constraints
ROUNDS = 20  # times that a robot draws with more constraints

Path = Float[Array, "64 2"]


@dataclass(frozen=True)
class Prioritised:
    """What prioritised planning found.

    Attributes:
        paths: One per robot, in float64.
        rounds: How often robots drew paths.
        evaluations: Of the field, those of a batch of paths counted once.
    """

    paths: Float[np.ndarray, "robots 64 2"]
    rounds: int
    evaluations: int


class Avoided(NamedTuple):
    """What a path keeps away from.

    Attributes:
        paths: Of all robots; far away where a robot has none yet.
        active: Waypoints at which they count.
    """

    paths: Float[Array | np.ndarray, "others 64 2"]
    active: Bool[Array | np.ndarray, "others 64"]


def _cost(path: Path, avoided: Avoided, c: FleetArrays) -> Scalar:
    """Soft costs: squared shortfalls of clearances, of distances to constraints and of the speed limit; roughness."""
    step = jnp.diff(path, axis=0)
    points = jnp.concatenate([path, path[:-1] + step / 2])
    distance, _, _ = surroundings(points[:, 0], points[:, 1], c)
    away = jnp.sqrt(jnp.sum((path[None] - avoided.paths) ** 2, axis=-1) + 1e-9)
    near = jnp.where(avoided.active, jnp.maximum(APART * c.radius + ROOM - away, 0.0), 0.0)
    fast = jnp.maximum(jnp.sqrt(jnp.sum(step**2, axis=-1) + 1e-12) - 0.95 * c.speed_limit, 0.0)
    close = jnp.maximum(c.radius + ROOM - distance, 0.0)
    bend = jnp.diff(path, n=2, axis=0)
    total = jnp.sum(near**2) + jnp.sum(close**2) + jnp.sum(fast**2) + SMOOTH * jnp.sum(bend**2)
    return total / 2


def _pushed(z: Float[Array, "1 dim"], avoided: Avoided, c: FleetArrays) -> Float[Array, "1 dim"]:
    """A state after gradient steps of the costs on its path; the ends stay."""
    path = to_path(z[0], c.start[0], c.goal[0])
    slope = jax.grad(_cost)
    path = jax.lax.fori_loop(
        0,
        PUSHES,
        lambda _, x: x - RATE * slope(x, avoided, c).at[jnp.array([0, -1])].set(0),
        path,
    )
    change = path - to_path(z[0], c.start[0], c.goal[0])
    modes = (jnp.asarray(BASIS.T, z.dtype) @ change) / jnp.asarray(SCALES, z.dtype)[:, None]
    return z + modes.reshape(1, DIM)


def denoiser(field: Field) -> Callable[..., Float[Array, "samples 64 2"]]:
    """The compiled program (noise, one robot's arrays, `Avoided`) -> paths, for `prioritised`."""

    def sample(z: Any, c: FleetArrays, avoided: Avoided) -> Path:
        def step(k: Any, z: Any) -> Any:
            tau = k / STEPS
            velocity = field(tau, z, c)
            end = z + (1 - tau) * velocity
            guided = jax.lax.cond(tau >= BEGIN, lambda e: _pushed(e, avoided, c), lambda e: e, end)
            return z + (guided - z) / (STEPS - k)

        end = jax.lax.fori_loop(0, STEPS, step, z)
        return to_path(end[0], c.start[0], c.goal[0])

    return jax.jit(jax.vmap(sample, (0, None, None)))


def _conflicts(
    path: Float[np.ndarray, "64 2"], others: Float[np.ndarray, "others 64 2"], least: float
) -> Bool[np.ndarray, "others 64"]:
    """Where a path comes too near to others between a waypoint and the next, in closed form."""
    gap = path[None] - others
    move = np.diff(gap, axis=1)
    square = np.maximum(np.sum(move**2, axis=-1), 1e-12)
    share = np.clip(-np.sum(gap[:, :-1] * move, axis=-1) / square, 0.0, 1.0)
    nearest = np.linalg.norm(gap[:, :-1] + share[..., None] * move, axis=-1) < least
    return np.pad(nearest, ((0, 0), (0, 1)))


def prioritised(
    program: Callable[..., Float[Array, "samples 64 2"]],
    condition: FleetCondition,
    noise: Float[np.ndarray, "robots samples dim"],
) -> Prioritised:
    """Plans robots in their order.

    Args:
        program: Of `denoiser`.
        condition: The problem.
        noise: z(0) of several paths of each robot.
    """
    count, least = len(condition.robots), APART * condition.radius
    whole = to_arrays([condition], padding([condition]))
    of_map = jax.tree.map(lambda leaf: jnp.asarray(leaf[0]), whole)
    others, rounds = np.full((count, WAYPOINTS, 2), NOWHERE, np.float32), 0
    placed: list[Float[np.ndarray, "64 2"]] = []
    for robot in range(count):
        own = slice(robot, robot + 1)
        arrays = of_map._replace(
            mask=of_map.mask[own], start=of_map.start[own], goal=of_map.goal[own]
        )
        active = np.zeros((count, WAYPOINTS), bool)
        best, fewest = None, np.inf
        for _ in range(ROUNDS):
            rounds += 1
            drawn = np.asarray(
                program(noise[robot][:, None], arrays, Avoided(others, active)), float
            )
            drawn[:, 0], drawn[:, -1] = condition.starts[robot], condition.goals[robot]
            earlier = np.array(placed).reshape(-1, WAYPOINTS, 2)
            found = [_conflicts(path, earlier, least) for path in drawn]
            bad = np.array([each.sum() for each in found]) + 10.0 * _faults(drawn, condition)
            pick = int(np.argmin(bad))
            if bad[pick] < fewest:
                best, fewest = drawn[pick], bad[pick]
            if not found[pick].any():
                break
            for other, at in zip(*np.nonzero(found[pick]), strict=True):
                active[other, max(at - AROUND, 0) : at + AROUND + 2] = True
        assert best is not None
        placed.append(best)
        others[robot] = best
    return Prioritised(np.array(placed), rounds, rounds * STEPS)


def _faults(
    paths: Float[np.ndarray, "samples 64 2"], condition: FleetCondition
) -> Float[np.ndarray, " samples"]:
    """Waypoints of each path that are not clear, and steps beyond the speed limit."""
    clear = clearance(condition.floor, paths) >= condition.radius
    clear &= within(condition.floor, paths, condition.radius)
    steps = np.linalg.norm(np.diff(paths, axis=1), axis=-1)
    return (~clear).sum(-1) + (steps > condition.speed_limit).sum(-1).astype(float)
