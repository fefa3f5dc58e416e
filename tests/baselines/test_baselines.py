"""Every baseline by what its own paper says of it, on disks that must keep apart."""

from itertools import pairwise

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
import pytest

from deggflow.baselines import (
    DualFlow,
    EndpointProjection,
    FadingField,
    JointBarrier,
    PenaltyGradient,
    SplitBarrier,
    predict_then_correct,
)
from deggflow.generation import generate, refined_grid
from deggflow.guidance import NoGuidance

APART = 1.0
PAIRS = [(0, 1), (0, 2), (1, 2)]


def margins(z, condition):
    """Distances of three disks less what is wanted, and room to a wall on the right of the first."""
    gaps = [jnp.sqrt(jnp.sum((z[i] - z[j]) ** 2)) - APART for i, j in PAIRS]
    return jnp.stack([*gaps, 1.2 - z[0, 0]])


def violation(z, condition):
    return jnp.zeros(3).at[0].set(jnp.sum(jnp.maximum(0.05 - margins(z, condition), 0.0) ** 2) / 2)


def field(tau, z, condition):
    """To three places too close to each other, the first of them behind the wall."""
    return (jnp.array([[1.5, 0.0], [0.9, 0.3], [-0.2, 0.1]]) - z) / jnp.maximum(1 - tau, 1e-3)


JOINT = JointBarrier(margins, 2.0, 0.01)
BASELINES = {
    "joint": JOINT,
    "split": SplitBarrier(margins, 2.0, 0.01),
    "penalty": PenaltyGradient(violation, 50.0),
    "projection": EndpointProjection(margins, 10, 0.5, 0.01),
    "dual": DualFlow(margins, 2.0, 4.0, 0.01),
}


def sample(name, z0):
    return generate(field, BASELINES[name], z0, None).z


def state(seed=0):
    return jax.random.normal(jax.random.key(seed), (3, 2))


@pytest.mark.parametrize("name", BASELINES)
def test_a_baseline_brings_about_what_the_field_does_not(name):
    run = jax.jit(lambda z0: sample(name, z0))
    for seed in range(4):
        nominal = generate(field, NoGuidance(), state(seed), None).z
        assert float(jnp.min(margins(nominal, None))) < -0.2
        assert float(jnp.min(margins(run(state(seed)), None))) > -2e-3


def slopes(z, step=1e-3):
    """dh/dz by central differences."""
    flat = np.asarray(z, float).reshape(-1)

    def h(x):
        return np.asarray(margins(jnp.asarray(x.reshape(z.shape), jnp.float32), None), float)

    moves = step * np.eye(flat.size)
    found = np.stack([(h(flat + move) - h(flat - move)) / (2 * step) for move in moves], axis=-1)
    return found.reshape(-1, *z.shape)


@pytest.mark.parametrize("name", ["joint", "split"])
def test_barrier_rows_hold_at_the_input(name):
    tau, baseline = jnp.float32(0.4), BASELINES[name]
    for seed in range(3):
        z = state(seed)
        drift = field(tau, z, None)
        u = np.asarray(baseline.correction(tau, z, drift, None))
        rate = np.sum(slopes(z) * (np.asarray(drift) + u)[None], axis=(1, 2))
        least = -2.0 / 0.6 * (np.asarray(margins(z, None)) - 0.01)
        assert np.all(rate >= least - 2e-2 * (1 + np.abs(least)))


def test_a_shared_row_is_split_equally_between_the_two_it_touches():
    z = jnp.array([[0.0, 0.0], [0.5, 0.0], [0.0, 9.0]])
    u = BASELINES["split"].correction(jnp.float32(0.0), z, jnp.zeros_like(z), None)
    # Half a metre short, closed at the rate of 2 (0.5 + 0.01), one half each.
    assert np.asarray(u) == pytest.approx(
        np.array([[-0.51, 0.0], [0.51, 0.0], [0.0, 0.0]]), abs=1e-3
    )


def test_the_penalty_runs_down_the_slope_of_the_violation():
    z, tau = state(3), jnp.float32(0.75)
    u = np.asarray(BASELINES["penalty"].correction(tau, z, jnp.zeros_like(z), None))
    short = np.maximum(0.05 - np.asarray(margins(z, None)), 0.0)
    expected = 50.0 / 0.25 * np.einsum("k,kad->ad", short, slopes(z))
    assert u == pytest.approx(expected, rel=2e-2, abs=1e-2)


def test_the_projection_onto_one_half_space_is_exact_and_nothing_moves_inside():
    def wall(z, condition):
        return (0.3 - z[0, 0])[None]

    baseline = EndpointProjection(wall, 10)
    outside = jnp.array([[1.0, 2.0], [3.0, 4.0]])
    assert np.asarray(baseline.project(outside, None)) == pytest.approx(
        np.array([[0.3, 2.0], [3.0, 4.0]]), abs=1e-5
    )
    inside = outside.at[0, 0].set(-1.0)
    assert np.asarray(baseline.project(inside, None)) == pytest.approx(np.asarray(inside))


def test_the_projected_endpoint_is_where_the_last_step_ends():
    baseline, z0 = BASELINES["projection"], state(5)
    out = generate(field, baseline, z0, None, keep_path=True)
    last = out.path[-2]
    tau = refined_grid()[-2]
    end = last + (1 - tau) * field(tau, last, None)
    assert np.asarray(out.z) == pytest.approx(np.asarray(baseline.project(end, None)), abs=1e-4)


def test_multipliers_grow_only_with_violation_and_by_euler_steps():
    baseline, z = BASELINES["dual"], jnp.array([[0.0, 0.0], [5.0, 0.0], [0.0, 5.0]])
    start, half = baseline.init(z, None), jnp.float32(0.5)
    assert np.array_equal(start.value, np.zeros(len(margins(z, None))))
    drift = field(half, z, None)
    still, u, _ = baseline(start, half, z, drift, None)
    assert np.array_equal(u, np.zeros((3, 2)))
    assert np.array_equal(still.rate, np.zeros(len(still.rate)))
    near = z.at[1].set(jnp.array([0.4, 0.0]))
    grown, u, _ = baseline(start, half, near, drift, None)
    assert np.asarray(grown.rate)[:3] == pytest.approx([2 / 0.5 * 0.61, 0, 0], rel=1e-4)
    assert u[:2] == pytest.approx(np.array([[-1, 0], [1, 0]]) * 4 / 0.5 * 0.61, rel=1e-4)
    later, _, _ = baseline(grown, jnp.float32(0.6), near, drift, None)
    assert np.asarray(later.value)[0] == pytest.approx(0.1 * 2 / 0.5 * 0.61, rel=1e-4)


def test_a_generation_carries_the_multipliers_from_point_to_point():
    """The same steps by hand, in NumPy's order of things."""
    baseline, z = BASELINES["dual"], state(5)
    made = generate(field, baseline, z, None, grid=refined_grid(20), keep_path=True)
    here, grid = baseline.init(z, None), np.asarray(refined_grid(20))
    for k, (tau, after) in enumerate(pairwise(grid)):
        drift = field(tau, z, None)
        here, u, _ = baseline(here, jnp.asarray(tau), z, drift, None)
        np.testing.assert_allclose(made.path[k], z, rtol=1e-4, atol=1e-5)
        z = z + (after - tau) * (drift + u)
    assert np.asarray(here.value).max() > 0


def test_a_correction_moves_nothing_where_all_holds_and_brings_about_what_does_not():
    def far(tau, z, condition):
        return (jnp.array([[0.0, 0.0], [3.0, 0.0], [0.0, 3.0]]) - z) / jnp.maximum(1 - tau, 1e-3)

    z0 = jnp.stack([state(seed) for seed in range(3)])
    run = eqx.filter_jit(predict_then_correct)
    ends = run(far, JOINT, z0, None, steps=100, pull=0.0).z
    nominal = jax.vmap(lambda z: generate(far, NoGuidance(), z, None, grid=refined_grid(50, 1.0)).z)
    assert np.asarray(ends) == pytest.approx(np.asarray(nominal(z0)), abs=1e-4)
    near = run(field, JOINT, z0, None, steps=100, pull=0.0).z
    assert float(jnp.min(jax.vmap(lambda z: margins(z, None))(near))) > -2e-3


def test_the_field_of_a_correction_fades_from_its_pull_to_nothing():
    z, fading = state(2), FadingField(field, 2.0)
    for tau in (0.0, 0.25):
        assert np.asarray(fading(jnp.float32(tau), z, None)) == pytest.approx(
            2.0 * (1 - tau) * np.asarray(field(jnp.float32(tau), z, None)), rel=1e-5
        )
    assert np.array_equal(fading(jnp.float32(1.0), z, None), np.zeros_like(z))


def test_agents_that_have_stopped_get_no_input():
    z = jnp.array([[0.0, 0.0], [0.5, 0.0], [0.0, 9.0]])
    moving = jnp.array([True, False, True])
    _, u, report = JOINT(None, jnp.float32(0.0), z, jnp.zeros_like(z), None, moving)
    assert float(jnp.abs(u[0]).sum()) > 0
    assert np.array_equal(u[1], [0.0, 0.0])
    assert np.asarray(report.input_norm) == pytest.approx(np.linalg.norm(np.asarray(u), axis=-1))
