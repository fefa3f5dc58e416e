"""What a guided step is made of, at N = 8: the field, a requirement with its gradient, the QP, a whole step.

Each part runs several times inside one compiled loop, as in a generation: no dispatch is timed with it.
"""

from collections.abc import Callable, Iterator
from functools import partial
from typing import Any

import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float

from deggflow.blocks import BLOCK
from deggflow.generation import refined_grid
from deggflow.guidance import DecoupledGuidance, min_norm_input
from deggflow.guided_field import Velocity
from deggflow.solver import EULER
from deggflow.step_guard import GuardedSteps, StepGuard
from deggflow.tasks.tabletop.changes import random_conditions
from deggflow.tasks.tabletop.condition import to_arrays
from deggflow.tasks.tabletop.field import load_field
from deggflow.tasks.tabletop.generator import initial_noise
from deggflow.tasks.tabletop.requirements import tabletop_guidance

from .clock import Call, Patience, in_turn
from .rows import Row, Times, Way, rows_of

SIZE, SEED = 8, 0
REPEATS = 10  # evaluations in one call
SMALL = 1e-3  # of what a part yields is added to what it is given next: nothing can be left out

Evaluation = Callable[[Float[Array, "agents 3"], Any], Float[Array, "agents 3"]]
"""(z, condition) of one sample -> something of the shape of z."""


def parts(patience: Patience, quick: bool) -> Iterator[Row]:
    """Rows of each part, over the field's."""
    for batch in (1, 16) if quick else (1, BLOCK):
        calls, what = _calls(batch)
        whole = in_turn(calls, patience)
        times: Times = {name: [s / REPEATS for s in each] for name, each in whole.items()}
        field = next(iter(calls))
        ways = {name: Way(what[name], batch, None if name == field else field) for name in calls}
        yield from rows_of(ways, times)


def _calls(batch: int) -> tuple[dict[str, Call], dict[str, str]]:
    """Each part as a call, and in words."""
    field, guidance = load_field(), tabletop_guidance()
    condition = jax.tree.map(
        jnp.asarray, to_arrays(random_conditions(SIZE, batch, "changed", SEED))
    )
    z = jnp.asarray(initial_noise(SEED, np.arange(batch), 0)[:, :SIZE])
    affordance: Any = guidance.requirements[0]

    def value_and_gradient(z: Any, condition: Any) -> Any:
        parts, gradient = affordance.margins.violation_and_gradient(z, condition, affordance.buffer)
        return gradient + parts[:, None]

    def one_row(z: Any, condition: Any) -> Any:
        return jax.vmap(min_norm_input)(z[:, None], z[:, :1]).u

    def two_rows(z: Any, condition: Any) -> Any:
        return jax.vmap(min_norm_input)(jnp.stack([z, z[:, ::-1] + 1], axis=1), z[:, :2]).u

    evaluations: dict[str, tuple[str, Evaluation]] = {
        "field": ("field", partial(field, jnp.asarray(0.5))),
        "requirement": ("requirement, value and gradient", value_and_gradient),
        "QP 1 row": ("an agent's QP, one row", one_row),
        "QP 2 rows": ("an agent's QP, two rows", two_rows),
    }
    where = f"N = {SIZE}, batch {batch}"
    calls = {
        f"parts/{batch}/{name}": _loop(run, z, condition) for name, (_, run) in evaluations.items()
    }
    calls[f"parts/{batch}/step"] = _steps(field, guidance, z, condition)
    words = [*(what for what, _ in evaluations.values()), "guided step with its acceptance"]
    return calls, {name: f"{what}, {where}" for name, what in zip(calls, words, strict=True)}


def _loop(evaluate: Evaluation, z: Float[Array, "samples agents 3"], condition: Any) -> Call:
    @jax.jit
    def run(z: Any, condition: Any) -> Any:
        def again(_: Any, z: Any) -> Any:
            return z + SMALL * jax.vmap(evaluate)(z, condition)

        return jax.lax.fori_loop(0, REPEATS, again, z)

    return lambda: jax.block_until_ready(run(z, condition))


def _steps(field: Any, guidance: DecoupledGuidance, z: Any, condition: Any) -> Call:
    """The first steps of a guided generation."""
    steps = GuardedSteps(refined_grid(), EULER, StepGuard(), keep_trace=False, keep_path=False)

    def velocity(condition: Any) -> Velocity:
        def guided(state: Any, step: Any, tau: Any, z: Any) -> Any:
            drift = field(tau, z, condition)
            state, correction, report = guidance(state, tau, z, drift, condition)
            return state, drift + correction, report

        return guided

    def start(z: Any, condition: Any) -> Any:
        return steps.start(len(guidance.names), guidance.init(z, condition), z, condition)

    def advance(condition: Any, lane: Any) -> Any:
        return steps.advance(velocity(condition), guidance.on_forced_step, None, lane)

    @jax.jit
    def run(lanes: Any, condition: Any) -> Any:
        return jax.lax.fori_loop(0, REPEATS, lambda _, on: jax.vmap(advance)(condition, on), lanes)

    lanes = jax.jit(jax.vmap(start))(z, condition)
    return lambda: jax.block_until_ready(run(lanes, condition))
