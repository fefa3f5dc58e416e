"""Nominal and guided generations from the same z(0), at the same grid points."""

from typing import Any, NamedTuple

import equinox as eqx
import jax
import jax.numpy as jnp
from jaxtyping import Array, Float

from deggflow.drift import EVERY_STEP, AbstractDrift, aligned
from deggflow.flow import Field
from deggflow.generation import generate_batch, refined_grid
from deggflow.guidance import AbstractGuidance, GuidanceReport, NoGuidance
from deggflow.shapes import Mask, RowFlags, RowValues, Scalar, States
from deggflow.solver import EULER, RungeKutta
from deggflow.step_guard import StepGuard


class Coupled(NamedTuple):
    """Nominal and guided states from the same z(0) under one condition (paper: X^nom, X^gui, Gamma).

    Attributes:
        tau: The grid.
        nominal: Nominal states.
        guided: Guided states.
        correction: |Gamma|, the norm of all agents' g_i u_i together.
    """

    tau: Float[Array, " points"]
    nominal: Float[Array, "samples points agents dim"]
    guided: Float[Array, "samples points agents dim"]
    correction: Float[Array, "samples points"]


class _Correcting(AbstractGuidance):
    """Guidance whose reports contain |g_i u_i| instead of |u_i|."""

    inner: AbstractGuidance

    @property
    def names(self) -> tuple[str, ...]:
        return self.inner.names

    def init(self, z0: States, condition: Any, mask: Mask = None) -> Any:
        return self.inner.init(z0, condition, mask)

    def __call__(
        self, state: Any, tau: Scalar, z: States, drift: States, condition: Any, moving: Mask = None
    ) -> tuple[Any, States, GuidanceReport]:
        state, correction, report = self.inner(state, tau, z, drift, condition, moving)
        return state, correction, report._replace(input_norm=jnp.linalg.norm(correction, axis=-1))

    def on_forced_step(self, state: Any, tau: Scalar, value: RowValues, above: RowFlags) -> Any:
        return self.inner.on_forced_step(state, tau, value, above)


@eqx.filter_jit
def couple(
    field: Field,
    guidance: AbstractGuidance,
    z0: Float[Array, "samples agents dim"],
    condition: Any,
    *,
    grid: Float[Array, " points"] | None = None,
    solver: RungeKutta = EULER,
    drift: AbstractDrift = EVERY_STEP,
    guard: StepGuard | None = None,
) -> Coupled:
    """Generates every z(0) twice, without and with guidance.

    Args:
        field: Nominal vector field.
        guidance: Guidance that is compared with the nominal generation.
        z0: Initial samples, without padded agents, whose states would enter the distances.
        condition: One condition for all samples, as in the theorem.
        grid: As in `generate`.
        solver: As in `generate`.
        drift: As in `generate`, of both generations.
        guard: Acceptance of the guided steps. The recursions of `bounds` are only valid without a guard, with `EULER` and
            with `EveryStep()`, as then all steps are those of the grid, and all drifts the field's values. `step_bound`
            needs none of this.

    Source: paper, thm:wasserstein.
    """
    grid, _ = aligned(refined_grid() if grid is None else grid, drift.macro_grid())
    many = jax.tree.map(lambda leaf: jnp.broadcast_to(leaf, (len(z0), *jnp.shape(leaf))), condition)
    nominal = generate_batch(
        field, NoGuidance(), z0, many,
        grid=grid, solver=solver, drift=drift, guard=None, keep_path=True,
    )  # fmt: skip
    guided = generate_batch(
        field, _Correcting(guidance), z0, many,
        grid=grid, solver=solver, drift=drift, guard=guard, keep_path=True,
    )  # fmt: skip
    assert nominal.path is not None
    assert guided.path is not None
    assert guided.trace is not None
    correction = jnp.linalg.norm(guided.trace.input_norm, axis=-1)
    return Coupled(grid, nominal.path, guided.path, correction)
