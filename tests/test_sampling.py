"""Certified samples in one call, against `generate` and `certify` one by one and against the definitions."""

import itertools
import math

import jax
import jax.numpy as jnp
import numpy as np
import pytest

from deggflow import (
    DecoupledGuidance,
    PrivateRequirement,
    SharedFactor,
    SharedRequirements,
    certify,
    distances,
    generate,
    sample,
)

APART, COUNT, SHAPE = 0.5, 40, (4, 2)


def gather(tau, z, goal):
    """Everybody to one point, far too close to each other."""
    return (goal[None] - z) * (1.0 + 2.0 * tau)


def far(z, goal):
    return distances(z) - APART


def right(tau, z, goal):
    return goal[0] - 0.3 - jnp.mean(z[:, 0])


REQUIREMENTS = (
    PrivateRequirement(far, 0.02, name="apart"),
    SharedRequirements((SharedFactor(right, name="right"),)),
)
GOAL = jnp.array([0.5, -0.2])


def draw(seed=3, count=COUNT, condition=GOAL, **options):
    key = jax.random.key(seed)
    return sample(gather, REQUIREMENTS, condition, key=key, count=count, shape=SHAPE, **options)


def least_distance(z):
    z = np.asarray(z, np.float64)
    return min(math.dist(a, b) for a, b in itertools.combinations(z, 2))


@pytest.fixture(scope="module")
def drawn():
    return draw()


def test_every_sample_keeps_what_its_certificate_says(drawn):
    assert len(drawn) == len(drawn.certificates) == COUNT
    assert drawn.satisfied.all()
    assert drawn.unmet == {}
    for z, said in zip(drawn.z, drawn.certificates, strict=True):
        assert said.satisfied
        margins = {each.name: each.margin for each in said.verdicts}
        assert margins["apart"] == pytest.approx(least_distance(z) - APART, rel=1e-9)
        mean = np.asarray(z, np.float64)[:, 0].mean()
        goal = np.asarray(GOAL, np.float64)
        assert margins["right"] == pytest.approx(mean - (goal[0] - 0.3), rel=1e-9, abs=1e-12)
        assert min(margins.values()) >= 0
    assert str(drawn).splitlines()[0].startswith(f"{COUNT} of {COUNT} samples satisfied, ")


def test_a_sample_depends_on_its_key_and_number_alone(drawn):
    few = draw(count=3)
    np.testing.assert_allclose(
        few.z, drawn.z[:3], atol=5e-3
    )  # batches of other sizes round otherwise
    again = draw()
    np.testing.assert_array_equal(again.z, drawn.z)
    other = draw(4, count=3)
    assert np.abs(other.z - few.z).max() > 0.05


def test_it_is_generate_and_certify(drawn):
    """z(0) is N(0, I) by the key, the sample's number and the draw's."""
    guidance = DecoupledGuidance(REQUIREMENTS)
    for k in (0, 7):
        own = jax.random.fold_in(jax.random.fold_in(jax.random.key(3), k), 0)
        z0 = jax.random.normal(own, SHAPE)
        alone = jax.jit(lambda z0: generate(gather, guidance, z0, GOAL))(z0)
        if drawn.certificates[k].draws == 1:
            np.testing.assert_allclose(alone.z, drawn.z[k], atol=5e-3)
            said = certify(alone, guidance, GOAL)
            assert said.satisfied == drawn.certificates[k].satisfied


def test_a_condition_for_each_sample():
    goals = jnp.linspace(-1.0, 1.0, 5)[:, None] * jnp.ones((1, 2))
    found = draw(count=5, condition=None, conditions=goals)
    assert found.satisfied.all()
    middle = found.z.mean(axis=1)
    assert np.all(np.diff(middle[:, 0]) > 0.2)


def test_what_fails_is_drawn_again_and_counted():
    """Half of all z(0) begin where the requirement can't be met: a flow that stands still and may not act there."""

    def margins(z, condition):
        return jnp.where(z[:, :1] > 0, 1.0, -1.0) + 0.0 * z[:, :1]

    def still(tau, z, condition):
        return jnp.zeros_like(z)

    sided = PrivateRequirement(margins, 0.02, name="sided")
    seen = []
    found = sample(
        still, (sided,), key=jax.random.key(0), count=200, shape=(1, 1), max_draws=3,
        on_progress=seen.append,
    )  # fmt: skip
    draws = np.array([each.draws for each in found.certificates])
    key = jax.random.key(0)
    for k in range(200):
        own = [
            float(jax.random.normal(jax.random.fold_in(jax.random.fold_in(key, k), d), (1, 1))[0, 0])
            for d in range(3)
        ] if k < 12 else []  # fmt: skip
        if own:
            good = [d for d, value in enumerate(own) if value > 0]
            assert draws[k] == (good[0] + 1 if good else 3)
            assert found.satisfied[k] == bool(good)
    assert 0.75 < found.satisfied.mean() < 0.97  # 1 - 2^-3 within four standard deviations
    assert 60 <= (draws == 1).sum() <= 140
    for k, reason in found.unmet.items():
        assert draws[k] == 3
        assert reason == "agent 0 misses sided by 1"
    assert seen[-1].satisfied == found.satisfied.sum()
    assert [each.draw for each in seen] == [1, 2, 3]
    assert seen[0].pending == 200
    assert "samples satisfied" in str(found)


def test_nominal_samples_are_judged_by_the_same_requirements(drawn):
    nominal = draw(guided=False)
    assert not nominal.satisfied.any()
    assert all(each.draws == 1 and each.generation is None for each in nominal.certificates)
    worst = [least_distance(z) - APART for z in nominal.z]
    assert all(each.min_margin <= worst[k] + 1e-9 for k, each in enumerate(nominal.certificates))
    assert len(str(nominal).splitlines()) == 5


def test_padded_teams_have_masks():
    """One call, teams of two to four agents in one program; the mask is in the condition for the functions."""

    def gather_masked(tau, z, mask):
        return (0.5 - z) * (1.0 + 2.0 * tau)

    def far_masked(z, mask):
        return distances(z, mask) - APART

    masks = np.arange(4)[None] < np.array([2, 3, 4, 4, 3, 2])[:, None]
    found = sample(
        gather_masked, (PrivateRequirement(far_masked, 0.02, name="apart"),),
        key=jax.random.key(1), count=6, shape=(4, 2), conditions=masks, masks=masks,
    )  # fmt: skip
    assert found.satisfied.all()
    for z, mask, said in zip(found.z, masks, found.certificates, strict=True):
        assert said.min_margin == pytest.approx(least_distance(z[mask]) - APART, rel=1e-9)


def test_another_p0():
    found = draw(count=2, initial=lambda key, shape: 0.1 + 0.0 * jax.random.normal(key, shape))
    np.testing.assert_allclose(found.z[0], found.z[1], atol=1e-6)
