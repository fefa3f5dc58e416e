"""What was generated under another bound, condition or requirement is not held to be what is asked about."""

import jax
import jax.numpy as jnp
import numpy as np
import pytest
from gathering_cases import BUFFER, guided, mean_x

from deggflow import (
    DecoupledGuidance,
    PrivateRequirement,
    SharedFactor,
    SharedRequirements,
    TighteningBound,
    certify,
    generate,
    safe_norm,
)
from deggflow.identity import fingerprint, requirement_numbers


def test_a_sample_of_one_bound_is_judged_by_the_bound_asked_about():
    def factor(end):
        bound = TighteningBound(end=lambda condition: end)
        return SharedRequirements((SharedFactor(mean_x, bound, name="left"),))

    sample = guided((factor(30.0),), field=lambda tau, z, condition: 3.0 * jnp.ones_like(z))
    assert certify(sample, (factor(30.0),)).generation.hypotheses_hold
    other = certify(sample, (factor(0.0),))
    assert not other.satisfied
    assert other.min_margin == pytest.approx(-float(np.mean(np.asarray(sample.z, float)[:, 0])))
    assert not other.generation.hypotheses_hold
    assert other.generation.first_failure.startswith(
        "the sample was generated under other requirements: "
    )
    assert other.generation.requirements == ()


@pytest.mark.parametrize("slack", [0.02, 0.5])
def test_a_bound_that_began_elsewhere_is_another_bound(slack):
    """The same end, and so the same verdict; but the record is of a way that was not promised."""
    made, asked = (
        SharedRequirements((SharedFactor(mean_x, TighteningBound(slack=own), name="left"),))
        for own in (slack, 0.02)
    )
    said = certify(guided((made,)), (asked,))
    assert said.satisfied
    assert said.generation.hypotheses_hold == (slack == 0.02)


def test_a_sample_of_another_condition_is_not_held():
    """An obstacle that stood elsewhere: V is zero at both ends under either, but not on the way."""

    def outside(z, condition):
        return safe_norm(z - condition["disc"][None])[:, None] - 0.3

    def to_the_right(tau, z, condition):
        return jnp.array([[2.0, 0.0]]) + 0.0 * z

    one = (PrivateRequirement(outside, BUFFER, name="outside"),)
    apart, between = {"disc": np.array([0.0, 5.0])}, {"disc": np.array([0.0, 0.1])}
    z0 = np.array([[-1.0, 0.0]], np.float32)
    sample = generate(to_the_right, DecoupledGuidance(one), z0, apart)
    assert certify(sample, one, apart).generation.hypotheses_hold
    assert certify(sample, one, {"disc": jnp.asarray(apart["disc"])}).generation.hypotheses_hold
    said = certify(sample, one, between)
    assert said.satisfied
    assert not said.generation.hypotheses_hold
    assert said.generation.first_failure == "the sample was generated under another condition"


@pytest.mark.parametrize("dtype", [np.float32, np.float64])
def test_a_fingerprint_sees_every_entry_and_its_place(dtype):
    rng = np.random.default_rng(0)
    with jax.enable_x64(dtype == np.float64):
        given = {"a": rng.normal(size=(4, 3)).astype(dtype), "b": np.arange(5), "c": np.array(True)}
        first = fingerprint(given, dtype)
        assert first.shape == (3,)
        np.testing.assert_array_equal(first, jax.jit(lambda c: fingerprint(c, dtype))(given))
        for k in range(12):
            other = given["a"].copy()
            other.flat[k] = np.nextafter(other.flat[k], dtype(9), dtype=dtype)
            assert fingerprint({**given, "a": other}, dtype)[0] != first[0]
        assert fingerprint({**given, "a": given["a"][::-1]}, dtype)[0] != first[0]
        assert fingerprint({**given, "b": np.arange(5)[::-1]}, dtype)[1] != first[1]
        assert fingerprint({**given, "c": np.array(False)}, dtype)[2] != first[2]


def one_of(buffer=0.02, least=0.1, scale=1.0, text="a", apart=None):
    """A requirement whose function closes over what it asks."""
    apart = jnp.asarray(1.0) if apart is None else apart

    def margins(z, condition):
        return scale * apart * (jnp.abs(z) - least) + 0.0 * len(text)

    return PrivateRequirement(margins, buffer=buffer, name="clear")


OTHERS = [
    {"buffer": 0.05}, {"least": 0.11}, {"scale": 2.0}, {"text": "b"},
    {"apart": jnp.asarray(2.0)}, {"apart": np.array(1.5)},
]  # fmt: skip


def test_requirements_have_numbers_of_their_own():
    """The same settings, functions and closed-over values have the same number; anything else has another."""
    (number,) = requirement_numbers([one_of()])
    assert number == requirement_numbers([one_of()])[0] != 0
    others = [requirement_numbers([one_of(**other)])[0] for other in OTHERS]
    assert len({number, *others}) == len(OTHERS) + 1

    @jax.jit
    def inside(scale):
        return jnp.asarray(requirement_numbers([one_of(scale=scale)]))

    assert inside(2.0)[0] == 0  # not known there: it stands for any


@pytest.mark.parametrize("other", OTHERS)
def test_nothing_is_held_under_requirements_that_were_changed_where_nobody_looks(other):
    """Far from what is required at both ends, so that values and limits there are the same."""

    def along(tau, z, condition):
        return jnp.full_like(z, -4.0)

    z0 = jnp.array([[2.0], [3.0]])
    made = generate(along, DecoupledGuidance((one_of(),)), z0, None)
    assert certify(made, (one_of(),), None).generation.hypotheses_hold
    found = certify(made, (one_of(**other),), None).generation
    assert not found.hypotheses_hold
    assert (
        found.first_failure
        == "the sample was generated under other requirements: `clear` is another"
    )


def test_a_generation_that_ends_far_away_is_still_compared_at_its_start():
    """Values of far states are compared loosely; those of z(0) are not."""

    def away(tau, z, condition):
        return 60.0 * z

    def value(tau, z, condition):
        return jnp.sum(1.0 / (1.0 + z**2)) - condition

    limits = [
        SharedRequirements((SharedFactor(value, TighteningBound(slack=s)),)) for s in (0.02, 0.5)
    ]
    z0 = jnp.array([[1.0], [1.5]])
    made = generate(away, DecoupledGuidance((limits[0],)), z0, 1.0)
    assert np.abs(made.z).max() > 1e10
    summary = made.summary._replace(requirements=np.zeros(1, np.uint32))  # as if nothing were known
    found = certify(made._replace(summary=summary), (limits[1],), 1.0).generation
    assert found.first_failure.startswith(
        "the sample was generated under other requirements: the limit at tau = 0"
    )
