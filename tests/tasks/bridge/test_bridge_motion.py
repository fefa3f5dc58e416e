"""SE(2) against matrix exponentials and products, and the velocity of a contact point against a moving point."""

import jax
import jax.numpy as jnp
import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from scipy.linalg import expm

from deggflow.tasks.bridge.motion import (
    contact_jacobian,
    contact_velocity,
    displacement,
    integrate,
    rotate,
)

DT = 0.2
speeds = st.floats(-3, 3)
turns = st.floats(-20, 20) | st.floats(-1e-2, 1e-2) | st.just(0.0)
twists = st.tuples(speeds, speeds, turns)


def double(function, *arguments):
    with jax.enable_x64(True):
        return np.asarray(function(*(jnp.asarray(a, jnp.float64) for a in arguments)))


moved = jax.jit(lambda twist: displacement(twist, DT))
integrated = jax.jit(lambda pose, twists: integrate(pose, twists, DT))


jacobian_of_moved = jax.jit(jax.jacobian(lambda twist: displacement(twist, DT)))
velocity = jax.jit(contact_velocity)
jacobian = jax.jit(contact_jacobian)
rotated = jax.jit(rotate)


def hat(twist):
    """Element of se(2)."""
    return np.array([[0, -twist[2], twist[0]], [twist[2], 0, twist[1]], [0, 0, 0]])


def matrix(pose):
    cos, sin = np.cos(pose[2]), np.sin(pose[2])
    return np.array([[cos, -sin, pose[0]], [sin, cos, pose[1]], [0, 0, 1]])


@settings(max_examples=60, deadline=None)
@given(twists)
def test_displacement_is_the_matrix_exponential(twist):
    found = double(moved, np.array(twist))
    np.testing.assert_allclose(matrix(found), expm(DT * hat(twist)), atol=1e-9)
    assert found[2] == pytest.approx(DT * twist[2])  # the angle itself, not only up to whole turns


@settings(max_examples=40, deadline=None)
@given(twists, st.floats(0.1, 0.9))
def test_displacements_of_one_twist_compose(twist, share):
    """exp((s + t) xi) = exp(s xi) exp(t xi), and exp(-t xi) undoes exp(t xi)."""
    part, rest, whole, back = (
        matrix(double(moved, s * np.array(twist))) for s in (share, 1 - share, 1.0, -1.0)
    )
    np.testing.assert_allclose(part @ rest, whole, atol=1e-9)
    np.testing.assert_allclose(back @ whole, np.eye(3), atol=1e-9)


def test_no_twist_no_motion():
    np.testing.assert_array_equal(double(moved, np.zeros(3)), np.zeros(3))


@pytest.mark.parametrize("seed", range(3))
def test_integration_is_the_product_of_exponentials(seed):
    """g_t = g_0 exp(dt xi_1) ... exp(dt xi_t): body twists act from the right."""
    rng = np.random.default_rng(seed)
    pose, sequence = rng.normal(size=3), rng.normal(size=(20, 3)) * [1, 1, 3]
    sequence[4, 2] = 0.0
    found = double(integrated, pose, sequence)
    g = matrix(pose)
    for one, twist in zip(found, sequence, strict=True):
        g = g @ expm(DT * hat(twist))
        np.testing.assert_allclose(matrix(one), g, atol=1e-12)
    np.testing.assert_allclose(found[:, 2], pose[2] + DT * np.cumsum(sequence[:, 2]), atol=1e-12)


def test_integration_does_not_depend_on_where_it_starts():
    """h g_t is what starts at h g_0: left translations commute with body twists."""
    rng = np.random.default_rng(7)
    pose, shift, sequence = rng.normal(size=3), rng.normal(size=3), rng.normal(size=(8, 3))
    start = matrix(shift) @ matrix(pose)
    there = np.array([start[0, 2], start[1, 2], shift[2] + pose[2]])
    for one, other in zip(
        double(integrated, pose, sequence), double(integrated, there, sequence), strict=True
    ):
        np.testing.assert_allclose(matrix(shift) @ matrix(one), matrix(other), atol=1e-12)


@pytest.mark.parametrize("omega", [0.0, 1e-12, 4.9e-3, 5.1e-3, -5.0e-3, 0.3, np.pi / DT])
def test_gradients_are_finite_and_those_of_finite_differences(omega):
    """Also where the turn vanishes, and on both sides of where the series takes over."""
    twist, h = np.array([0.4, -0.3, omega]), 1e-6
    found = double(jacobian_of_moved, twist)
    steps = h * np.eye(3)
    expected = np.stack(
        [(double(moved, twist + s) - double(moved, twist - s)) / (2 * h) for s in steps], 1
    )
    np.testing.assert_allclose(found, expected, atol=1e-7)
    assert np.isfinite(np.asarray(jacobian_of_moved(np.float32(twist)))).all()


def test_contact_velocity_is_that_of_the_moving_point():
    """R^T d/dt (p + R r), by finite differences along the exact motion."""
    rng = np.random.default_rng(3)
    h = 1e-5
    for twist, r in zip(rng.normal(size=(10, 3)), rng.normal(size=(10, 2)), strict=True):
        here, there = (expm(s * hat(twist)) @ [*r, 1.0] for s in (-h, h))
        expected = (there - here)[:2] / (2 * h)
        np.testing.assert_allclose(double(velocity, twist, r), expected, atol=1e-8)
        np.testing.assert_allclose(double(jacobian, r[None])[0] @ twist, expected, atol=1e-8)


def test_rotation_is_multiplication_by_a_unit_complex_number():
    rng = np.random.default_rng(4)
    angle, points = rng.uniform(-9, 9, 12), rng.normal(size=(12, 2))
    expected = np.exp(1j * angle) * (points[:, 0] + 1j * points[:, 1])
    np.testing.assert_allclose(
        double(rotated, angle, points), np.stack([expected.real, expected.imag], -1), atol=1e-12
    )
