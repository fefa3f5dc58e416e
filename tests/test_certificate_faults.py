"""What once made a certificate wrong: each case was run, and said "satisfied" or "hypotheses hold" of what was not."""

import re

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
import pytest
from gathering_cases import APART, BUFFER, LEFT, Z0, far, gather, guided, still

from deggflow import (
    DecoupledGuidance,
    NoGuidance,
    PrivateRequirement,
    StepGuard,
    Trajectory,
    certify,
    certify_batch,
    distances,
    generate,
    generate_batch,
    refined_grid,
    safe_norm,
)


def test_no_requirement_drops_out_of_the_verdict():
    """Private and shared; the sample meets the private one alone."""
    sample = guided((APART,))
    assert certify(sample, (APART,)).satisfied
    both = certify(sample, (APART, LEFT))
    assert not both.satisfied
    end = np.mean(np.asarray(sample.z, np.float64)[:, 0])
    assert both.reason == f"left ends above its bound by {end:.6g}"
    assert [each.name for each in both.verdicts] == ["apart", "left"]
    assert not both.generation.hypotheses_hold
    assert "generated under other requirements" in both.generation.first_failure


def test_the_floor_comes_from_the_buffer():
    """V at its floor implies every margin; nobody can pass another floor."""
    sample = guided((APART,))
    (record,) = certify(sample, (APART,)).generation.requirements
    assert record.limit == pytest.approx(BUFFER**2 / 2)
    with pytest.raises(TypeError, match="floor"):
        PrivateRequirement(far, BUFFER, floor=BUFFER)


def test_margins_decide_where_v_is_above_its_floor():
    """So many hinge terms that V exceeds buffer^2 / 2 although every margin is at least 5 mm."""

    def many(z, condition):
        return jnp.full((len(z), 2000), 0.005) + 0.0 * z[:, :1]

    one = PrivateRequirement(many, BUFFER, name="many")
    sample = jax.jit(lambda z: generate(still, NoGuidance(), z, None))(Z0)
    said = certify(sample, (one,))
    assert said.violation > one.floor
    assert said.satisfied
    assert said.min_margin == pytest.approx(0.005, rel=1e-6)


@pytest.mark.parametrize("end", [0.02, 1.0])
def test_a_grid_that_does_not_reach_the_end_has_no_certificate(end):
    """Its values are unknown to a compiled program, and looked at here."""
    grid = np.linspace(0.0, end, 30)
    guidance = DecoupledGuidance((APART,))
    run = jax.jit(lambda z, grid: generate(gather, guidance, z, None, grid=grid))
    if end == 1.0:
        assert certify(run(Z0, grid), guidance).generation.hypotheses_hold
        grid = grid[::-1]
    with pytest.raises(ValueError, match=r"`sample` must be generated on a grid"):
        certify(run(Z0, grid.copy()), guidance)


def straight_with(dummy, points=400):
    """Three agents that drive straight through each other, and one far away that stands still."""
    tau = np.linspace(0.0, 1.0, points)
    start = np.array([[-1.0, 0.0], [1.0, 0.01], [0.0, 2.0]])
    end = np.array([[1.0, 0.0], [-1.0, 0.01], [0.0, 2.0]])
    z = start + tau[:, None, None] * (end - start)
    return Trajectory(tau, np.concatenate([z, np.full((points, 1, 2), dummy)], axis=1))


@pytest.mark.parametrize("dummy", [5.0, 1e6])
def test_rounding_is_allowed_to_each_agent_by_itself(dummy):
    """An agent at 1e6 does not make the rows of the others pass."""

    def margins(z, condition):
        return jnp.minimum(distances(z) - 0.3, 5.0)

    one = PrivateRequirement(margins, BUFFER, name="apart")
    said = certify(straight_with(dummy), (one,))
    assert said.satisfied  # at the end
    assert not said.generation.hypotheses_hold
    assert re.search("agent [01] did not meet its row of apart", said.generation.first_failure)


def test_accepted_points_between_those_of_the_grid_are_in_the_record():
    """Steps that were halved: what is met there counts as anywhere else."""
    grid = refined_grid(8)
    sample = guided((APART,), 0.3 * Z0, grid=grid)
    assert int(sample.work.refused_steps) > 0
    points = int(sample.summary.points)
    assert points == int(sample.work.evaluations) - int(sample.work.refused_steps)
    assert points > len(grid)
    said = certify(sample, (APART,)).generation
    assert said.steps == points - 1
    assert said.largest_input_norm >= float(jnp.max(sample.trace.input_norm[:-1]))
    assert said.requirements[0].smallest_ell_norm <= float(jnp.min(sample.trace.ell_norm[:-1]))
    assert said.requirements[0].active_points >= int(
        jnp.any(sample.trace.active[:-1], (1, 2)).sum()
    )


def test_an_end_that_was_put_in_place_of_the_generations_is_not_held():
    sample = guided((APART,))
    said = certify(sample._replace(z=sample.z + 2.0), (APART,))
    assert said.satisfied  # everybody moved alike
    assert not said.generation.hypotheses_hold
    assert said.generation.first_failure == "z is not the end of its generation"


def test_only_those_of_a_batch_that_contradict_it_are_told():
    sample = guided((APART,))
    z = jnp.stack([sample.z, sample.z + 2.0, sample.z])
    batch = jax.tree.map(lambda leaf: jnp.stack([leaf] * 3), sample)._replace(z=z)
    said = [each.generation for each in certify_batch(batch, (APART,))]
    assert [each.first_failure for each in said] == [
        None,
        "z is not the end of its generation",
        None,
    ]
    assert said[0] == said[2] == certify(sample, (APART,)).generation


def test_two_points_say_how_far_apart_they_are():
    """Through an obstacle, from one side to the other."""

    def outside(z, condition):
        return safe_norm(z)[:, None] - 0.5

    one = PrivateRequirement(outside, BUFFER, name="outside")
    jump = Trajectory(np.array([0.0, 1.0]), np.array([[[-1.0, 0.0]], [[1.0, 0.0]]]))
    table = certify(jump, (one,)).table()
    assert "hypotheses hold at all 2 points, at most 2 apart" in table


def test_a_batch_is_certified_in_one_call():
    guidance = DecoupledGuidance((APART, LEFT))
    z0 = Z0[None] * jnp.linspace(0.5, 1.5, 20)[:, None, None]
    samples = jax.jit(lambda z0: generate_batch(gather, guidance, z0, None))(z0)
    together = certify_batch(samples, guidance)
    for k, said in enumerate(together):
        alone = certify(jax.tree.map(lambda leaf, k=k: leaf[k], samples), guidance)
        assert said.satisfied == alone.satisfied
        assert said.min_margin == pytest.approx(alone.min_margin, rel=1e-12)
        assert said.generation.hypotheses_hold == alone.generation.hypotheses_hold
    with pytest.raises(ValueError, match=r"got \(20, 3, 2\): use `certify_batch`"):
        certify(samples, guidance)


def test_a_grid_that_stands_still_has_no_certificate():
    run = jax.jit(lambda grid: generate(gather, DecoupledGuidance((APART,)), Z0, None, grid=grid))
    with pytest.raises(ValueError, match="on a grid that increases"):
        certify(run(np.array([0.0, 0.3, 0.3, 1.0])), (APART,))


# Masks


def among(z, condition):
    return distances(z, condition) - 0.3


def test_one_program_serves_teams_of_several_sizes():
    """Padded to five agents; what a team of three does alone is what it does beside two that are absent."""
    one = PrivateRequirement(among, BUFFER, name="apart")
    guidance = DecoupledGuidance((one,))
    traced = []

    def field(tau, z, mask):
        traced.append(None)
        return gather(tau, z, None)

    run = eqx.filter_jit(lambda z0, mask: generate(field, guidance, z0, mask, mask=mask))
    first = None
    z0 = 0.5 * np.random.default_rng(1).normal(size=(5, 2))
    for present in (3, 4, 5):
        mask = jnp.arange(5) < present
        with jax.enable_x64(True):  # rounding would grow along edges
            sample = run(z0, mask)
            alone = jax.jit(lambda z0, mask: generate(gather, guidance, z0, mask))(
                z0[:present], mask[:present]
            )
        first = first or len(traced)
        said = certify(sample, guidance, mask, mask=mask)
        assert said.satisfied
        np.testing.assert_array_equal(sample.z[present:], z0[present:])  # absent ones stay
        np.testing.assert_allclose(sample.z[:present], alone.z, atol=1e-9)
    assert len(traced) == first  # compiled once


@pytest.mark.parametrize("kind", ["private", "shared"])
def test_a_verdict_that_absent_agents_change_is_refused(kind):
    """The mask was forgotten in the function itself."""
    one = APART if kind == "private" else LEFT
    mask = jnp.array([True, True, False])
    sample = generate(gather, DecoupledGuidance((one,)), Z0, None, mask=mask)
    with pytest.raises(ValueError, match="changes with the states of absent agents"):
        certify(sample, (one,), mask=mask)


@pytest.mark.parametrize("guard", [None, StepGuard()])
def test_states_of_one_precision_under_the_other(guard):
    """float32 states though JAX computes in float64, and numpy's float64 grid though it does not."""
    guidance = DecoupledGuidance((APART, LEFT))
    with jax.enable_x64(True):
        single = generate(gather, guidance, np.asarray(Z0, np.float32), None, guard=guard)
        assert single.z.dtype == jnp.float32
        double = generate(gather, guidance, np.asarray(Z0, np.float64), None, guard=guard)
        assert double.z.dtype == jnp.float64
    plain = generate(
        gather, guidance, Z0, None, guard=guard, grid=np.asarray(refined_grid(), np.float64)
    )
    np.testing.assert_allclose(single.z, plain.z, atol=1e-3)
    for sample in (single, double, plain):
        assert certify(sample, guidance).satisfied
