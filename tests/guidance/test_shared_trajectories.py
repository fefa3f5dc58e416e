"""The finite-horizon theorem for SE guidance along trajectories, and what is reported where its conditions fail."""

from functools import cache, partial
from typing import NamedTuple

import jax
import jax.numpy as jnp
import numpy as np
import pytest
from shared_cases import (
    KINDS,
    below,
    bounds_by_hand,
    cases,
    factors_by_hand,
    field,
    guidance,
    near,
)

from deggflow import DecoupledGuidance, NoGuidance, generate, refined_grid
from deggflow.guidance import (
    Fixed,
    Own,
    Pooled,
    Recovering,
    SharedFactor,
    SharedRequirements,
    TighteningBound,
)


class Run(NamedTuple):
    """Along trajectories: factors, bounds, and in which samples the theorem's hypotheses hold throughout."""

    q: np.ndarray  # (samples, points, factors)
    beta: np.ndarray
    hypotheses_hold: np.ndarray
    kind: np.ndarray
    path: np.ndarray
    trace: object


SAMPLES = 24


COARSE, FINE = 100, 400


@jax.jit
@partial(jax.vmap, in_axes=(0, 0, None))
def trajectory(z0, condition, grid):
    """Under heterogeneous control maps."""
    return generate(
        field, guidance(mapped=True), z0, condition, grid=grid, guard=None, keep_path=True
    )


@cache
def run(steps):
    """Even steps; the grid is filled up with steps of length zero, so that it is compiled once."""
    start, case = cases(SAMPLES, 11)
    tau = np.minimum(np.arange(FINE + 1) / steps, 1.0)
    with jax.enable_x64(True):
        out = trajectory(*jax.tree.map(jnp.asarray, (start, case, tau)))
        path, trace = np.asarray(out.path), jax.tree.map(np.asarray, out.trace)
    each = [jax.tree.map(lambda leaf, k=k: leaf[k], case) for k in range(SAMPLES)]
    q = np.array([factors_by_hand(tau, z, c) for z, c in zip(path, each, strict=True)])
    beta = np.array([bounds_by_hand(tau, one[0]) for one in q])
    taken = tau < 1  # no input follows the last point
    hold = trace.row_feasible[:, taken].all((1, 2, 3)) & ~trace.qp_infeasible[:, taken].any((1, 2))
    return Run(q, beta, hold, case.kind, path, trace)


@pytest.mark.parametrize("kind", range(3), ids=KINDS)
def test_factors_stay_under_their_bounds_along_the_trajectory(kind):
    """thm:SE_finite_horizon, which is of continuous time: what Euler steps add vanishes with them."""
    coarse, fine = run(COARSE), run(FINE)
    chosen = (coarse.kind == kind) & coarse.hypotheses_hold & fine.hypotheses_hold
    assert chosen.sum() >= 5
    above = [(one.q - one.beta)[chosen].max() for one in (coarse, fine)]
    assert above[1] <= max(above[0] / 3, 1e-9)
    assert above[1] <= 0.02


def test_the_end_satisfies_the_requirement():
    """beta(1) = 0 implies q(1, z(1)) <= 0, up to what Euler steps add."""
    coarse, fine = run(COARSE), run(FINE)
    chosen = coarse.hypotheses_hold & fine.hypotheses_hold
    end = [max(one.q[chosen, -1, 0].max(), 0.0) for one in (coarse, fine)]
    assert end[1] <= max(end[0] / 3, 1e-9)
    assert np.mean(fine.q[chosen, 0, 0] > 0) > 0.5  # it was broken before


def test_without_guidance_the_same_fields_break_the_bounds():
    start, case = cases(SAMPLES, 11)

    @jax.jit
    @jax.vmap
    def nominal(z0, condition):
        z = generate(field, NoGuidance(), z0, condition, grid=refined_grid(100)).z
        one = jnp.ones(())
        return jnp.stack([near(one, z, condition), below(one, z, condition)])

    with jax.enable_x64(True):
        end = np.asarray(nominal(jnp.asarray(start), jax.tree.map(jnp.asarray, case)))
    for kind in range(3):
        assert np.all(end[case.kind == kind].max(axis=0) > 0.2)


def test_the_trace_is_the_factors_and_their_bounds():
    one = run(COARSE)
    np.testing.assert_allclose(one.trace.value, one.q, atol=1e-9)
    np.testing.assert_allclose(one.trace.bound, one.beta, atol=1e-9)
    assert guidance().names == ("near", "below")


def test_an_agent_of_no_factor_never_acts():
    one = run(COARSE)
    assert np.all(one.trace.input_norm[..., 4] == 0)
    assert np.all(one.trace.row_feasible[..., 4])
    assert not one.trace.qp_infeasible[..., 4].any()
    assert not one.trace.active[..., 4].any()
    assert np.all(np.isinf(one.trace.ell_norm[..., 4]))


def test_the_change_of_a_factor_by_itself_enters():
    """q = z + 3 sin(5 tau) rises and falls by itself; without drift the agent has to make up for it."""
    factor = SharedFactor(lambda tau, z, condition: z[0, 0] + 3.0 * jnp.sin(5.0 * tau))
    guide = DecoupledGuidance((SharedRequirements((factor,)),))
    out = jax.jit(
        lambda z0: generate(
            lambda tau, z, c: 0.0 * z, guide, z0, None, grid=refined_grid(400, 1.0), guard=None
        )
    )(jnp.full((1, 1), 0.5))
    assert jnp.max(out.trace.value - out.trace.bound) <= 0.02
    end = float(out.z[0, 0]) + 3 * np.sin(5.0)
    assert end <= 0.01
    assert float(jnp.max(out.trace.input_norm[:-1])) > 5.0


def one_sided(tau, z, condition):
    """Two agents share it; only the first can change it."""
    return z[0, 0] + 0.0 * z[1, 0]


def upward(tau, z, condition):
    return jnp.ones_like(z)


def test_shares_that_ask_an_agent_for_what_it_cannot_give_are_reported():
    """Own and fixed shares are infeasible where pooled ones leave every agent an input."""
    allocations = (Pooled(), Own(), Fixed(jnp.array([0.3, 0.7])))

    @jax.jit
    def traces(z0):
        guides = [
            DecoupledGuidance((SharedRequirements((SharedFactor(one_sided, allocation=each),)),))
            for each in allocations
        ]
        return [generate(upward, guide, z0, None, guard=None).trace for guide in guides]

    def acted(trace):
        """Without the last point, which no input follows."""
        return trace.row_feasible[:-1], trace.qp_infeasible[:-1]

    pooled, *rigid = traces(jnp.ones((2, 2)))
    for trace in rigid:
        feasible, infeasible = acted(trace)
        assert not feasible[:, 0, 1].all()
        np.testing.assert_array_equal(infeasible[:, 1], ~feasible[:, 0, 1])
        assert not infeasible[:, 0].any()
        assert trace.value[-1, 0] > trace.bound[-1, 0]  # and the bound is in fact missed
    feasible, infeasible = acted(pooled)
    assert feasible.all()
    assert not infeasible.any()
    assert jnp.max(pooled.value - pooled.bound) <= 0.01


def test_rows_exactly_opposed_at_one_agent_are_reported():
    """q_1 = z_0 and q_2 = -z_0 both have to fall: no input does, nobody else can help."""
    factors = tuple(
        SharedFactor(lambda tau, z, condition, s=s: s * (z[0, 0] - 2.0) + 1.0, name=name)
        for s, name in ((1.0, "down"), (-1.0, "up"))
    )
    guide = DecoupledGuidance((SharedRequirements(factors),))
    still = jax.jit(lambda z0: generate(lambda tau, z, c: 0.0 * z, guide, z0, None, guard=None))
    out = still(jnp.full((3, 2), 2.0))
    middle = (out.trace.tau > 0.2) & (out.trace.tau < 0.8)
    assert jnp.all(out.trace.qp_infeasible[middle, 0])
    assert not jnp.any(out.trace.row_feasible[middle, :, 0])
    assert jnp.all(jnp.isfinite(out.z))


def test_a_recovering_alpha_makes_good_what_lands_above_the_bound():
    """Started above the bound (slack 0 and a jump), V decays at the gain's rate instead of at 1."""

    def last(alpha):
        factor = SharedFactor(one_sided, TighteningBound(), alpha=alpha)
        guide = DecoupledGuidance((SharedRequirements((factor,)),))
        state = guide.init(jnp.zeros((2, 2)), None)  # the bound of another, better start

        def step(z, tau):
            _, correction, report = guide(state, tau, z, upward(tau, z, None), None)
            return z + (upward(tau, z, None) + correction) / 400, report.value - report.bound

        _, excess = jax.lax.scan(step, jnp.ones((2, 2)), jnp.arange(400) / 400)
        return np.asarray(excess)[:, 0]

    slow, fast = last(lambda s: s), last(Recovering(20.0))
    times = np.arange(400) / 400
    np.testing.assert_allclose(slow, slow[0] * np.exp(-times), atol=0.01)
    assert np.all(fast <= fast[0] * np.exp(-20 * times) + 0.01)
