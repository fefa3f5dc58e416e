"""Certificates where a value, a gradient or a state is not a finite number, at kinks, and where steps are forced."""

import re

import jax
import jax.numpy as jnp
import numpy as np
import pytest
from gathering_cases import BUFFER, Z0, far, gather, guided, still

from deggflow import (
    EULER,
    HEUN,
    DecoupledGuidance,
    PrivateRequirement,
    SharedFactor,
    SharedRequirements,
    Trajectory,
    certify,
    certify_batch,
    distances,
    generate_batch,
    refined_grid,
    safe_norm,
)

# Not a number


def sharp(z, condition):
    """The usual trap: the gradient of a norm at zero is not a number, whatever `where` comes after it."""
    norm = jnp.linalg.norm(z[:, None] - z[None], axis=-1)
    return jnp.where(jnp.eye(len(z), dtype=bool), 1.0, norm - 0.3)


def undefined(z, condition):
    return jnp.log(z[:, :1] - 0.1) + 5.0


def broken_field(tau, z, condition):
    return jnp.where(
        (tau > 0.3) & (jnp.arange(len(z)) == 1)[:, None], jnp.nan, gather(tau, z, None)
    )


@pytest.mark.parametrize(
    ("field", "margins", "text"),
    [
        (gather, sharp, "the gradient of apart is not a number at agent 0, tau = 0"),
        (gather, undefined, "the value of apart is not a number at agent 0, tau = 0"),
        (broken_field, far, r"the field is not a finite number at agent 1, tau = 0\.3\d*"),
    ],
)
def test_not_a_number_is_called_that(field, margins, text):
    one = PrivateRequirement(margins, BUFFER, name="apart")
    said = certify(guided((one,), field=field), (one,))
    assert not said.generation.hypotheses_hold
    assert re.fullmatch(text, said.generation.first_failure)
    # A row that is not a number is left out of the input; where the field leads back, the end may well be good.
    if not said.satisfied:
        assert re.search(text, said.reason)
        assert "1e+12" not in said.reason
    else:
        assert margins is undefined


def test_the_safe_helpers_have_no_such_gradient():
    found = jax.jacrev(lambda z: jnp.sum(jnp.where(jnp.isfinite(distances(z)), distances(z), 0.0)))
    assert np.isfinite(found(Z0)).all()
    assert np.isfinite(found(jnp.zeros((3, 2)))).all()
    wanted = np.linalg.norm(np.asarray(Z0)[:, None] - np.asarray(Z0)[None], axis=-1)
    np.fill_diagonal(wanted, np.inf)
    np.testing.assert_allclose(distances(Z0), wanted, rtol=1e-6)
    np.testing.assert_array_equal(jax.grad(safe_norm)(jnp.zeros(2)), 0.0)


# Kinks and forced steps


def meeting(tau, z, condition):
    return jnp.sum((z[0] - z[1]) ** 2) - 0.01


MEET = SharedRequirements((SharedFactor(meeting, name="meet"),))
MEETING = jnp.array([[-1.0, 0.1], [1.0, -0.1], [0.0, 2.0]])


def test_where_steps_are_forced_it_is_said_whose_they_were():
    """A pair that is to meet, and a third that has no part in it: every row is feasible, the steps are too long."""
    sample = guided((MEET,), MEETING, still, grid=refined_grid(20))
    assert not sample.summary.qp_infeasible_points.any()
    assert not sample.summary.infeasible_points.any()
    said = certify(sample, (MEET,), agents=("red", "green", "blue")).generation
    assert said.forced_steps > 0
    assert not said.hypotheses_hold
    (record,) = said.requirements
    assert record.forced_steps == said.forced_steps
    assert record.forced_agents == ("red", "green")
    assert f"{said.forced_steps} steps were forced: meet at red, green" in said.first_failure


def test_steps_that_are_forced_at_a_kink_say_so():
    """V rises along its own descent however short the step: the ridge of |y|, toward which it is driven."""

    def ridge(z, condition):
        return -z[:, :1] - jnp.abs(z[:, 1:])

    def toward(tau, z, condition):
        return jnp.stack([3.0 * jnp.ones(len(z), z.dtype), -20.0 * z[:, 1]], axis=-1)

    one = PrivateRequirement(ridge, 0.02, name="ridge")
    z0 = jnp.array([[-0.1, 0.3]])
    said = certify(guided((one,), z0, toward, grid=refined_grid(100)), (one,)).generation
    assert said.forced_steps > 0
    assert said.requirements[0].kink_points > 0
    assert "ridge has no gradient (a kink) at " in said.first_failure


def test_a_kink_has_no_gradient_and_is_not_held():
    """A trajectory along the ridge of |y|: at each of its points the slope jumps."""

    def ridge(z, condition):
        return (0.3 - z[:, :1]) - jnp.abs(z[:, 1:])

    def smooth(z, condition):
        return (0.3 - z[:, :1]) - jnp.sqrt(z[:, 1:] ** 2 + 0.05**2)

    tau = np.linspace(0.0, 1.0, 50)
    x = 0.5 * (1 - tau) - 0.3
    y = 0.3 * np.sin(20 * tau) * (np.abs(np.sin(20 * tau)) > 0.2)  # exactly on the ridge at times
    y[1::2] *= -1.0
    z = np.stack([x, y], axis=-1)[:, None]
    kinky, round_ = (PrivateRequirement(margins, 0.5, name="ridge") for margins in (ridge, smooth))
    first = certify(Trajectory(tau, z), (kinky,)).generation
    second = certify(Trajectory(tau, z), (round_,)).generation
    # Leaving it, and where the hinge is active: elsewhere V is zero all around.
    on_it = int(np.sum((y[:-1] == 0) & (y[1:] != 0) & (0.2 + x[:-1] > 0)))
    assert on_it > 0
    assert first.requirements[0].kink_points == on_it
    assert second.requirements[0].kink_points == 0
    assert not first.hypotheses_hold


# Not finite


def close(z, condition):
    return 2.0 - safe_norm(z)[:, None]


def away(z, condition):
    return safe_norm(z)[:, None] - 0.5


@pytest.mark.parametrize(("margins", "end"), [(close, np.nan), (away, np.inf), (away, -np.inf)])
def test_what_is_not_finite_is_neither_satisfied_nor_held(margins, end):
    """Somebody at infinity is far from every obstacle, and the length of not a number must stay one."""
    one = PrivateRequirement(margins, BUFFER, name="where")

    def leaves(tau, z, condition):
        return jnp.where(tau > 0.9, end, 0.0) * jnp.ones_like(z)

    start = jnp.array([[1.0, 0.5]])
    for solver in (EULER, HEUN):
        said = certify(guided((one,), start, leaves, solver=solver), (one,))
        assert not said.satisfied
        assert said.min_margin < 0
        assert not said.generation.hypotheses_hold
    z = np.broadcast_to(np.asarray(start), (5, 1, 2)).copy()
    z[-1] = end
    said = certify(Trajectory(np.linspace(0, 1, 5), z), (one,))
    assert not said.satisfied
    assert not said.generation.hypotheses_hold
    assert said.reason.startswith("z is not finite at agent 0")


def test_a_diverged_sample_of_a_padded_team_does_not_cost_the_others_theirs():
    def mean(tau, z, mask):
        return z[:, 0] @ mask / jnp.sum(mask) - 5.0

    one = SharedRequirements((SharedFactor(mean, name="mean"),))
    masks = jnp.array([[True, True, False]] * 4)

    def field(tau, z, mask):
        return jnp.where(z[0, 0] > 0.9, jnp.inf, 0.0) * jnp.ones_like(z)

    z0 = Z0[None] + jnp.array([0.0, 0.1, 2.5, 0.2])[:, None, None]
    made = generate_batch(field, DecoupledGuidance((one,)), z0, masks, mask=masks)
    said = certify_batch(made, (one,), masks, mask=masks)
    assert [each.satisfied for each in said] == [True, True, False, True]
