"""Shared requirements (SE guidance): factors of several agents, each led below a bound of its own."""

from collections.abc import Callable
from typing import Any, NamedTuple

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Bool, Float

from deggflow.shapes import Mask, RowFlags, RowValues, Scalar, States

from .allocation import AbstractAllocation, Pooled
from .bound import AbstractBound, TighteningBound
from .requirement import (
    AbstractRequirement,
    Control,
    Demand,
    check_buffer,
    check_unrounded,
    input_gradient,
    plain_number,
)

FactorValue = Callable[[Scalar, States, Any], Scalar]
"""q_a(tau, z, condition), at most 0 where the requirement is met; it may depend on tau explicitly."""


def linear(value: Scalar) -> Scalar:
    """alpha(s) = s (paper, Task 1)."""
    return value


class Recovering(eqx.Module):
    """alpha(s) = s below zero and gain s above: a discrete step that ends above the bound is made good.

    An extended class-K function like any other; where q stays below its bound it changes nothing.
    """

    gain: float = 20.0

    def __check_init__(self) -> None:
        if not self.gain > 0:
            raise ValueError(
                f"`gain` must be positive, else alpha is not of extended class K; got {self.gain}."
            )

    def __call__(self, value: Scalar) -> Scalar:
        return jnp.where(value > 0, self.gain * value, value)


def all_agents(condition: Any) -> None:
    """Incidence of a factor that all agents share."""


class SharedFactor(eqx.Module):
    """One factor a of the factor graph: q_a <= beta_a along the whole generation, q_a <= end at tau = 1.

    Guidance leads q_a below beta_a - buffer; a step may use up the buffer, but not go above beta_a. The verdict on a
    finished sample is `q_a(1, z) <= bound.end(condition)`, in float64.

    Attributes:
        value: q_a(tau, z, condition), a number; continuously differentiable; depends on its own agents' states only.
        bound: beta_a.
        alpha: Extended class-K function; how fast q_a may approach its bound.
        incidence: From the condition, which agents belong to the factor; None for all of them.
        allocation: How the factor's agents divide the demand: `Pooled()`, `Own()` (equal parts) or `Fixed(weight)`.
        buffer: What guidance aims at below the bound, in the unit of q_a.
        name: What reports call it.

    Source: paper, thm:SE_finite_horizon.
    """

    value: FactorValue
    bound: AbstractBound = TighteningBound()
    alpha: Callable[[Scalar], Scalar] = linear
    incidence: Callable[[Any], Mask] = all_agents
    allocation: AbstractAllocation = Pooled()
    buffer: float = eqx.field(static=True, default=0.0, converter=plain_number)
    name: str = eqx.field(static=True, default="shared")

    def __check_init__(self) -> None:
        if not callable(self.value):
            raise TypeError(
                f"`value` must be a function (tau, z, condition) -> q; got {self.value!r}."
            )
        check_buffer(self.buffer, "`value`", "q <= bound - buffer")

    def q(self, tau: Scalar, z: States, condition: Any) -> Scalar:
        """The value, looked at: one floating-point number."""
        value = self.value(tau, z, condition)
        is_array = isinstance(value, jax.Array | np.ndarray)
        if not is_array or not jnp.issubdtype(value.dtype, jnp.floating):
            kind = value.dtype if is_array else type(value).__name__
            raise TypeError(
                f"`value` of {self.name!r} must be a floating-point number, at most its bound where the requirement holds; "
                f"got {kind}."
            )
        if value.shape:
            raise ValueError(
                f"`value` of {self.name!r} must have shape (), one number for the team; got {value.shape}."
            )
        return value

    def end(self, condition: Any, like: Float[Array, "..."]) -> Scalar:
        """What q may be at tau = 1."""
        return jnp.asarray(self.bound.end(condition), like.dtype).reshape(())


class SharedState(NamedTuple):
    """Bounds of one sample, and which agents are present.

    Attributes:
        bounds: One state for each factor.
        mask: True for the agents that are present; None: all.
    """

    bounds: tuple[Any, ...]
    mask: Mask


class SharedRequirements(AbstractRequirement):
    """The factors that the agents of a team have in common; each gives each of its agents one row.

    With V_a = q_a + buffer_a - beta_a, an agent's row is
    grad_i q_a . (f_i + g_i u_i) + w_{a,i} (dq_a/dtau - dbeta_a/dtau + alpha(V_a)) <= 0,
    with the weights w_{a,i} of the factor's `allocation`. Where all agents meet their rows, q_a + buffer_a <= beta_a for
    all tau (paper, thm:SE_finite_horizon).

    Attributes:
        factors: Any number.
    """

    factors: tuple[SharedFactor, ...]

    def __check_init__(self) -> None:
        if not isinstance(self.factors, tuple) or not all(
            isinstance(factor, SharedFactor) for factor in self.factors
        ):
            raise TypeError(
                f"`factors` must be a tuple of `SharedFactor`s, (factor,) if there is one; got {self.factors!r}."
            )
        if not self.factors:
            raise ValueError("`factors` must hold at least one `SharedFactor`; got ().")

    @property
    def names(self) -> tuple[str, ...]:
        return tuple(factor.name for factor in self.factors)

    def init(self, z0: States, condition: Any, mask: Mask = None) -> SharedState:
        """The bounds, from q_a(0, z(0))."""
        start = jnp.zeros((), z0.dtype)
        return SharedState(
            tuple(
                factor.bound.init(factor.q(start, z0, condition) + factor.buffer, condition)
                for factor in self.factors
            ),
            mask,
        )

    def values(
        self, tau: Scalar, z: States, condition: Any, mask: Mask = None
    ) -> Float[Array, " factors"]:
        return jnp.stack([factor.q(tau, z, condition) for factor in self.factors])

    def margins_at_end(
        self, z: States, condition: Any, mask: Mask = None
    ) -> tuple[Float[Array, "..."], ...]:
        q = [factor.q(jnp.ones((), z.dtype), z, condition) for factor in self.factors]
        for factor, value in zip(self.factors, q, strict=True):
            check_unrounded(f"`value` of {factor.name!r} is", value, z)
        return tuple(
            factor.end(condition, z) - value for factor, value in zip(self.factors, q, strict=True)
        )

    def margin_names(self, row: int) -> None:
        return None

    def demand(
        self,
        state: SharedState,
        tau: Scalar,
        z: States,
        drift: States,
        control: Control,
        condition: Any,
        moving: Mask = None,
    ) -> Demand:
        q, dq_dtau, gradient = self._derivatives(tau, z, condition)
        incident = self._incident(z.shape[0], condition)
        gradient = jnp.where(incident[..., None], gradient, 0.0)
        q = q.astype(z.dtype)
        bound, limit, required = self._required(state, tau, q, dq_dtau, condition)
        ell = jax.vmap(lambda each: input_gradient(control, each, moving))(gradient)
        acting = incident if moving is None else incident & moving[None]
        # Where all of a factor's agents have stopped, what it asks stays with them: rows that say so.
        acting = jnp.where(jnp.any(acting, axis=1, keepdims=True), acting, incident)
        return Demand(
            ell=ell,
            rate=jnp.sum(gradient * drift[None], axis=-1),
            explicit_rate=dq_dtau,
            value=q,
            bound=bound,
            limit=limit,
            contribution=jnp.sqrt(jnp.sum(ell**2, axis=-1)),
            value_nan=jnp.isnan(q)[:, None] & incident,
            shares=lambda norm_sq: (
                self._weights(norm_sq, acting) * required[:, None]
            ),  # eqn:SE_finite_horizon_zeta
        )

    def _derivatives(
        self, tau: Scalar, z: States, condition: Any
    ) -> tuple[
        Float[Array, " factors"], Float[Array, " factors"], Float[Array, "factors agents dim"]
    ]:
        """q, dq/dtau and the gradient of every factor; what one of them shares with others is computed once."""
        values, slopes, gradients = [], [], []
        for factor in self.factors:
            q, pull_back = jax.vjp(lambda tau, z, f=factor: f.q(tau, z, condition), tau, z)
            slope, gradient = pull_back(jnp.ones_like(q))
            values.append(q)
            slopes.append(slope)
            gradients.append(gradient)
        return jnp.stack(values), jnp.stack(slopes), jnp.stack(gradients)

    def on_forced_step(
        self, state: SharedState, tau: Scalar, value: RowValues, above: RowFlags
    ) -> SharedState:
        return state  # the bounds stay; alpha leads back below them

    def _weights(
        self, norm_sq: Float[Array, "factors agents"], acting: Bool[Array, "factors agents"]
    ) -> Float[Array, "factors agents"]:
        """w_{a,i}: how a factor's acting agents divide a decrease of one, of which each owns an equal part."""
        count = jnp.maximum(jnp.sum(acting, axis=1, keepdims=True), 1)
        own = (acting / count).astype(norm_sq.dtype)
        return jnp.stack(
            [
                factor.allocation(
                    own[a], norm_sq[a], lambda a=a: acting[a][:, None] & acting[a][None]
                )
                for a, factor in enumerate(self.factors)
            ]
        )

    def _incident(self, agents: int, condition: Any) -> Bool[Array, "factors agents"]:
        incidences = [factor.incidence(condition) for factor in self.factors]
        return jnp.stack([jnp.ones(agents, bool) if one is None else one for one in incidences])

    def _required(
        self,
        state: SharedState,
        tau: Scalar,
        q: Float[Array, " factors"],
        dq_dtau: Float[Array, " factors"],
        condition: Any,
    ) -> tuple[Float[Array, " factors"], Float[Array, " factors"], Float[Array, " factors"]]:
        """Where q_a is led, what a step may reach, and dq_a/dtau - dbeta_a/dtau + alpha(V_a) of every factor."""
        one = jnp.ones_like(tau)
        bounds = [
            jax.jvp(lambda t, f=factor, s=own: f.bound(s, t), (tau,), (one,))
            for factor, own in zip(self.factors, state.bounds, strict=True)
        ]
        beta = jnp.stack([bound.astype(q.dtype) for bound, _ in bounds])
        dbeta = jnp.stack([slope.astype(q.dtype) for _, slope in bounds])
        buffer = jnp.array([factor.buffer for factor in self.factors], q.dtype)
        aim = beta - buffer
        alpha = jnp.stack(
            [factor.alpha(v) for factor, v in zip(self.factors, q - aim, strict=True)]
        )
        return aim, beta, dq_dtau - dbeta + alpha.astype(q.dtype)
