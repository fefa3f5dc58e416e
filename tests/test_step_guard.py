"""Schemes against Diffrax; guarded steps against the bounds they promise; agents that stop."""

from functools import partial

import diffrax
import jax
import jax.numpy as jnp
import numpy as np
import pytest

from deggflow import (
    DecoupledGuidance,
    NoGuidance,
    Own,
    Pooled,
    PrivateRequirement,
    SharedFactor,
    SharedRequirements,
    distances,
    generate,
    generate_batch,
    refined_grid,
)
from deggflow.drift import EVERY_STEP, Held
from deggflow.solver import EULER, HEUN, RK4
from deggflow.step_guard import GATHERED, StepGuard

AGENTS, BUFFER = 4, 0.05
MATRIX = jnp.array([[-1.0, 2.0], [-2.0, -0.5]])
SCHEMES = {"Euler": (EULER, diffrax.Euler()), "Heun": (HEUN, diffrax.Heun())}
# Diffrax has no classical Runge-Kutta of order four; its order is tested instead.


def smooth(tau, z, condition):
    return z @ MATRIX.T + jnp.sin(3 * tau)


def margins(z, condition):
    """Agents keep 1.0 apart."""
    offset = z[:, None] - z[None] + 10.0 * jnp.eye(AGENTS)[..., None]
    return jnp.linalg.norm(offset, axis=-1) - 1.0


def crowd(tau, z, condition):
    """Everybody to one point, ever faster."""
    return (jnp.array([[1.0, 1.0]]) - z) * (2.0 + 10.0 * tau) + jnp.tanh(z @ condition)


apart = PrivateRequirement(margins, BUFFER)


def wall(tau, z, condition):
    """The agents' mean keeps left of a wall that is steep to cross."""
    return 5.0 * (jnp.sum(jnp.mean(z, axis=0) ** 2) - 0.25)


def batch(guidance, guard, steps, solver=EULER, field=crowd, samples=32):
    def one(key):
        start, swirl = jax.random.split(key)
        z0 = 2.0 * jax.random.normal(start, (AGENTS, 2))
        condition = jax.random.normal(swirl, (2, 2))
        grid = refined_grid(steps)
        return generate(field, guidance, z0, condition, grid=grid, solver=solver, guard=guard)

    return jax.jit(jax.vmap(one))(jax.random.split(jax.random.key(3), samples))


@pytest.mark.parametrize("name", SCHEMES)
@pytest.mark.parametrize("guard", [None, StepGuard()])
def test_steps_equal_diffrax(name, guard, key):
    ours, theirs = SCHEMES[name]
    grid, z0 = refined_grid(40), jax.random.normal(key, (3, 2))
    out = generate(smooth, NoGuidance(), z0, None, grid=grid, solver=ours, guard=guard)
    expected = diffrax.diffeqsolve(
        diffrax.ODETerm(lambda t, y, args: smooth(t, y, None)),
        theirs,
        0.0,
        1.0,
        None,
        z0,
        stepsize_controller=diffrax.StepTo(grid),
    ).ys[-1]
    np.testing.assert_allclose(out.z, expected, atol=1e-5)
    assert int(out.work.refused_steps) == 0


@pytest.mark.parametrize(("solver", "order"), [(EULER, 1), (HEUN, 2), (RK4, 4)])
def test_schemes_have_their_order(solver, order, key):
    with jax.enable_x64(True):
        z0 = jnp.asarray(np.asarray(jax.random.normal(key, (3, 2))), jnp.float64)

        def end(steps):
            grid = jnp.linspace(0.0, 1.0, steps + 1)
            return np.asarray(generate(smooth, NoGuidance(), z0, None, grid=grid, solver=solver).z)

        exact = end(400) if order == 4 else np.asarray(
            generate(smooth, NoGuidance(), z0, None, grid=jnp.linspace(0.0, 1.0, 401), solver=RK4).z
        )  # fmt: skip
        errors = [np.abs(end(steps) - exact).max() for steps in (10, 20)]
    assert np.log2(errors[0] / errors[1]) == pytest.approx(order, abs=0.25)


def test_a_guard_that_finds_nothing_changes_nothing():
    """Where V stays positive: about V = 0, V^rho has no bounded slope, and two programs' rounding grows to centimetres."""
    gather = PrivateRequirement(
        lambda z, condition: 0.5 - jnp.linalg.norm(z, axis=-1, keepdims=True), BUFFER
    )
    guidance, leave = DecoupledGuidance((gather,)), lambda tau, z, condition: 0.2 * z
    with jax.enable_x64(True):
        fine, guarded = (batch(guidance, guard, 400, field=leave) for guard in (None, StepGuard()))
    calm = np.asarray(guarded.work.refused_steps) == 0
    assert calm.sum() >= 16
    assert (np.asarray(guarded.summary.active_points)[calm] > 100).all()
    np.testing.assert_allclose(np.asarray(guarded.z)[calm], np.asarray(fine.z)[calm], atol=1e-9)
    assert np.all(np.asarray(guarded.work.evaluations)[calm] == 401)


@pytest.mark.rounding
@pytest.mark.parametrize("solver", [EULER, HEUN, RK4], ids=lambda solver: solver.name)
def test_every_accepted_point_is_below_its_limit_or_counted(solver):
    out = batch(DecoupledGuidance((apart,)), StepGuard(6), 100, solver)
    work, trace = jax.tree.map(np.asarray, (out.work, out.trace))
    assert work.refused_steps.sum() > 0  # the guard had something to do
    over = (trace.value > trace.limit).any(-1).sum(-1)
    assert np.all(over <= work.forced_steps)
    kept = work.forced_steps == 0
    assert kept.sum() >= 8
    # V(z(1)) <= buffer^2 / 2: every margin holds.
    least = jax.vmap(lambda z: jnp.min(margins(z, None)))(out.z)
    assert np.all(np.asarray(least)[kept] >= -1e-6)


@pytest.mark.parametrize("drift", [EVERY_STEP, Held(3)], ids=["one macro step", "macro steps"])
def test_samples_in_turn_are_those_of_a_whole_batch(drift, key):
    """Some take many more steps than others; the next in line takes the place of one that is done."""
    first, second = jax.random.split(key)
    z0 = 2.0 * jax.random.normal(first, (11, AGENTS, 2))
    swirl = jax.random.normal(second, (11, 2, 2))

    @partial(jax.jit, static_argnames="width")
    def ends(z0, swirl, width):
        how = {"grid": refined_grid(12), "drift": drift, "guard": StepGuard(6, width)}
        return generate_batch(crowd, DecoupledGuidance((apart,)), z0, swirl, **how)

    with jax.enable_x64(True):
        wide = jnp.asarray(z0, jnp.float64), jnp.asarray(swirl, jnp.float64)
        whole, in_turn = ends(*wide, None), ends(*wide, 3)
    evaluations = np.asarray(whole.work.evaluations)
    assert evaluations.max() > 1.5 * evaluations.min()
    np.testing.assert_array_equal(in_turn.work.evaluations, evaluations)
    np.testing.assert_allclose(in_turn.z, whole.z, atol=1e-9)
    np.testing.assert_allclose(in_turn.trace.value, whole.trace.value, atol=1e-9)


@pytest.mark.parametrize("backend", ["cpu", "gpu"])
def test_the_last_of_a_large_batch_are_those_of_small_ones(backend, key, monkeypatch):
    """On a CPU they are finished one by one, on an accelerator together."""
    monkeypatch.setattr(jax, "default_backend", lambda: backend)
    first, second = jax.random.split(key)
    z0 = 2.0 * jax.random.normal(first, (GATHERED, AGENTS, 2))
    swirl = jax.random.normal(second, (len(z0), 2, 2))

    def ends(z0, swirl):
        how = {"grid": refined_grid(12), "guard": StepGuard(6), "keep_trace": False}
        return generate_batch(crowd, DecoupledGuidance((apart,)), z0, swirl, **how)

    with jax.enable_x64(True):
        wide = jnp.asarray(z0, jnp.float64), jnp.asarray(swirl, jnp.float64)
        whole = jax.jit(ends)(*wide)
        parts = [jax.jit(ends)(*(leaf[k : k + 32] for leaf in wide)) for k in (0, 32)]
    evaluations = np.asarray(whole.work.evaluations)
    assert evaluations.max() > np.quantile(evaluations, 0.75)
    for name in ("z", "work"):
        both = jax.tree.map(
            lambda *leaves: np.concatenate(leaves), *(getattr(part, name) for part in parts)
        )
        jax.tree.map(
            lambda leaf, other: np.testing.assert_allclose(leaf, other, atol=1e-9),
            getattr(whole, name), both,
        )  # fmt: skip


def test_a_width_is_positive():
    with pytest.raises(ValueError, match="`width` must be at least 1, or None; got 0"):
        StepGuard(width=0)


def test_a_stiff_factor_is_kept_where_fixed_steps_break_it():
    """The factors' recovery is left out: alpha(s) = s makes nothing good."""
    guidance = DecoupledGuidance((SharedRequirements((SharedFactor(wall),)),))
    fixed, guarded = batch(guidance, None, 12), batch(guidance, StepGuard(8), 12)
    ends = [jax.vmap(lambda z: wall(1.0, z, None))(out.z) for out in (fixed, guarded)]
    assert (ends[0] > 0).mean() > 0.2
    kept = np.asarray(guarded.work.forced_steps) == 0
    assert kept.mean() > 0.9
    assert np.all(np.asarray(ends[1])[kept] <= 0)


def test_after_a_refusal_steps_grow_by_doubling():
    """A length that was accepted is where the next step starts: of two long stretches, about every second try is accepted."""
    guidance = DecoupledGuidance((SharedRequirements((SharedFactor(wall),)),))
    out = batch(guidance, StepGuard(64), 2)
    refused = np.asarray(out.work.refused_steps)
    accepted = np.asarray(out.summary.points)
    assert refused.max() > 8
    assert np.all(refused <= accepted + 6)


@pytest.mark.parametrize("x64", [False, True])
def test_steps_stay_longer_than_the_rounding_of_tau(x64):
    """Where nothing helps, a step is halved until it is as short as that, and taken: a sample goes on in any case."""
    with jax.enable_x64(x64):
        z0 = jnp.array([[-1.0, 0.0], [1.0, 0.0]])

        def collide(tau, z, condition):
            return jnp.array([[1.0, 0.0], [-1.0, 0.0]])

        nobody = DecoupledGuidance(
            (PrivateRequirement(lambda z, _: distances(z) - 1.0, 0.05),),
            control=lambda tau, z, _: jnp.zeros((2, 2, 1)),
        )
        out = generate(
            collide, nobody, z0, None, grid=refined_grid(100, power=3.0), guard=StepGuard(100)
        )
    assert out.work.forced_steps > 10
    assert out.work.refused_steps <= 100 * 100
    assert out.work.evaluations < 101 * (2 * 100 + 60)
    np.testing.assert_allclose(out.z[:, 0], [0.0, 0.0], atol=1e-4)


def test_a_sample_goes_on_however_often_steps_are_halved():
    """Once a value is no number, all steps are refused until they are as short as the rounding of tau."""

    def broken(z, condition):
        gap = distances(z) - 1.0
        return jnp.where(z[:1, :1] > 0.5, jnp.nan, gap)

    def drift(tau, z, condition):
        return jnp.ones_like(z)

    guidance = DecoupledGuidance((PrivateRequirement(broken, 0.05),))
    z0 = jnp.array([[0.0, 0.0], [5.0, 5.0]])
    out = generate(drift, guidance, z0, None, grid=refined_grid(20), guard=StepGuard(60))
    assert not out.summary.hypotheses_hold
    np.testing.assert_allclose(out.z, z0 + 1.0, rtol=1e-5)


def test_a_sample_in_a_batch_is_what_it_is_alone():
    """Its clock is its own: up to rounding, nothing depends on the samples beside it."""
    guidance = DecoupledGuidance((SharedRequirements((SharedFactor(wall),)),))

    @jax.jit
    def run(key):
        start, swirl = jax.random.split(key)
        z0 = 2.0 * jax.random.normal(start, (AGENTS, 2))
        condition = jax.random.normal(swirl, (2, 2))
        return generate(crowd, guidance, z0, condition, grid=refined_grid(12), guard=StepGuard())

    keys = jax.random.split(jax.random.key(3), 16)
    together, alone = jax.jit(jax.vmap(run))(keys), [run(key) for key in keys]
    refused = np.asarray(together.work.refused_steps)
    assert len(set(refused.tolist())) > 1
    np.testing.assert_array_equal(refused, [int(one.work.refused_steps) for one in alone])
    np.testing.assert_allclose(together.z, np.array([one.z for one in alone]), atol=1e-3)


def test_a_guard_without_halvings_refuses_nothing_and_counts():
    """The steps are those of no guard; those that landed above a limit are known."""
    guidance = DecoupledGuidance((SharedRequirements((SharedFactor(wall),)),))
    plain, counted = batch(guidance, None, 12), batch(guidance, StepGuard(0), 12)
    np.testing.assert_allclose(counted.z, plain.z, atol=1e-5)
    np.testing.assert_array_equal(counted.work.refused_steps, 0)
    np.testing.assert_array_equal(counted.work.evaluations, 13)
    over = (counted.trace.value > counted.trace.limit)[:, 1:].any(-1).sum(-1)  # no step led to z(0)
    np.testing.assert_array_equal(counted.work.forced_steps, over)
    assert (over > 0).mean() > 0.2
    with pytest.raises(ValueError, match="`halvings` must not be negative"):
        StepGuard(-1)


@pytest.mark.parametrize(
    "requirement",
    [apart, SharedRequirements((SharedFactor(wall, allocation=Own()),))],
    ids=["private", "shared"],
)
def test_agents_that_stop_leave_their_share_to_the_others(requirement, key):
    """The bound holds from the moves of those that are left."""
    z0 = 1.5 * jax.random.normal(key, (AGENTS, 2))
    stops = jnp.array([0.3, jnp.inf, jnp.inf, jnp.inf])
    out = generate(
        crowd,
        DecoupledGuidance((requirement,)),
        z0,
        jnp.eye(2),
        grid=refined_grid(400),
        stops=stops,
        guard=StepGuard(),
        keep_path=True,
    )
    tau = np.asarray(out.trace.tau)
    late = tau >= 0.3
    assert np.ptp(np.asarray(out.path)[late, 0], axis=0).max() == 0
    assert np.all(np.asarray(out.trace.input_norm)[late, 0] == 0)
    assert not np.any(out.trace.qp_infeasible[:-1])  # no input follows the last point
    assert int(out.work.forced_steps) == 0
    assert np.all(out.trace.value[-1] <= out.trace.limit[-1])


@pytest.mark.parametrize(("allocation", "can"), [(Pooled(), True), (Own(), False)])
def test_who_takes_over_for_a_stopped_agent(allocation, can, key):
    """Pooled: the others; own: nobody, and the row says so."""
    guidance = DecoupledGuidance((PrivateRequirement(margins, BUFFER, allocation),))
    z = 0.2 * jax.random.normal(key, (AGENTS, 2))
    moving = jnp.array([False, True, True, True])
    state = guidance.init(z, None)
    drift = jnp.zeros_like(z)
    _, correction, report = guidance(state, jnp.asarray(0.5), z, drift, None, moving)
    assert bool(report.qp_infeasible[0]) != can
    assert bool(report.row_feasible[0, 0]) == can
    assert jnp.all(correction[0] == 0)
