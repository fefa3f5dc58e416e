"""Drifts that evaluate the field less often than guidance: their guarantees, and how often the field is called."""

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
import pytest

from deggflow import (
    AfterPrediction,
    DecoupledGuidance,
    EveryStep,
    Extrapolated,
    ExtrapolatedEndpoint,
    Held,
    Midpoint,
    NoGuidance,
    PrivateRequirement,
    SharedFactor,
    SharedRequirements,
    StepGuard,
    certify_batch,
    generate,
    generate_batch,
    refined_grid,
    sample,
)
from deggflow.drift import macro_grid
from deggflow.solver import EULER, HEUN

AGENTS, BUFFER = 3, 0.05


def margins(z, condition):
    """Agents keep 1.0 apart."""
    offset = z[:, None] - z[None] + 10.0 * jnp.eye(AGENTS)[..., None]
    return jnp.linalg.norm(offset, axis=-1) - 1.0


def wall(tau, z, condition):
    """The agents' mean keeps within a disk."""
    return jnp.sum(jnp.mean(z, axis=0) ** 2) - 0.25


def crowd(tau, z, condition):
    """Everybody to one point, ever faster."""
    return (jnp.ones((1, 2)) - z) * (1.0 + 2.0 * tau) + jnp.tanh(z @ condition)


APART = PrivateRequirement(margins, BUFFER, name="apart")
MIXED = DecoupledGuidance((SharedRequirements((SharedFactor(wall, buffer=0.02),)), APART))


compiled_generate = eqx.filter_jit(generate)
compiled_batch = eqx.filter_jit(generate_batch)


DRIFTS = [
    *(Held(count) for count in (1, 2, 4, 8, 16)),
    *(Extrapolated(count) for count in (2, 8)),
    *(Extrapolated(count, 3) for count in (4, 16)),
    *(Midpoint(count) for count in (2, 8)),
    *(ExtrapolatedEndpoint(count) for count in (1, 3, 16)),
]


def samples_of(drift, samples=48, guard=StepGuard(), steps=40, **options):  # noqa: B008
    rng = np.random.default_rng(8)
    with jax.enable_x64(True):
        z0 = jnp.asarray(2.0 * rng.normal(size=(samples, AGENTS, 2)))
        swirl = jnp.asarray(rng.normal(size=(samples, 2, 2)))
        run = jax.jit(
            lambda z0, swirl: generate_batch(
                crowd, MIXED, z0, swirl, grid=refined_grid(steps), drift=drift, guard=guard,
                **options,
            )
        )  # fmt: skip
        made = jax.tree.map(np.asarray, run(z0, swirl))
        return made, certify_batch(made, MIXED, np.asarray(swirl))


@pytest.mark.parametrize("drift", DRIFTS, ids=str)
def test_guarantees_hold_whatever_the_drift(drift):
    made, certificates = samples_of(drift)
    hold = np.asarray(made.summary.hypotheses_hold)
    satisfied = np.array([each.satisfied for each in certificates])
    assert hold.mean() > 0.8
    assert satisfied[hold].all()
    assert satisfied.mean() > 0.9
    # Independently of certificates: the margins and the factor at z(1), and values at the points of the grid.
    least = np.asarray(jax.vmap(lambda z: margins(z, None).min())(made.z))
    factor = (made.z.mean(axis=1) ** 2).sum(-1) - 0.25
    assert np.all(least[hold] >= 0)
    assert np.all(factor[hold] <= 0)
    kept = made.work.forced_steps == 0
    assert np.all(made.trace.value[kept, 1:] <= made.trace.limit[kept, 1:])


@pytest.mark.parametrize(
    "drift",
    [Held(5), Extrapolated(6, 3), Midpoint(8), ExtrapolatedEndpoint(6), AfterPrediction(Held(5))],
    ids=str,
)
@pytest.mark.parametrize("guard", [None, StepGuard()], ids=["fixed", "guarded"])
def test_a_batch_is_what_its_samples_are_alone(drift, guard):
    rng = np.random.default_rng(8)
    z0, swirl = 2.0 * rng.normal(size=(40, AGENTS, 2)), rng.normal(size=(40, 2, 2))
    stops = rng.uniform(0.2, 1.4, (40, AGENTS))
    mask = rng.random((40, AGENTS)) < 0.9
    mask[:, 0] = True
    options = {"grid": refined_grid(14), "guard": guard, "drift": drift, "keep_path": True}
    left = DecoupledGuidance((SharedRequirements((SharedFactor(wall),)),))
    with jax.enable_x64(True):
        inputs = jax.tree.map(jnp.asarray, (z0, swirl, mask, stops))

        def alone(z0, swirl, mask, stops):
            return generate(crowd, left, z0, swirl, mask=mask, stops=stops, **options)

        def batch(z0, swirl, mask, stops):
            return generate_batch(crowd, left, z0, swirl, mask=mask, stops=stops, **options)

        together = jax.tree.map(np.asarray, jax.jit(batch)(*inputs))
        mapped = jax.tree.map(np.asarray, jax.jit(jax.vmap(alone))(*inputs))
        one = [jax.tree.map(lambda leaf, k=k: leaf[k], inputs) for k in range(3)]
        run = jax.jit(alone)
        single = [run(*each) for each in one]
    if guard is not None:
        assert len(set(together.work.evaluations.tolist())) > 1  # they take differently long
    first = jax.tree.map(lambda *leaves: np.array(leaves), *single)
    pairs = [(mapped, together), (first, jax.tree.map(lambda leaf: leaf[:3], together))]
    for expected, found in pairs:
        for ours, wanted in zip(jax.tree.leaves(found), jax.tree.leaves(expected), strict=True):
            if wanted.dtype == np.float64:
                np.testing.assert_allclose(ours, wanted, rtol=1e-7, atol=1e-8)
            else:
                np.testing.assert_array_equal(ours, wanted)
    np.testing.assert_array_equal(together.path[:, -1], together.z)
    absent = ~mask
    np.testing.assert_array_equal(together.z[absent], z0[absent])


class Counted:
    """A field whose calls are counted; a batch is one call."""

    def __init__(self):
        self.calls = 0

    def _evaluate(self, tau, z):
        self.calls += 1
        return np.asarray(1.0 - np.asarray(z))

    def __call__(self, tau, z, condition):
        shape = jax.ShapeDtypeStruct(z.shape, z.dtype)
        return jax.pure_callback(self._evaluate, shape, tau, z, vmap_method="broadcast_all")


@pytest.mark.parametrize(
    "drift",
    [
        Held(1),
        Held(4),
        Extrapolated(8),
        Extrapolated(8, 3),
        Midpoint(6),
        ExtrapolatedEndpoint(8),
        AfterPrediction(ExtrapolatedEndpoint(7)),
        AfterPrediction(Midpoint(6)),
    ],
    ids=str,
)
@pytest.mark.parametrize("guard", [None, StepGuard()], ids=["fixed", "guarded"])
def test_the_field_is_called_once_for_each_evaluation(drift, guard):
    rng = np.random.default_rng(1)
    z0 = jnp.asarray(rng.normal(size=(20, AGENTS, 2)), jnp.float32)
    guidance = DecoupledGuidance((APART,))
    options = {"drift": drift, "guard": guard, "grid": refined_grid(30)}
    ways = [
        lambda field: generate_batch(field, guidance, z0, None, **options),
        lambda field: jax.vmap(lambda z: generate(field, guidance, z, None, **options))(z0),
        lambda field: generate(field, guidance, z0[0], None, **options),
        lambda field: generate(field, NoGuidance(), z0[0], None, **options),
    ]
    # Drifts do not know how samples are batched, so that one with and one without a prediction go every way.
    for run in ways if drift in (Extrapolated(8), AfterPrediction(Midpoint(6))) else ways[:1]:
        field = Counted()
        work = jax.block_until_ready(jax.jit(lambda field=field, run=run: run(field))()).work
        wanted = getattr(drift, "prediction", drift).evaluations
        assert field.calls == wanted
        np.testing.assert_array_equal(work.field_evaluations, wanted)
        assert np.all(np.asarray(work.evaluations) >= 31)


def test_every_step_is_the_default_and_counts_every_evaluation():
    z0 = jnp.asarray(np.random.default_rng(1).normal(size=(AGENTS, 2)), jnp.float32)
    for solver, stages in ((EULER, 1), (HEUN, 2)):
        given = compiled_generate(crowd, MIXED, z0, jnp.eye(2), solver=solver, drift=EveryStep())
        default = compiled_generate(crowd, MIXED, z0, jnp.eye(2), solver=solver)
        for one, other in zip(jax.tree.leaves(given), jax.tree.leaves(default), strict=True):
            np.testing.assert_array_equal(one, other)
        assert int(given.work.field_evaluations) == stages * int(given.work.evaluations)


def test_the_grid_may_be_an_argument_of_the_program():
    z0 = jnp.asarray(np.random.default_rng(1).normal(size=(AGENTS, 2)), jnp.float32)

    def run(grid):
        return generate(crowd, MIXED, z0, jnp.eye(2), grid=grid, drift=Extrapolated(6))

    with jax.enable_x64(True):  # in float32 the two programs round apart
        z0, grid = jnp.asarray(z0, jnp.float64), refined_grid(30)
        given, wanted = jax.jit(run)(grid), jax.jit(lambda: run(grid))()
    np.testing.assert_array_equal(np.isin(macro_grid(6), given.trace.tau), True)
    np.testing.assert_allclose(given.z, wanted.z, atol=1e-4)


@pytest.mark.parametrize("guard", [None, StepGuard()], ids=["fixed", "guarded"])
def test_after_a_prediction_guidance_moves_only_what_violates_a_requirement(guard):
    rng = np.random.default_rng(8)
    z0, swirl = 2.0 * rng.normal(size=(40, AGENTS, 2)), rng.normal(size=(40, 2, 2))
    prediction = ExtrapolatedEndpoint(8)
    guidance = DecoupledGuidance((APART,))
    with jax.enable_x64(True):
        nominal = compiled_batch(crowd, NoGuidance(), z0, jnp.asarray(swirl), drift=prediction).z
        made = compiled_batch(
            crowd, guidance, z0, jnp.asarray(swirl), drift=AfterPrediction(prediction),
            guard=guard, keep_path=True,
        )  # fmt: skip
        certificates = certify_batch(made, guidance, swirl)
        margin = np.asarray(jax.vmap(lambda z: margins(z, None).min(axis=-1))(nominal))
    np.testing.assert_allclose(made.path[:, 0], nominal, atol=1e-12)
    np.testing.assert_array_equal(made.summary.z0, made.path[:, 0])
    assert all(each.satisfied for each in certificates)
    assert jax.tree.map(np.asarray, made.summary).hypotheses_hold.all()
    free = (margin >= BUFFER).all(axis=-1)
    assert 0 < free.sum() < len(free)
    np.testing.assert_array_equal(made.z[free], made.path[free, 0])
    assert np.all(made.work.field_evaluations == 8)


def test_stops_after_a_prediction_count_on_the_clock_of_the_guidance():
    z0 = 0.1 * jnp.asarray(np.random.default_rng(1).normal(size=(AGENTS, 2)), jnp.float32)
    drift = AfterPrediction(Held(4))
    made = compiled_generate(
        crowd, DecoupledGuidance((APART,)), z0, jnp.eye(2), drift=drift, keep_path=True,
        stops=jnp.array([0.0, 0.5, 2.0]), mask=jnp.array([True, True, False]),
    )  # fmt: skip
    moved = np.linalg.norm(np.diff(made.path, axis=0), axis=-1) > 0
    before = np.asarray(made.trace.tau[:-1]) < 0.5
    assert not moved[:, 0].any()
    assert moved[before, 1].any()
    assert not moved[~before, 1].any()
    assert np.any(made.path[0, :2] != z0[:2])
    np.testing.assert_array_equal(made.z[2], z0[2])  # absent


def test_a_one_step_model_is_guided_with_one_evaluation():
    """Its value at tau = 0 is the mean velocity up to tau = 1; anything later is wrong."""
    target = jnp.array([[0.2, 0.0], [0.0, 0.3], [-0.3, 0.1]])

    def mean_velocity(tau, z, condition):
        return jnp.where(tau == 0, target - z, jnp.nan)

    result = sample(
        mean_velocity, (APART,), key=jax.random.key(0), count=16, shape=(AGENTS, 2), drift=Held(1)
    )
    assert result.satisfied.all()
    nominal = compiled_generate(
        mean_velocity, NoGuidance(), jnp.ones((AGENTS, 2)), None, drift=Held(1)
    )
    np.testing.assert_allclose(nominal.z, target, atol=1e-5)


def test_an_infinite_field_is_reported():
    def broken(tau, z, condition):
        return jnp.where(tau > 0.5, jnp.nan, -z)

    out = compiled_generate(broken, MIXED, jnp.ones((AGENTS, 2)), jnp.eye(2), drift=Extrapolated(4))
    assert not out.summary.hypotheses_hold
    assert np.all(np.asarray(out.summary.nan.drift) > 0.5)
    assert np.all(np.asarray(out.summary.nan.drift) < 0.7)
    after = AfterPrediction(Extrapolated(4))
    out = compiled_generate(broken, MIXED, jnp.ones((AGENTS, 2)), jnp.eye(2), drift=after)
    assert not out.summary.hypotheses_hold
    np.testing.assert_array_equal(out.summary.nan.drift, 0.0)


@pytest.mark.parametrize(
    ("make", "message"),
    [
        (lambda: Held(0), "`evaluations` must be a positive number; got 0"),
        (lambda: Midpoint(5), "`evaluations` must be even, as each step takes two; got 5"),
        (lambda: Extrapolated(5, 4), "`order` must be 2 or 3; got 4"),
        (lambda: Held(5, power=0.0), "`power` must be positive"),
        (lambda: ExtrapolatedEndpoint(5, 1), "`order` must be 2 or 3; got 1"),
        (lambda: AfterPrediction(EveryStep()), "`prediction` must have steps of its own"),
    ],
)
def test_wrong_settings_are_refused(make, message):
    with pytest.raises((ValueError, TypeError), match=message):
        make()
