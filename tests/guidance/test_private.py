"""The finite-horizon theorem for PE guidance, its rows and its infeasibility, on random fields."""

import jax
import jax.numpy as jnp
import numpy as np
import pytest

from deggflow import (
    DecoupledGuidance,
    Local,
    NoGuidance,
    Own,
    Pooled,
    PrivateRequirement,
    generate,
    hinge_violation,
    refined_grid,
)
from deggflow.guidance import LinearSchedule, PowerSchedule

AGENTS, RHO, KAPPA, BUFFER = 4, 0.75, 1.15, 0.02
ALLOCATIONS = {
    "own": Own(),
    "pooled": Pooled(),
    "local": Local(),
}


def margins(z, condition):
    """Agents keep 1.0 apart and inside a disk of radius 3 around the origin."""
    offset = z[:, None] - z[None] + 10.0 * jnp.eye(AGENTS)[..., None]
    apart = jnp.linalg.norm(offset, axis=-1) - 1.0
    inside = 3.0 - jnp.linalg.norm(z, axis=-1)
    return jnp.concatenate([apart, inside[:, None]], axis=1)


def crowd(tau, z, condition):
    """A field that fights the requirement: everybody to one point, with a swirl drawn at random."""
    swirl = jnp.tanh(z @ condition)
    return (jnp.array([[2.5, 1.0]]) - z) * 3.0 + swirl


violation = hinge_violation(margins, BUFFER)


def requirement(name, reanchored):
    return PrivateRequirement(margins, BUFFER, allocation=ALLOCATIONS[name], reanchored=reanchored)


@pytest.mark.parametrize("name", ALLOCATIONS)
@pytest.mark.parametrize("reanchored", [False, True])
def test_rows_together_imply_the_decay_of_v(name, reanchored, key):
    """Sum of the rows: dV/dtau <= -c omega V^rho (paper, eqn:app_PE_scalar_decay)."""
    one = requirement(name, reanchored)
    guidance = DecoupledGuidance((one,))
    z0 = jax.random.normal(key, (AGENTS, 2))
    z = z0 + 0.3 * jax.random.normal(jax.random.key(5), z0.shape)
    tau, condition = jnp.asarray(0.4), jnp.eye(2)
    drift = crowd(tau, z, condition)
    _, correction, report = guidance(guidance.init(z0, condition), tau, z, drift, condition)
    assert not jnp.any(report.qp_infeasible)

    def total(z):
        return jnp.sum(violation(z, condition))

    _, decay = jax.jvp(total, (z,), (drift + correction,))
    omega = 0.1 + 1.8 * tau
    remaining = (1 - tau) * 0.1 + 0.9 * (1 - tau**2)
    base, rest = (total(z), remaining) if reanchored else (total(z0), 1.0)
    c = KAPPA / (1 - RHO) * base ** (1 - RHO) / rest
    assert decay <= -c * omega * total(z) ** RHO * (1 - 1e-3)


@pytest.mark.parametrize("name", ALLOCATIONS)
def test_per_owner_demands_add_up_to_that_of_v(name, key):
    """dV/dtau <= -kappa / (1 - rho) omega V / int_tau^1 omega, though no owner knows V."""
    one = PrivateRequirement(margins, BUFFER, allocation=ALLOCATIONS[name], per_owner_gain=True)
    guidance = DecoupledGuidance((one,))
    z, tau, condition = jax.random.normal(key, (AGENTS, 2)), jnp.asarray(0.4), jnp.eye(2)
    drift = crowd(tau, z, condition)
    _, correction, report = guidance(guidance.init(z, condition), tau, z, drift, condition)
    assert not jnp.any(report.qp_infeasible)
    total, decay = jax.jvp(lambda z: jnp.sum(violation(z, condition)), (z,), (drift + correction,))
    omega, remaining = 0.1 + 1.8 * tau, (1 - tau) * 0.1 + 0.9 * (1 - tau**2)
    wanted = KAPPA / (1 - RHO) * omega * total / remaining
    assert total > 0
    assert decay <= -wanted * (1 - 1e-3)
    demand = one.demand(one.init(z, condition), tau, z, drift, None, condition)
    assert float(jnp.sum(demand.shares(jnp.ones((1, AGENTS))))) == pytest.approx(
        float(wanted), rel=1e-5
    )


def test_per_owner_demands_need_reanchoring():
    with pytest.raises(ValueError, match="`per_owner_gain` needs `reanchored`"):
        PrivateRequirement(margins, BUFFER, per_owner_gain=True, reanchored=False)


def excess(name, steps):
    """Largest V above the theorem's bound, over 64 random starts and fields; and who stayed feasible."""
    grid = refined_grid(steps)
    guidance = DecoupledGuidance((requirement(name, False),))

    @jax.jit
    @jax.vmap
    def run(key):
        start, swirl = jax.random.split(key)
        z0 = jax.random.normal(start, (AGENTS, 2))
        return generate(
            crowd, guidance, z0, jax.random.normal(swirl, (2, 2)), grid=grid, guard=None
        )

    out = run(jax.random.split(jax.random.key(3), 64))
    v, tau = np.asarray(out.trace.value[..., 0], np.float64), np.asarray(grid)
    start = v[:, :1] ** (1 - RHO)
    done = 0.1 * tau + 0.9 * tau**2
    bound = np.maximum(start - KAPPA * start * done[None], 0.0) ** (1 / (1 - RHO))
    assert not np.asarray(out.trace.qp_infeasible)[:, :-1].any()  # no input follows the last point
    return (v - bound).max(axis=1), v[:, 0]


@pytest.mark.parametrize("name", ALLOCATIONS)
def test_v_stays_under_the_theorems_bound_along_the_trajectory(name):
    """thm:private_finite_time, which is of continuous time: what Euler steps add vanishes with them.

    Samples that start with V(0) = 0 have a bound of zero throughout, and show the added part bare.
    """
    coarse, start = excess(name, 500)
    fine, _ = excess(name, 2000)
    violated = start > BUFFER**2
    assert violated.sum() >= 30
    assert fine[violated].max() <= coarse[violated].max() / 3
    assert fine.max() <= coarse.max() / 3


def test_reanchored_guidance_converges_from_wherever_v_stands():
    """V(tau) <= V(s) (remaining(tau) / remaining(s))^(kappa / (1 - rho)), after any disturbance."""
    omega = LinearSchedule()
    guidance = DecoupledGuidance((requirement("pooled", True),))
    z0 = jax.random.normal(jax.random.key(2), (AGENTS, 2))
    grid = refined_grid(3000)
    kick = 700

    @jax.jit
    def part(z, grid):  # of the way: nothing that a certificate could be made of
        return generate(crowd, guidance, z, jnp.eye(2), grid=grid, guard=None)

    first = part(z0, grid[: kick + 1])
    disturbed = 0.2 * first.z  # everybody thrown together
    rest = part(disturbed, grid[kick:])
    v, times = np.asarray(rest.trace.value[:, 0], np.float64), np.asarray(rest.trace.tau)
    assert v[0] > 0.1
    left = np.array([float(omega.remaining(jnp.asarray(t))) for t in times])
    bound = v[0] * (left / left[0]) ** (KAPPA / (1 - RHO))
    early = left > 0.011  # below, the floor of the remaining integral takes over
    assert np.all(v[early] <= np.maximum(1.02 * bound[early], BUFFER**2 / 2))
    assert np.all(np.asarray(margins(rest.z, None)) >= 0)


def test_without_guidance_the_same_field_breaks_the_requirement():
    z0 = jax.random.normal(jax.random.key(2), (AGENTS, 2))
    out = generate(crowd, NoGuidance(), z0, jnp.eye(2), grid=refined_grid(200))
    assert jnp.min(margins(out.z, None)) < 0


def test_a_requirement_no_input_can_change_names_the_agent():
    def stuck(z, condition):
        return jnp.array([[1.0], [-1.0], [1.0], [1.0]]) + 0.0 * jnp.sum(z)

    for allocation in ALLOCATIONS.values():
        one = PrivateRequirement(stuck, BUFFER, allocation=allocation)
        out = generate(
            crowd, DecoupledGuidance((one,)), jnp.zeros((AGENTS, 2)), jnp.eye(2), guard=None
        )
        infeasible = out.trace.qp_infeasible[:-1]
        assert jnp.all(infeasible[:, 1])
        assert not jnp.any(infeasible[:, jnp.array([0, 2, 3])])
        assert jnp.all(jnp.isfinite(out.z))


@pytest.mark.parametrize(("field", "value"), [("rho", 1.0), ("rho", 0.0), ("kappa", 0.9)])
def test_constants_outside_the_theorem_are_refused(field, value):
    with pytest.raises(ValueError, match=f"`{field}` must .* got {value}"):
        PrivateRequirement(margins, BUFFER, **{field: value})


@pytest.mark.parametrize(
    "omega", [LinearSchedule(0.3, 1.1), PowerSchedule(0.0), PowerSchedule(6.0)]
)
def test_schedule_integral_matches_quadrature(omega):
    for start in (0.0, 0.25, 0.9):
        points = np.linspace(start, 1.0, 2001)
        values = np.array(jax.vmap(omega)(jnp.asarray(points)))
        expected = np.trapezoid(values, points)
        assert float(omega.remaining(jnp.asarray(start))) == pytest.approx(expected, rel=1e-4)


def test_schedules_refuse_what_is_negative_or_infinite():
    with pytest.raises(ValueError, match="`start` and `start \\+ slope`"):
        LinearSchedule(0.1, -1.0)
    with pytest.raises(ValueError, match="`power` must not be negative"):
        PowerSchedule(-0.5)
