"""Points that know one another's states only as they were some steps ago (docs/theory.md, section 6)."""

import numpy as np
import pytest

RADIUS, KAPPA, RHO = 0.5, 1.15, 0.75
POWER = KAPPA / (1 - RHO)
STEPS = 1000
SPEED = 2.0  # bound on |v_i|, which is checked
LEAST = RADIUS / 2  # distance below which no pair comes


def violations(z, buffer):
    """V_j of every point: half of each of its pairs' squared violations."""
    apart = np.linalg.norm(z[:, None] - z[None], axis=-1) + 9 * np.eye(len(z))
    return (np.maximum(buffer + RADIUS - apart, 0.0) ** 2).sum(1) / 2


def gradient(z, i, buffer):
    """grad_i of the sum of the V_j."""
    offset = np.delete(z[i] - z, i, axis=0)
    apart = np.linalg.norm(offset, axis=-1, keepdims=True)
    return (-2 * np.maximum(buffer + RADIUS - apart, 0.0) * offset / apart).sum(0)


def values_until_small(z0, drift, buffer, age):
    """V at every Euler step of a pair whose rows are tightened, until it is small.

    Args:
        z0: Where the points start.
        drift: f_i of each.
        buffer: Of the margins.
        age: Steps by which states of the other are old.
    """
    size = 1 / STEPS  # omega = 1, so that R = 1 - tau
    error, lipschitz = age * size * SPEED, 2 * (1 + (buffer + RADIUS) / LEAST)
    path, values = [z0] * (age + 1), [violations(z0, buffer).sum()]
    while values[-1] > 1e-3:
        z, velocity = path[-1], drift.copy()
        assert np.linalg.norm(z[0] - z[1]) > LEAST
        for i in range(2):
            view = path[-1 - age].copy()
            view[i] = z[i]
            slope = gradient(view, i, buffer)
            rest = 1 - (len(values) - 1) * size
            demand = POWER / rest * violations(view, buffer + error)[i]
            if slope @ drift[i] + lipschitz * error * np.linalg.norm(drift[i]) + demand > 0:
                room = np.linalg.norm(slope) - lipschitz * error
                assert room > 0
                velocity[i] = -slope / np.linalg.norm(slope) * demand / room
        assert np.linalg.norm(velocity, axis=1).max() <= SPEED
        path.append(z + size * velocity)
        values.append(violations(path[-1], buffer).sum())
    return np.array(values)


@pytest.mark.parametrize("age", [0, 1, 4])
def test_v_decays_as_with_current_states_where_rows_are_tightened(age):
    rng = np.random.default_rng(age)
    for _ in range(3):
        z0 = np.array([[0.0, 0.0], [0.35, 0.0]]) + rng.normal(size=(2, 2)) * 0.02
        values = values_until_small(z0, rng.normal(size=(2, 2)) * 0.05, 0.2, age)
        tau = np.arange(len(values)) / STEPS
        assert len(values) > 100
        assert np.all(values <= values[0] * (1 - tau) ** POWER * (1 + 1e-6))


def test_the_buffer_pays_for_the_distance_that_the_other_has_moved():
    """A pair whose gradient is shorter than the margin has a violation below e (1 + y / |z_i - z_j|)."""
    rng = np.random.default_rng(0)
    buffer, error = 0.2, 0.02
    for _ in range(1000):
        z = rng.normal(size=(2, 2)) * 0.5
        apart = np.linalg.norm(z[0] - z[1])
        y = buffer + RADIUS - apart
        if y <= 0 or apart < 0.2:
            continue
        nearby = z.copy()
        away = rng.normal(size=2)
        nearby[1] += error * away / np.linalg.norm(away)
        change = np.linalg.norm(gradient(nearby, 0, buffer) - gradient(z, 0, buffer))
        # On the way the distance may have been shorter by e, and the violation larger.
        assert change <= 2 * error * (1 + (y + error) / (apart - error)) + 1e-12
        assert np.isclose(np.linalg.norm(gradient(z, 0, buffer)), 2 * y)
