"""Sums have one V in units of their buffers, tuples one each; labels, settings, padded teams and conditions."""

from dataclasses import replace

import jax
import jax.numpy as jnp
import numpy as np
import pytest

from deggflow import PrivateRequirement, distances, sample, verdicts
from deggflow import requirements as req
from deggflow.guidance import PowerSchedule

DISC = req.Disc((1.0, 0.0), 0.6)
APART = req.apart(distance=0.5, buffer=0.02)
OUTSIDE = req.outside(DISC, buffer=0.05)


def field(tau, z, condition):
    """A flow to points on the unit circle, far too close to each other."""
    return (condition["targets"] - z) / (1.5 - tau)


ANGLE = jnp.linspace(0.0, 1.2, 5)
CONDITION = {"targets": jnp.stack([jnp.cos(ANGLE), jnp.sin(ANGLE)], axis=-1)}


def test_the_sums_v_measures_each_margin_in_its_own_buffer():
    z = jax.random.normal(jax.random.key(0), (5, 2)) * 0.5
    whole = APART + OUTSIDE
    expected = APART.violation(z, None) / 0.02**2 + OUTSIDE.violation(z, None) / 0.05**2
    assert whole.violation(z, None) == pytest.approx(float(expected), rel=1e-5)
    assert whole.floor == 0.5
    assert (whole.name, whole.names) == ("apart + outside", ("apart + outside",))


def test_sums_are_associative():
    z = jax.random.normal(jax.random.key(1), (5, 2)) * 0.5
    own = PrivateRequirement(lambda z, _: 1.0 - z, 0.1, name="own", margin_labels=("x", "y"))
    one, other = (APART + OUTSIDE) + own, APART + (OUTSIDE + own)
    assert one.name == other.name == "apart + outside + own"
    assert jnp.array_equal(one.margins(z, None), other.margins(z, None))
    assert one.violation(z, None) == pytest.approx(float(other.violation(z, None)))
    far = jnp.array([[0.0, 3.0], [5.0, 0.0], [0.0, 9.0], [-5.0, 0.0], [0.0, -5.0]])
    [verdict] = verdicts(far, (one,))
    assert verdict.reason == "agent 2 misses apart + outside + own (y) by 8"


def test_a_function_of_ones_own_is_a_summand_and_keeps_its_mask():
    own = PrivateRequirement(lambda z, condition: 10.0 - z[:, :1], 0.1)
    z = jnp.array([[0.0, 0.0], [50.0, 0.0]])
    mask = jnp.array([True, False])
    assert jnp.isinf((own + OUTSIDE)._judged(mask)(z, None)[1]).all()


def test_settings_must_agree():
    late = replace(OUTSIDE, omega=PowerSchedule(8.0))
    with pytest.raises(ValueError, match="`omega` of 'apart' is LinearSchedule"):
        APART + late
    assert (replace(APART, omega=PowerSchedule(8.0)) + late).omega == PowerSchedule(8.0)
    with pytest.raises(ValueError, match="`buffer` of each requirement of a sum must be positive"):
        APART + replace(OUTSIDE, buffer=0.0)
    with pytest.raises(TypeError, match="unsupported operand"):
        APART + 3


@pytest.mark.parametrize("requirements", [(APART + OUTSIDE,), (APART, OUTSIDE)])
def test_sums_and_tuples_guide_and_judge(requirements):
    result = sample(field, requirements, CONDITION, key=jax.random.key(0), count=16, shape=(5, 2))
    assert result.satisfied.all()
    for z, certificate in zip(result.z, result.certificates, strict=True):
        near = np.linalg.norm(z[:, None] - z[None], axis=-1) + 9.0 * np.eye(5)
        assert near.min() >= 0.5
        assert np.linalg.norm(z - np.array([[1.0, 0.0]]), axis=-1).min() >= 0.6
        assert certificate.satisfied
    nominal = sample(
        field, requirements, CONDITION, key=jax.random.key(0), count=4, shape=(5, 2), guided=False
    )
    assert not nominal.satisfied.any()
    assert " misses apart" in nominal.unmet[0]
    assert nominal.unmet[0].endswith(" m")


def test_obstacles_and_limits_come_from_each_samples_condition():
    """Regions are pytrees: one for each sample, by the names of entries of the condition."""
    count = 6
    conditions = {
        "targets": np.broadcast_to(np.asarray(CONDITION["targets"]), (count, 5, 2)),
        "disc": jax.tree.map(lambda leaf: np.stack([leaf] * count).astype(np.float32), DISC),
        "distance": np.linspace(0.2, 0.5, count).astype(np.float32),
    }
    safe = req.apart(distance="distance", buffer=0.02) + req.outside("disc", buffer=0.02)
    result = sample(
        field, (safe,), conditions=conditions, key=jax.random.key(0), count=count, shape=(5, 2)
    )
    assert result.satisfied.all()
    for z, distance in zip(result.z, conditions["distance"], strict=True):
        assert np.min(np.asarray(distances(jnp.asarray(z)))) >= distance - 1e-6
    with pytest.raises(ValueError, match="the condition must have an entry 'disc'"):
        req.outside("disc").margins(jnp.zeros((2, 2)), {"targets": 0.0})


def test_padded_teams_need_no_mask_in_the_condition():
    mask = np.array([True, True, False, True, True])
    result = sample(
        field,
        (APART + OUTSIDE,),
        CONDITION,
        key=jax.random.key(0),
        count=4,
        shape=(5, 2),
        mask=mask,
    )
    assert result.satisfied.all()


def test_reasons_name_agents_and_waypoints():
    layout = req.trajectories(3, start=np.array([[0.0, 0.0], [0.0, 1.0]]))
    crossing = req.apart(radius=0.25, layout=layout)
    z = jnp.array([[9.0, 9.0, 1.0, 1.0, 2.0, 1.0], [9.0, 9.0, 1.0, 0.0, 2.0, 0.0]])
    [verdict] = verdicts(z, (crossing,), agents=("robot 0", "robot 1"))
    assert (
        verdict.reason == "robot 0 misses apart (from robot 1 between waypoints 0 and 1) by 0.5 m"
    )
    wall = req.outside(req.Box((1.5, 0.5), (0.01, 3.0)), layout=layout)
    [verdict] = verdicts(z, (wall,))
    assert verdict.reason.startswith(
        "agent 0 misses outside (from region 0 between waypoints 1 and 2) by 0.5"
    )


def test_ends_that_are_held():
    start = np.array([[0.0, 0.0], [0.0, 1.0]])
    layout = req.trajectories(3, start=start, goal="goal")
    z = jax.random.normal(jax.random.key(0), (2, 6))
    paths = layout.paths(z, {"goal": start + 1.0})
    assert jnp.array_equal(paths[:, 0], start)
    assert jnp.array_equal(paths[:, 2], start + 1.0)
    assert jnp.array_equal(paths[:, 1], z[:, 2:4])
    with pytest.raises(ValueError, match=r"`start` must have shape \(3, 2\)"):
        layout.paths(jnp.zeros((3, 6)), {"goal": start})
    with pytest.raises(ValueError, match="a state must have 6 numbers per agent, 3 waypoint"):
        layout.paths(jnp.zeros((2, 4)), {"goal": start})
