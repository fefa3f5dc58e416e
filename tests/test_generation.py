import diffrax
import jax
import jax.numpy as jnp
import numpy as np
import pytest

from deggflow import NoGuidance, generate, refined_grid

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
    np.testing.assert_array_equal(out.trace.tau, grid[:-1])
    assert generate(field, NoGuidance(), z0, None, grid=grid).path is None
