"""What is said of finished generations, ours and others', against the same computed by hand in float64."""

import itertools
import json
import math
import re
from dataclasses import replace
from functools import cache

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
    Trajectory,
    certify,
    generate,
    refined_grid,
)
from deggflow.judge import follow
from deggflow.records import parse_certificate
from deggflow.trace import Trace

AGENTS, BUFFER, STEPS = 3, 0.05, 300
CENTRE = np.array([0.3, -0.2], np.float32)
NAMES = ("red", "green", "blue")


def around(tau, z, condition):
    """The mean keeps within a disk that drifts."""
    return jnp.sum((jnp.mean(z, axis=0) - tau * condition) ** 2) - 0.25


def distances(z, condition):
    """Agents keep 1.0 apart."""
    offset = z[:, None] - z[None] + 10.0 * jnp.eye(AGENTS)[..., None]
    return jnp.linalg.norm(offset, axis=-1) - 1.0


def field(tau, z, condition):
    """Away from the disk, and everybody together."""
    return 3.0 - z + 3.0 * (jnp.mean(z, axis=0)[None] - z) + jnp.sin(5.0 * tau)


REQUIREMENTS = (
    SharedRequirements((SharedFactor(around, alpha=lambda s: 3.0 * s, name="around"),)),
    PrivateRequirement(distances, BUFFER, name="apart"),
)


def values_by_hand(tau, z):
    """q and V along a path, in float64."""
    tau, z = np.asarray(tau, np.float64), np.asarray(z, np.float64)
    mean = ((z.mean(1) - tau[:, None] * np.float64(CENTRE)) ** 2).sum(-1) - 0.25
    # As the distances above are: the agent itself is far away in both coordinates.
    offset = z[:, :, None] - z[:, None] + 10 * np.eye(AGENTS)[..., None]
    short = np.maximum(BUFFER + 1 - np.linalg.norm(offset, axis=-1), 0)
    return np.stack([mean, (short**2).sum((1, 2)) / 2], -1)


def least_distance(z):
    """Between any two agents, in float64."""
    z = np.asarray(z, np.float64)
    return min(math.dist(a, b) for a, b in itertools.combinations(z, 2))


def limits_by_hand(tau, start):
    tau = np.asarray(tau, np.float64)
    profile = 1 - 10 * tau**3 + 15 * tau**4 - 6 * tau**5
    private = np.maximum(start[1] * (1 - 0.1 * tau - 0.9 * tau**2) ** 4, BUFFER**2 / 2)
    return np.stack([(start[0] + 0.02) * profile, private], -1)


@cache
def run(guided=True):
    """A generation with its path, guided or nominal, from the same z(0)."""
    z0 = jnp.array([[-1.0, 1.2], [-0.4, 0.9], [0.4, 0.4]])
    guidance = DecoupledGuidance(REQUIREMENTS) if guided else NoGuidance()
    grid = refined_grid(STEPS)
    return jax.jit(
        lambda z: generate(field, guidance, z, CENTRE, grid=grid, guard=None, keep_path=True)
    )(z0)


def elsewhere(generation):
    """What somebody else would hand in: times and states, no more."""
    return Trajectory(np.asarray(generation.trace.tau), np.asarray(generation.path))


@cache
def said(guided=True, given=True, **options):
    made = run(guided)
    return certify(elsewhere(made) if given else made, REQUIREMENTS, CENTRE, **options)


def by_name(certificate):
    return {each.name: each for each in certificate.generation.requirements}


@pytest.mark.parametrize("given", [False, True], ids=["generation", "trajectory"])
def test_a_guided_generation_is_satisfied_and_held(given):
    """As a generation, and as nothing but its states."""
    certificate, made = said(given=given), run()
    assert certificate.satisfied
    assert certificate.reason is None
    assert certificate.draws == 1
    record = certificate.generation
    assert record.hypotheses_hold
    assert record.first_failure is None
    assert (record.steps, record.refused_steps, record.forced_steps) == (STEPS, 0, 0)
    assert record.trace is None
    end = values_by_hand(np.ones(1), made.path[-1:])[0]
    value = values_by_hand(made.trace.tau, made.path)
    limit = limits_by_hand(made.trace.tau, value[0])
    found = by_name(certificate)
    assert list(found) == ["around", "apart"]
    for k, each in enumerate(found.values()):
        assert each.value == pytest.approx(end[k], rel=1e-12, abs=1e-15)  # in float64
        assert each.limit == pytest.approx(limit[-1, k], rel=1e-6, abs=1e-9)
        assert each.excess == pytest.approx((value - limit)[:, k].max(), abs=1e-5)
        assert each.active_points > 100
        assert each.smallest_ell_norm > 0
    margins = {"around": -end[0], "apart": least_distance(made.path[-1]) - 1.0}
    assert [each.name for each in certificate.verdicts] == list(margins)
    for each in certificate.verdicts:
        assert each.margin == pytest.approx(margins[each.name], rel=1e-9)
        assert each.reason is None
    assert certificate.min_margin == pytest.approx(min(margins.values()), rel=1e-9)
    assert certificate.violation == pytest.approx(max(end[0], 0) + end[1], rel=1e-9)
    assert certificate.violation > 0  # V is below its floor, not zero


def test_a_generation_says_what_was_done():
    out = run()
    certificate = said(given=False)
    record = certificate.generation
    step = np.linalg.norm(np.diff(np.asarray(out.path, np.float64), axis=0), axis=-1).max()
    assert record.largest_step == pytest.approx(step, rel=1e-5)
    assert said().generation.largest_step == pytest.approx(step, rel=1e-9)
    assert record.largest_input_norm == pytest.approx(float(jnp.max(out.trace.input_norm[:-1])))
    assert record.least_opposed_sine == pytest.approx(float(jnp.min(out.trace.opposed_sine[:-1])))
    active = np.asarray(out.trace.active[:-1]).any(-1).sum(0)
    assert [each.active_points for each in record.requirements] == active.tolist()


def test_the_nominal_path_is_neither_satisfied_nor_held():
    certificate = said(guided=False)
    end = values_by_hand(np.ones(1), run(False).path[-1:])[0]
    assert not certificate.satisfied
    assert not certificate.generation.hypotheses_hold
    assert certificate.min_margin == pytest.approx(-end[0], rel=1e-9)
    assert certificate.reason == f"around ends above its bound by {end[0]:.6g}"
    assert certificate.violation == pytest.approx(end.sum(), rel=1e-9)


def test_a_nominal_generation_has_a_verdict_and_no_record():
    """It is what people certify first, to compare."""
    certificate = said(guided=False, given=False)
    assert certificate.generation is None
    assert certificate.reason == said(guided=False).reason
    assert certificate.table().splitlines()[1] == "no record: no requirement guided this generation"


@pytest.mark.parametrize("agent", range(AGENTS))
def test_a_point_that_was_moved_breaks_the_record_and_not_the_verdict(agent):
    tau, z = elsewhere(run())
    moved, point = z.copy(), 100
    moved[point, agent] += [0.3, 0.0]
    certificate = certify(Trajectory(tau, moved), REQUIREMENTS, CENTRE, agents=NAMES)
    assert certificate.satisfied
    assert certificate.min_margin == said().min_margin
    assert not certificate.generation.hypotheses_hold
    assert re.fullmatch(
        r"(red|green|blue) did not meet its row of (around|apart) at [12] points?",
        certificate.generation.first_failure,
    )
    # The step to the point and the one away from it, and no other.
    with jax.enable_x64(True):
        eps, precision = np.asarray(np.finfo(np.float32).eps, np.float64), np.asarray(1e-5)
        given = tau.astype(np.float64), moved.astype(np.float64), eps, precision
        found = follow(DecoupledGuidance(REQUIREMENTS), *given, CENTRE.astype(np.float64), None)
    met = np.asarray(found.trace[Trace._fields.index("row_feasible") - 1])
    failed = np.flatnonzero(~met[:-1].all((1, 2)))
    assert len(failed)
    assert set(failed.tolist()) <= {point - 1, point}


@pytest.mark.parametrize("name", ["around", "apart"])
def test_the_end_alone_decides_the_verdict(name):
    """The last point moved out of the disk, or two agents thrown together: that requirement is named."""
    tau, z = elsewhere(run())
    moved = z.copy()
    if name == "around":
        moved[-1] += 1.0
    else:
        moved[-1, 0] = moved[-1, 1]
        moved[-1] += CENTRE - moved[-1].mean(0)
    certificate = certify(Trajectory(tau, moved), REQUIREMENTS, CENTRE)
    end = values_by_hand(np.ones(1), moved[-1:])[0]
    assert not certificate.satisfied
    assert not certificate.generation.hypotheses_hold
    if name == "around":
        assert certificate.reason == f"around ends above its bound by {end[0]:.6g}"
    else:
        assert certificate.reason == "agent 0 misses apart by 1"


def test_values_along_a_trajectory_are_those_of_numpy():
    """In float64, of states that no generation has ever produced."""
    rng = np.random.default_rng(3)
    tau = np.sort(np.concatenate([[0.0, 1.0], rng.uniform(0, 1, STEPS - 1)]))
    z = rng.normal(size=(STEPS + 1, AGENTS, 2))
    certificate = certify(Trajectory(tau, z), REQUIREMENTS, CENTRE, keep_trace=True)
    kept, expected = certificate.generation.trace, values_by_hand(tau, z)
    limit = limits_by_hand(tau, expected[0])
    np.testing.assert_allclose(kept.tau, tau, rtol=1e-15)
    np.testing.assert_allclose(kept.value, expected, rtol=1e-12, atol=1e-12)
    np.testing.assert_allclose(kept.limit, limit, rtol=1e-12, atol=1e-12)
    found = by_name(certificate)
    for k, name in enumerate(("around", "apart")):
        assert found[name].value == pytest.approx(expected[-1, k], rel=1e-12, abs=1e-12)
        assert found[name].excess == pytest.approx((expected - limit)[:, k].max(), rel=1e-12)
    assert not certificate.satisfied


GOOD = np.zeros((4, AGENTS, 2))
EVEN = np.linspace(0, 1, 4)


@pytest.mark.parametrize(
    ("tau", "z", "message"),
    [
        (EVEN, GOOD[:3], r"`tau` of shape .* got \(4,\) and \(3, 3, 2\)"),
        (EVEN[None], GOOD, r"`tau` of shape .* got \(1, 4\)"),
        (EVEN, GOOD[..., 0], r"`z` of shape \(points, agents, dim\); got \(4,\) and \(4, 3\)"),
        (EVEN[:1], GOOD[:1], "at least two points"),
        (np.array([0.0, 0.6, 0.4, 1.0]), GOOD, r"`tau` must increase; got 0.6 before 0.4 at point 2"),
        (np.array([0.0, 0.5, 0.5, 1.0]), GOOD, r"`tau` must increase; got 0.5 before 0.5 at point 2"),
        (np.array([0.0, 0.5, np.nan, 1.0]), GOOD, "`tau` must increase; got 0.5 before nan"),
        (0.5 * EVEN, GOOD, "`tau` must .* 1"),
        (0.2 + 0.8 * EVEN, GOOD, "`tau` must .* 0"),
    ],
)  # fmt: skip
def test_what_is_no_trajectory_is_refused(tau, z, message):
    """Bounds begin at tau = 0 and promise something of tau = 1."""
    with pytest.raises(ValueError, match=message):
        certify(Trajectory(tau, z), REQUIREMENTS, CENTRE)


def reach(z, condition):
    return jnp.stack([condition - z[:, 0], z[:, 1]], axis=1)


def ended(z):
    """A generation that stays where it is put: z(0) = z(1) = z."""

    def still(tau, z, condition):
        return jnp.zeros_like(z)

    with jax.enable_x64(True):
        return generate(still, NoGuidance(), z, None)


def test_the_verdict_is_made_in_float64():
    z = np.array([[0.0, 1.0], [0.1 - 1e-12, 0.3], [0.0, 0.1]])
    requirement = PrivateRequirement(reach, 0.0, name="reach")
    certificate = certify(ended(z), (requirement,), np.float64(0.1))
    assert certificate.satisfied
    assert 0 < certificate.min_margin < 2e-12  # float32 could not tell
    assert not certify(ended(z + 1e-9), (requirement,), 0.1).satisfied


def test_the_worst_agent_and_margin_are_named():
    z = np.array([[0.0, 1.0], [0.5, -0.25], [0.3, 0.1]])
    plain = PrivateRequirement(reach, 0.1, name="room")
    labelled = replace(plain, margin_labels=("reach", "height"))
    out = ended(z)
    first = certify(out, (plain,), 0.4, draws=3)
    second = certify(out, (labelled,), 0.4, agents=NAMES, draws=3)
    for certificate in (first, second):
        assert not certificate.satisfied
        assert certificate.min_margin == -0.25
        assert certificate.draws == 3
    assert first.reason == "agent 1 misses room by 0.25"
    assert second.reason == "green misses room (height) by 0.25"


def diverged(value, guard=None, requirements=REQUIREMENTS):
    """A field that leaves the numbers half way, or goes very far."""

    def off(tau, z, condition):
        return jnp.where(tau > 0.5, value, 0.1) * jnp.ones_like(z)

    guidance, z0 = DecoupledGuidance(requirements), run().path[0]
    grid = refined_grid(6)
    return jax.jit(lambda z: generate(off, guidance, z, CENTRE, grid=grid, guard=guard))(z0)


BAD = {"nan": np.nan, "inf": np.inf, "far": 1e17}
KINDS = {"shared": REQUIREMENTS[:1], "private": REQUIREMENTS[1:], "both": REQUIREMENTS}


@pytest.mark.parametrize("guard", [None, StepGuard()], ids=["fixed", "guarded"])
@pytest.mark.parametrize(("bad", "kind"), [("nan", "shared"), ("nan", "private"), ("inf", "both")])
def test_a_sample_that_is_not_a_number_is_never_satisfied(bad, kind, guard):
    out = diverged(BAD[bad], guard, KINDS[kind])
    assert not np.isfinite(out.z).all()
    certificate = certify(out, KINDS[kind], CENTRE)
    assert not certificate.satisfied
    assert certificate.min_margin < 0
    assert not certificate.generation.hypotheses_hold
    first = "the field is not a finite number at agent 0, tau = "
    assert certificate.generation.first_failure.startswith(first)
    assert first in certificate.reason
    assert float(certificate.generation.first_failure.removeprefix(first)) > 0.5


@pytest.mark.parametrize("bad", [None, *BAD])
def test_certificates_are_written_and_read_again(bad):
    """Samples that have diverged, too: no number in a file is infinite, or beyond what is read."""
    out = run() if bad is None else diverged(BAD[bad], StepGuard())
    for keep in (False, True):
        certificate = certify(out, REQUIREMENTS, CENTRE, keep_trace=keep)
        read = json.loads(json.dumps(certificate.to_json(), allow_nan=False))
        assert ("trace" in read["generation"]) == keep
        assert parse_certificate(read, "certificate") == certificate
    assert np.shape(certificate.generation.trace.value) == (len(out.trace.tau), 2)


def test_fields_of_a_file():
    fields = {"satisfied", "min_margin", "violation", "draws", "reason"}
    assert set(said().to_json()) == {*fields, "generation", "verdicts"}
    assert set(replace(said(), generation=None, verdicts=()).to_json()) == fields


def test_a_step_that_was_forced_is_said_to_be():
    """Between points of the grid; at none of them a value was above its limit."""
    out = run()
    certificate = certify(
        out._replace(
            summary=out.summary._replace(work=out.work._replace(forced_steps=jnp.asarray(2)))
        ),
        REQUIREMENTS,
        CENTRE,
    )
    assert certificate.satisfied
    assert not certificate.generation.hypotheses_hold
    assert certificate.generation.forced_steps == 2
    assert "2 steps were forced" in certificate.generation.first_failure
    assert not re.search(r"above its limit by (-|0\b)", certificate.generation.first_failure)


def test_the_table_reads_well():
    lines = said().table().splitlines()
    assert lines[0].startswith("satisfied; least margin ")
    assert re.fullmatch(rf"hypotheses hold at all {STEPS + 1} points, at most \S+ apart", lines[1])
    assert lines[2].startswith(f"{STEPS} steps, 0 refused, 0 forced; least opposed sine ")
    assert lines[3].split("  ")[0] == "requirement"
    for line, each in zip(lines[4:], said().generation.requirements, strict=True):
        name, margin, value, limit, excess, active, points, ell = line.split()
        assert margin.strip("-")
        assert (name, active, points) == (each.name, str(each.active_points), "points")
        for text, number in ((value, each.value), (limit, each.limit), (excess, each.excess)):
            assert float(text) == pytest.approx(number, rel=1e-2)
        assert float(ell) == pytest.approx(each.smallest_ell_norm, rel=1e-2)
    assert len({len(line) for line in lines[3:]}) == 1  # columns stand under each other
    broken = said(guided=False)
    lines = broken.table().splitlines()
    assert lines[0].startswith(f"NOT satisfied: {broken.reason}; ")
    assert lines[1] == f"hypotheses do not hold: {broken.generation.first_failure}"


def test_float64_does_not_leak_out():
    certify(run(), REQUIREMENTS, CENTRE)
    with pytest.raises(ValueError, match="two points"):
        certify(Trajectory(EVEN[:1], GOOD[:1]), REQUIREMENTS, CENTRE)
    assert jnp.zeros(1).dtype == jnp.float32
