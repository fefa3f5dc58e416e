"""Algorithm 1: guided generation of one sample."""

from typing import Any, NamedTuple

import jax
import jax.numpy as jnp
from jaxtyping import Array, Bool, Float

from .flow import Field
from .guidance import AbstractGuidance

DEFAULT_STEPS = 100


class Trace(NamedTuple):
    """The generation step by step, before each step."""

    tau: Float[Array, " steps"]
    value: Float[Array, "steps rows"]  # V or q of each requirement
    bound: Float[Array, "steps rows"]  # what the theorem promises of it
    able: Bool[Array, "steps rows agents"]  # the theorem's condition for a feasible row holds
    infeasible: Bool[Array, "steps agents"]  # this agent had no input that meets its rows
    effort: Float[Array, "steps agents"]  # |u_i|


class Generation(NamedTuple):
    """A generated sample."""

    z: Float[Array, "agents dim"]
    trace: Trace
    path: Float[Array, "points agents dim"] | None  # z at every grid point, if it was asked for


def refined_grid(steps: int = DEFAULT_STEPS, power: float = 2.0) -> Float[Array, " points"]:
    """The grid tau = 1 - (1 - s)^power for equal steps of s: finer toward tau = 1, where omega is large.

    `power = 1` is the uniform grid.
    """
    if steps < 1:
        raise ValueError(f"`steps` must be at least 1; got {steps}.")
    if not power > 0:
        raise ValueError(
            f"`power` must be positive, else the grid does not reach tau = 1; got {power}."
        )
    return 1 - (1 - jnp.linspace(0.0, 1.0, steps + 1)) ** power


def generate(
    field: Field,
    guidance: AbstractGuidance,
    z0: Float[Array, "agents dim"],
    condition: Any,
    *,
    grid: Float[Array, " points"] | None = None,
    keep_path: bool = False,
) -> Generation:
    """Carries z(0) to z(1) under the nominal field and the guidance, by Euler steps on the grid.

    Args:
        field: Nominal vector field, any callable (tau, z, condition) -> dz/dtau.
        guidance: `DecoupledGuidance`, or `NoGuidance` for the nominal sample.
        z0: Initial sample.
        condition: What field and requirements are conditioned on, any pytree.
        grid: Increasing values of tau from 0 to 1; `refined_grid()` by default.
        keep_path: Also return z at every grid point.

    Source: paper, alg:guided_sampling.
    """
    grid = refined_grid() if grid is None else grid
    state = guidance.init(z0, condition)

    def step(
        z: Float[Array, "agents dim"], span: tuple[Float[Array, ""], Float[Array, ""]]
    ) -> tuple[Float[Array, "agents dim"], tuple[Trace, Float[Array, "agents dim"] | None]]:
        tau, after = span
        drift = field(tau, z, condition)
        correction, report = guidance(state, tau, z, drift, condition)
        trace = Trace(tau, *report)
        return z + (after - tau) * (drift + correction), (trace, z if keep_path else None)

    z, (trace, path) = jax.lax.scan(step, z0, (grid[:-1], grid[1:]))
    if path is not None:
        path = jnp.concatenate([path, z[None]])
    return Generation(z, trace, path)
