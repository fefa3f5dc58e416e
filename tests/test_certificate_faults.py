"""What once made a certificate wrong: each case was run, and said "satisfied" or "hypotheses hold" of what was not."""

import re

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
import pytest

from deggflow import (
    EULER,
    HEUN,
    DecoupledGuidance,
    NoGuidance,
    PrivateRequirement,
    SharedFactor,
    SharedRequirements,
    StepGuard,
    TighteningBound,
    Trajectory,
    certify,
    certify_batch,
    distances,
    generate,
    generate_batch,
    refined_grid,
    safe_norm,
)
from deggflow.identity import fingerprint, requirement_numbers

BUFFER = 0.02


def gather(tau, z, condition):
    """Everybody to one point."""
    return (jnp.array([[0.4, 0.1]], z.dtype) - z) * 2.0


def far(z, condition):
    return distances(z) - 0.3


def mean_x(tau, z, condition):
    return jnp.mean(z[:, 0])


def still(tau, z, condition):
    return jnp.zeros_like(z)


APART = PrivateRequirement(far, BUFFER, name="apart")
LEFT = SharedRequirements((SharedFactor(mean_x, name="left"),))
Z0 = jnp.array([[-1.0, 0.2], [0.5, 1.0], [0.8, -0.6]])


def guided(requirements, z0=Z0, field=gather, **options):
    return jax.jit(
        lambda z0: generate(field, DecoupledGuidance(requirements), z0, None, **options)
    )(z0)


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


def near(z, condition):
    return distances(z)[:3] - 0.3


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


def test_a_grid_that_stands_still_has_no_certificate():
    run = jax.jit(lambda grid: generate(gather, DecoupledGuidance((APART,)), Z0, None, grid=grid))
    with pytest.raises(ValueError, match="on a grid that increases"):
        certify(run(np.array([0.0, 0.3, 0.3, 1.0])), (APART,))


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
