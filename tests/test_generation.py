import diffrax
import jax
import jax.numpy as jnp
import numpy as np
import pytest

from deggflow import (
    DecoupledGuidance,
    NoGuidance,
    PrivateRequirement,
    SharedFactor,
    SharedRequirements,
    StepGuard,
    generate,
    generate_batch,
    refined_grid,
)

MATRIX = jnp.array([[-1.0, 2.0], [-2.0, -0.5]])


def field(tau, z, condition):
    return z @ MATRIX.T + jnp.sin(3 * tau)


@pytest.fixture
def z0(key):
    return jax.random.normal(key, (3, 2))


@pytest.mark.parametrize("power", [1.0, 2.0, 3.0])
def test_grid_runs_from_zero_to_one_and_narrows(power):
    grid = np.asarray(refined_grid(50, power), np.float64)
    assert grid[0] == 0
    assert grid[-1] == 1
    steps = np.diff(grid)
    assert np.all(steps > 0)
    assert np.all(np.diff(steps) <= 1e-6)


@pytest.mark.parametrize(("steps", "power", "name"), [(0, 2.0, "steps"), (10, 0.0, "power")])
def test_bad_grids_are_refused(steps, power, name):
    with pytest.raises(ValueError, match=f"`{name}` must"):
        refined_grid(steps, power)


def test_nominal_generation_equals_diffrax(z0):
    grid = refined_grid(40)
    ours = generate(field, NoGuidance(), z0, None, grid=grid, keep_path=True)
    theirs = diffrax.diffeqsolve(
        diffrax.ODETerm(lambda t, y, args: field(t, y, None)),
        diffrax.Euler(),
        0.0,
        1.0,
        None,
        z0,
        stepsize_controller=diffrax.StepTo(grid),
        saveat=diffrax.SaveAt(ts=grid),
    )
    np.testing.assert_allclose(ours.path, theirs.ys, atol=1e-5)


def test_euler_converges_at_first_order(z0):
    def end(steps):
        return np.asarray(generate(field, NoGuidance(), z0, None, grid=refined_grid(steps)).z)

    exact = diffrax.diffeqsolve(
        diffrax.ODETerm(lambda t, y, args: field(t, y, None)),
        diffrax.Tsit5(),
        0.0,
        1.0,
        0.01,
        z0,
        stepsize_controller=diffrax.PIDController(rtol=1e-6, atol=1e-7),
    ).ys[-1]
    errors = [np.abs(end(steps) - np.asarray(exact)).max() for steps in (50, 100, 200)]
    rates = np.log2([errors[0] / errors[1], errors[1] / errors[2]])
    np.testing.assert_allclose(rates, 1.0, atol=0.15)


def test_path_and_trace_are_those_of_the_grid(z0):
    grid = refined_grid(10)
    out = generate(field, NoGuidance(), z0, None, grid=grid, keep_path=True)
    assert out.path.shape == (11, 3, 2)
    np.testing.assert_array_equal(out.path[0], z0)
    np.testing.assert_array_equal(out.path[-1], out.z)
    np.testing.assert_array_equal(out.trace.tau, grid)
    assert int(out.work.evaluations) == 11
    assert generate(field, NoGuidance(), z0, None, grid=grid).path is None


AGENTS, BUFFER = 3, 0.05


def wall(tau, z, condition):
    """The agents' mean keeps within a disk that is steep to leave."""
    return 5.0 * (jnp.sum(jnp.mean(z, axis=0) ** 2) - 0.25)


def margins(z, condition):
    """Agents keep 1.0 apart."""
    offset = z[:, None] - z[None] + 10.0 * jnp.eye(AGENTS)[..., None]
    return jnp.linalg.norm(offset, axis=-1) - 1.0


def crowd(tau, z, condition):
    """Everybody to one point, ever faster."""
    return (jnp.ones((1, 2)) - z) * (2.0 + 6.0 * tau) + jnp.tanh(z @ condition)


MIXED = DecoupledGuidance(
    (
        SharedRequirements((SharedFactor(wall),)),
        PrivateRequirement(margins, BUFFER),
    )
)


@pytest.mark.rounding
@pytest.mark.parametrize(
    ("guard", "stopping", "keep_path", "samples"),
    [
        (None, True, True, 5),
        (StepGuard(), True, True, 40),
        (StepGuard(), False, False, 5),  # too few for a part to be finished by itself
    ],
)
def test_a_batch_is_what_its_samples_are_alone(guard, stopping, keep_path, samples):
    """State, path, trace and work of every sample, though some have their steps halved and others not."""
    rng = np.random.default_rng(8)
    z0, swirl = 2.0 * rng.normal(size=(samples, AGENTS, 2)), rng.normal(size=(samples, 2, 2))
    stops = rng.uniform(0.2, 1.4, (samples, AGENTS)) if stopping else None
    with jax.enable_x64(True):
        z0, swirl, stops = jax.tree.map(jnp.asarray, (z0, swirl, stops))
        options = {"grid": refined_grid(14), "guard": guard, "keep_path": keep_path}

        def alone(z0, swirl, stops):
            return generate(crowd, MIXED, z0, swirl, stops=stops, **options)

        @jax.jit
        def batch(z0, swirl, stops):
            return generate_batch(crowd, MIXED, z0, swirl, stops=stops, **options)

        run = jax.jit(alone)
        each = [
            run(*jax.tree.map(lambda leaf, k=k: leaf[k], (z0, swirl, stops)))
            for k in range(samples)
        ]
        expected = jax.tree.map(lambda *leaves: np.array(leaves), *each)
        together = jax.tree.map(np.asarray, batch(z0, swirl, stops))
    if samples == 40:
        assert len(set(expected.work.evaluations.tolist())) > 4  # they take differently long
    assert (together.path is not None) == keep_path
    if keep_path:  # it is what the trace is of, and ends at z(1)
        mean = together.path.mean(2)
        np.testing.assert_allclose(
            together.trace.value[..., 0], 5 * ((mean**2).sum(-1) - 0.25), rtol=1e-9, atol=1e-9
        )
        np.testing.assert_array_equal(together.path[:, -1], together.z)
    assert jax.tree.structure(together) == jax.tree.structure(expected)
    for found, wanted in zip(jax.tree.leaves(together), jax.tree.leaves(expected), strict=True):
        assert found.shape == wanted.shape
        if wanted.dtype == np.float64:
            np.testing.assert_allclose(found, wanted, rtol=1e-7, atol=1e-8)
        else:
            np.testing.assert_array_equal(found, wanted)


@pytest.mark.parametrize("guard", [None, StepGuard()])
def test_the_last_point_is_looked_at_though_the_field_is_infinite_there(guard):
    """The straight flow onto a point, (x1 - z) / (1 - tau): its end is reached and its values are in the trace."""
    target = jnp.array([[0.0, 0.0], [0.3, 0.0]])

    def straight(tau, z, condition):
        return (target - z) / (1 - tau)

    def far(tau, z, condition):
        return jnp.sum(jnp.mean(z, axis=0) ** 2) - 9.0

    guidance = DecoupledGuidance((SharedRequirements((SharedFactor(far),)),))
    run = jax.jit(
        lambda z: generate(straight, guidance, z, None, grid=refined_grid(20), guard=guard)
    )
    out = run(jnp.array([[1.0, 2.0], [2.0, 0.5]]))
    np.testing.assert_allclose(out.z, target, atol=1e-5)
    assert out.trace.tau.shape == (21,)
    assert out.trace.tau[-1] == 1
    mean = np.asarray(out.z, np.float64).mean(0)
    assert out.trace.value[-1, 0] == pytest.approx(mean @ mean - 9.0, rel=1e-5)
    # The field there is 0/0 or x/0, as rounding has it; what would be done about it counts for nothing.
    summary = out.summary
    assert summary.hypotheses_hold
    np.testing.assert_array_equal(summary.largest_input_norm, 0.0)
    assert np.isfinite(summary.excess).all()


def test_a_condition_of_many_parts_goes_with_its_sample():
    """Leaves of a nested condition are each sample's own."""

    def still(tau, z, condition):
        speed, (shift,) = condition["speed"], condition["rest"]
        return speed * jnp.ones_like(z) + shift

    samples = 20
    condition = {
        "speed": jnp.arange(float(samples)),
        "rest": (jnp.arange(2.0 * samples).reshape(-1, 1, 2),),
    }
    z0 = jnp.zeros((samples, 1, 2))
    for guard in (None, StepGuard()):
        out = generate_batch(still, NoGuidance(), z0, condition, grid=refined_grid(4), guard=guard)
        expected = condition["speed"][:, None, None] + condition["rest"][0]
        np.testing.assert_allclose(out.z, expected, rtol=1e-5)
        assert np.all(np.asarray(out.work.evaluations) == 5)
