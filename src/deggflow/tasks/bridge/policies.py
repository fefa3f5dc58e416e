"""One policy for each trial of a batch, in one compiled program; its end checked in float64."""

from dataclasses import replace
from functools import partial
from typing import Any, NamedTuple

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Bool, Float, Int

from deggflow.blocks import map_padded
from deggflow.certificate import GenerationRecord
from deggflow.drift import AbstractDrift, AfterPrediction, ExtrapolatedEndpoint
from deggflow.generation import Generation, generate, refined_grid
from deggflow.guidance import AbstractGuidance, DecoupledGuidance, NoGuidance
from deggflow.recording import lost_agents, record
from deggflow.sampler import Sampler, numbered_noise
from deggflow.shapes import States
from deggflow.step_guard import StepGuard
from deggflow.task import FieldOptions
from deggflow.trace import Summary, Trace

from .codec import decode_twists
from .condition import BridgeCondition, Scales, take
from .field import BridgeField
from .options import BridgeFieldOptions
from .requirements import final_values
from .verdict import contact_speeds
from .world import AGENT_DIM, EXECUTED, MAX_ROBOTS

STEPS, POWER = 50, 1.0  # of the grid that policies are generated on
GUARD = StepGuard()
EVALUATIONS_POWER = 1.5  # of the grid on which the field is evaluated


def few_evaluations(options: FieldOptions) -> AbstractDrift:
    """The drift that options ask for; docs/bridge.md measures the choices."""
    drift = ExtrapolatedEndpoint(options.evaluations, power=EVALUATIONS_POWER)
    return AfterPrediction(drift) if options.guidance_phase == "after" else drift


def default_drift(steps: int) -> AbstractDrift:
    """That of the commands, with at most as many evaluations as steps."""
    evaluations = min(BridgeFieldOptions.evaluations, steps)
    return few_evaluations(BridgeFieldOptions(evaluations))


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
    stops: Float[np.ndarray, "trials agents"] | None = None  # tau at which robots were lost

    def record(self, trial: int, robots: int) -> GenerationRecord | None:
        """What happened in one generation, by the names of its robots; None if it was not guided."""
        if not self.names:
            return None
        summary = jax.tree.map(lambda leaf: leaf[trial], self.summary)
        labels = [f"robot {k + 1}" for k in range(robots)]
        made = record(summary, self.names, labels)
        if self.stops is None:
            return made
        return replace(made, lost=lost_agents(self.stops[trial], labels))

    def infeasible(self, trial: int) -> Bool[np.ndarray, " agents"]:
        """Which robots had no input that met their rows, or no direction to act along, at some step."""
        infeasible = np.asarray(self.summary.infeasible_points[trial]).any(axis=0)
        return np.asarray(infeasible | (np.asarray(self.summary.qp_infeasible_points[trial]) > 0))


def _generation(
    field: BridgeField,
    guidance: AbstractGuidance,
    z0: States,
    condition: BridgeCondition,
    grid: Float[Array, " points"],
    drift: AbstractDrift,
    guard: StepGuard | None,
    keep_trace: bool,
    keep_path: bool = False,
) -> Generation:
    return generate(
        field.under(condition), guidance, z0, condition, grid=grid, drift=drift, guard=guard,
        mask=condition.mask, keep_trace=keep_trace, keep_path=keep_path,
    )  # fmt: skip


_compiled_generation = eqx.filter_jit(_generation)


def _generations(
    field: BridgeField,
    guidance: AbstractGuidance,
    noise: Float[Array, "trials agents dim"],
    condition: BridgeCondition,
    grid: Float[Array, " points"],
    drift: AbstractDrift,
    guard: StepGuard | None,
    keep_trace: bool,
) -> Generation:
    def one(z0: States, trial: BridgeCondition) -> Generation:
        return _generation(field, guidance, z0, trial, grid, drift, guard, keep_trace)

    return jax.vmap(one)(noise, condition)


@partial(jax.jit, static_argnums=2)
def _end(
    z: Float[Array, "trials agents dim"], condition: BridgeCondition, scales: Scales
) -> tuple[Float[Array, "trials horizon 3"], Float[Array, "trials 3"]]:
    def one(
        z: States, trial: BridgeCondition
    ) -> tuple[Float[Array, "horizon 3"], Float[Array, " 3"]]:
        return decode_twists(z, trial, scales), final_values(z, trial, scales)

    return jax.vmap(one)(z, condition)


def initial_noise(
    seed: int, numbers: Int[np.ndarray, " trials"], policy: int, draw_number: int
) -> Float[np.ndarray, "trials agents dim"]:
    """z(0) by a trial's number in the run and the policy's number in the trial: N(0, I), whatever the guidance."""
    shape = MAX_ROBOTS, AGENT_DIM
    return numbered_noise(seed, numbers, policy, draw_number, shape=shape)


class PolicyGenerator:
    """Generates policies with one field and one guidance; compiled programs are kept between calls."""

    def __init__(
        self,
        field: BridgeField,
        guidance: AbstractGuidance | None = None,
        *,
        steps: int = STEPS,
        power: float = POWER,
        drift: AbstractDrift | None = None,
        guard: StepGuard | None = GUARD,
    ) -> None:
        """Args: field: nominal field; guidance: `NoGuidance()` if None; steps, power: of `refined_grid`; drift: of `generate`, 12 evaluations of the field if None; guard: of `generate`."""
        self.field, self.grid = field, refined_grid(steps, power)
        drift = default_drift(steps) if drift is None else drift
        self.drift = drift.nominal if guidance is None else drift
        self.guidance = NoGuidance() if guidance is None else guidance
        self.guard = None if guidance is None else guard
        self._sampler = Sampler(field, self.grid, self.guard, _generations, drift=self.drift)
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
        twists, q_task, bound, q_safe, speed, summary = map_padded(
            lambda rows: self._block(noise[rows, :agents], take(condition, rows)),
            count,
            compiled=agents in self._compiled,
        )
        self._compiled.add(agents)
        names = self.guidance.names if isinstance(self.guidance, DecoupledGuidance) else ()
        return Policies(twists, q_task, bound, q_safe, speed, summary, names)

    def draw(
        self, noise: Float[np.ndarray, "trials agents dim"], condition: BridgeCondition
    ) -> Generation:
        """The compiled program alone, in float32, large batches in blocks: z(1) of every trial, nothing checked yet."""
        return self._sampler.draw(self.guidance, noise, condition)

    def _block(
        self, noise: Float[np.ndarray, "trials agents dim"], condition: BridgeCondition
    ) -> tuple[Any, ...]:
        """A block of policies with their ends."""
        return self._ends(self.draw(noise, rounded(condition)), condition)

    def finished(self, generation: Generation, condition: BridgeCondition) -> Policies:
        """Policies that were generated elsewhere, with their ends.

        Args:
            generation: Of all trials, as numpy arrays.
            condition: Of all trials; numpy arrays in float64.
        """
        assert isinstance(self.guidance, DecoupledGuidance)
        twists, q_task, bound, q_safe, speed, summary = self._ends(generation, condition)
        return Policies(twists, q_task, bound, q_safe, speed, summary, self.guidance.names)

    def _ends(self, policies: Generation, condition: BridgeCondition) -> tuple[Any, ...]:
        with jax.enable_x64(True):
            z = jnp.asarray(policies.z, jnp.float64)
            exact = jax.tree.map(jnp.asarray, condition)
            twists, values = (np.asarray(leaf) for leaf in _end(z, exact, self.field.scales))
        speed = (
            contact_speeds(twists[:, :EXECUTED], np.asarray(condition.contacts)) * condition.mask
        )
        return twists, values[:, 0], values[:, 1], values[:, 2], speed, policies.summary

    def trace(self, z0: Float[np.ndarray, "agents dim"], condition: BridgeCondition) -> Trace:
        """The generation of one trial's policy step by step."""
        trace = self._whole(z0, condition, keep_trace=True).trace
        assert trace is not None
        return trace

    def path(
        self, z0: Float[np.ndarray, "agents dim"], condition: BridgeCondition
    ) -> Float[Array, "points agents dim"]:
        """The states of one trial's policy at every grid point."""
        path = self._whole(z0, condition, keep_path=True).path
        assert path is not None
        return path

    def _whole(
        self,
        z0: Float[np.ndarray, "agents dim"],
        condition: BridgeCondition,
        *,
        keep_trace: bool = False,
        keep_path: bool = False,
    ) -> Generation:
        start, single = jnp.asarray(z0[: len(condition.mask)]), rounded(condition)
        how = self.grid, self.drift, self.guard, keep_trace, keep_path
        return _compiled_generation(self.field, self.guidance, start, single, *how)


def rounded(condition: BridgeCondition) -> BridgeCondition:
    """A condition in float32."""
    return jax.tree.map(
        lambda leaf: leaf if leaf.dtype == bool else leaf.astype(np.float32), condition
    )
