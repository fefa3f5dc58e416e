"""One policy for each trial of a batch, in one compiled program; its end checked in float64."""

from functools import partial
from typing import Any, NamedTuple

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Bool, Float, Int

from deggflow.blocks import blocks, map_blocks, padded_batch
from deggflow.certificate import GenerationRecord
from deggflow.generation import generate, refined_grid
from deggflow.guidance import AbstractGuidance, DecoupledGuidance, NoGuidance
from deggflow.recording import record
from deggflow.shapes import States
from deggflow.step_guard import StepGuard
from deggflow.trace import Summary, Trace

from .codec import decode_twists
from .condition import BridgeCondition, Scales, take
from .field import BridgeField
from .requirements import final_values
from .verdict import contact_speeds
from .world import AGENT_DIM, EXECUTED, MAX_ROBOTS

STEPS, POWER = 50, 1.0  # of the grid that policies are generated on
GUARD = StepGuard()


class Policies(NamedTuple):
    """Generated policies of a batch of trials."""

    twists: Float[np.ndarray, "trials horizon 3"]  # body twists, float64
    q_task: Float[np.ndarray, " trials"]
    bound: Float[np.ndarray, " trials"]  # beta_task(1)
    q_safe: Float[np.ndarray, " trials"]
    speed: Float[
        np.ndarray, "trials agents"
    ]  # largest of each contact point in executed actions, m/s
    summary: Summary  # of each generation; leaves with a leading axis of trials
    names: tuple[str, ...]  # of the requirements

    def record(self, trial: int, robots: int) -> GenerationRecord | None:
        """What happened in one generation, by the names of its robots; None if it was not guided."""
        if not self.names:
            return None
        made = jax.tree.map(lambda leaf: leaf[trial], self.summary)
        return record(made, self.names, [f"robot {k + 1}" for k in range(robots)])

    def infeasible(self, trial: int) -> Bool[np.ndarray, " agents"]:
        """Which robots had no input that met their rows, or no direction to act along, at some step."""
        infeasible = np.asarray(self.summary.infeasible_points[trial]).any(axis=0)
        return np.asarray(infeasible | (np.asarray(self.summary.qp_infeasible_points[trial]) > 0))


class Drawn(NamedTuple):
    """Generated states and what the guidance met with, as the compiled program hands them out."""

    z: States
    summary: Summary


def _drawn(
    field: BridgeField,
    guidance: AbstractGuidance,
    noise: Float[Array, "trials agents dim"],
    condition: BridgeCondition,
    grid: Float[Array, " points"],
    guard: StepGuard | None,
) -> Drawn:
    def one(z0: States, trial: BridgeCondition) -> Drawn:
        out = generate(
            field.under(trial), guidance, z0, trial, grid=grid, guard=guard, mask=trial.mask,
            keep_trace=False,
        )  # fmt: skip
        return Drawn(out.z, out.summary)

    return jax.vmap(one)(noise, condition)


_draw = eqx.filter_jit(_drawn)


@eqx.filter_jit
def _trace(
    field: BridgeField,
    guidance: AbstractGuidance,
    z0: States,
    condition: BridgeCondition,
    grid: Float[Array, " points"],
    guard: StepGuard | None,
) -> Trace:
    out = generate(
        field.under(condition), guidance, z0, condition, grid=grid, guard=guard, mask=condition.mask
    )
    assert out.trace is not None
    return out.trace


@partial(jax.jit, static_argnums=2)
def _end(
    z: Float[Array, "trials agents dim"], condition: BridgeCondition, scales: Scales
) -> tuple[Float[Array, "trials horizon 3"], Float[Array, "trials 3"]]:
    def one(
        z: States, trial: BridgeCondition
    ) -> tuple[Float[Array, "horizon 3"], Float[Array, " 3"]]:
        return decode_twists(z, trial, scales), final_values(z, trial, scales)

    return jax.vmap(one)(z, condition)


@jax.jit
def _noise(
    seed: Int[Array, ""],
    numbers: Int[Array, " trials"],
    policy: Int[Array, ""],
    draws: Int[Array, ""],
) -> Float[Array, "trials agents dim"]:
    root = jax.random.key(seed)

    def one(number: Int[Array, ""]) -> States:
        key = jax.random.fold_in(jax.random.fold_in(root, number), policy)
        return jax.random.normal(jax.random.fold_in(key, draws), (MAX_ROBOTS, AGENT_DIM))

    return jax.vmap(one)(numbers)


def initial_noise(
    seed: int, numbers: Int[np.ndarray, " trials"], policy: int, draw_number: int
) -> Float[np.ndarray, "trials agents dim"]:
    """z(0) by a trial's number in the run and the policy's number in the trial: N(0, I), whatever the guidance."""
    size = padded_batch(len(numbers))
    padded = np.resize(numbers, -(-len(numbers) // size) * size)
    return np.asarray(_noise(seed, padded, policy, draw_number))[: len(numbers)]


class PolicyGenerator:
    """Generates policies with one field and one guidance; compiled programs are kept between calls."""

    def __init__(
        self,
        field: BridgeField,
        guidance: AbstractGuidance | None = None,
        *,
        steps: int = STEPS,
        power: float = POWER,
        guard: StepGuard | None = GUARD,
    ) -> None:
        """Args: field: nominal field; guidance: `NoGuidance()` if None; steps, power: of `refined_grid`."""
        self.field, self.grid = field, refined_grid(steps, power)
        self.guidance = NoGuidance() if guidance is None else guidance
        self.guard = None if guidance is None else guard
        self._together = partial(_draw, field)
        # Of a few rows, laying out the weights is most of a product's work: as constants they are laid out once.
        self._alone = eqx.filter_jit(partial(_drawn, field))
        self._compiled: set[int] = set()

    def batch(
        self, noise: Float[np.ndarray, "trials agents dim"], condition: BridgeCondition
    ) -> Policies:
        """One policy for each trial, from given z(0).

        Args:
            noise: z(0), for at least as many robots as the condition has.
            condition: Of all trials; numpy arrays in float64, rounded for the generation.
        """
        agents, count = condition.mask.shape[1], len(noise)
        parts = map_blocks(
            lambda index: self._block(noise[index, :agents], take(condition, index)),
            blocks(count),
            compiled=agents in self._compiled,
        )
        self._compiled.add(agents)
        *leaves, summary = zip(*parts, strict=True)
        joined = [np.concatenate(leaf) for leaf in leaves]
        whole = jax.tree.map(lambda *leaf: np.concatenate(leaf), *summary)
        names = self.guidance.names if isinstance(self.guidance, DecoupledGuidance) else ()
        twists, q_task, bound, q_safe, speed = joined
        return Policies(twists, q_task, bound, q_safe, speed, whole, names)

    def draw(
        self, noise: Float[np.ndarray, "trials agents dim"], condition: BridgeCondition
    ) -> Drawn:
        """The compiled program alone, in float32, large batches in blocks: z(1) of every trial, nothing checked yet."""
        program = self._alone if len(noise) == 1 else self._together
        condition = jax.tree.map(np.asarray, condition)  # to pick from JAX's arrays takes programs

        def one(index: Int[np.ndarray, " trials"]) -> Drawn:
            given = noise[index], take(condition, index)
            return jax.block_until_ready(program(self.guidance, *given, self.grid, self.guard))

        parts = map_blocks(one, blocks(len(noise)), compiled=noise.shape[1] in self._compiled)
        return jax.tree.map(lambda *leaves: np.concatenate(leaves), *parts)

    def _block(
        self, noise: Float[np.ndarray, "trials agents dim"], condition: BridgeCondition
    ) -> tuple[Any, ...]:
        """A block of policies with their ends, padded to one of the sizes that programs are compiled for."""
        count = len(noise)
        index = np.resize(np.arange(count), padded_batch(count))
        noise, condition = noise[index], take(condition, index)
        single = jax.tree.map(_single, condition)
        drawn = self.draw(noise, single)
        with jax.enable_x64(True):
            z = jnp.asarray(np.asarray(drawn.z), jnp.float64)
            exact = jax.tree.map(jnp.asarray, condition)
            twists, values = (np.asarray(leaf) for leaf in _end(z, exact, self.field.scales))
        speed = (
            contact_speeds(twists[:, :EXECUTED], np.asarray(condition.contacts)) * condition.mask
        )
        summary = jax.tree.map(np.asarray, drawn.summary)
        found = twists, values[:, 0], values[:, 1], values[:, 2], speed, summary
        return jax.tree.map(lambda leaf: leaf[:count], found)

    def trace(self, z0: Float[np.ndarray, "agents dim"], condition: BridgeCondition) -> Trace:
        """The generation of one trial's policy step by step."""
        agents = condition.mask.shape[0]
        single = jax.tree.map(_single, condition)
        return _trace(
            self.field, self.guidance, jnp.asarray(z0[:agents]), single, self.grid, self.guard
        )


def _single(leaf: np.ndarray) -> np.ndarray:
    return leaf if leaf.dtype == bool else leaf.astype(np.float32)
