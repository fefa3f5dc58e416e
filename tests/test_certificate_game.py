"""A short round of the certificate game, and that its judge finds what is false."""

from collections import Counter
from dataclasses import replace

import certificate_game
import jax
import jaxtyping
import numpy as np
import pytest
from game import generated, truth
from game.draw import draw
from game.spec import Factor, Private, Problem, Shared
from game.tally import Tally, judge_hypotheses, judge_verdicts
from game.wired import PIECES, guidance_of, program_of
from game.wirings import play_wirings

from deggflow import certify_batch

BATCH = {"sample": 48, "single": 20, "trajectories": 64, "hinges": 32}


@pytest.mark.slow
@pytest.mark.parametrize(
    ("kind", "number"),
    [
        ("both", 2), ("limits", 0), ("padded", 1), ("double", 0), ("boundary", 0), ("boundary", 1),
        ("sample", 1), ("tampered", 0), ("trajectories", 1),
    ],
)  # fmt: skip
def test_nothing_false_is_said(kind, number):
    tally = Tally()
    certificate_game.play(kind, number, seed=1, batch=BATCH.get(kind, 64), tally=tally)
    assert tally.missed == [], tally.notes
    assert tally.counts["judged"] >= 12


@pytest.mark.slow
def test_every_wrong_wiring_is_refused():
    tally = Tally()
    case = generated.Case(1, "wirings", 0, 1)
    play_wirings(case, tally, also=(jaxtyping.TypeCheckError,))
    assert tally.missed == [], tally.notes


ONE = Problem((Private(("discs", "apart", "boxes")),), agents=3, grid="coarse", guard="none")


@pytest.fixture(scope="module")
def played():
    """A batch with certificates."""
    rng = np.random.default_rng(2)
    condition, z0, _, _ = draw(ONE, rng, 64, modes=(1.0,))
    made = jax.tree.map(np.asarray, program_of(ONE)(z0, condition, None, None))
    return condition, made, certify_batch(made, guidance_of(ONE), condition)


def judged(played, certificates):
    condition, made, _ = played
    tally = Tally()
    judge_verdicts(tally, "case", ONE, made.z, condition, None, certificates)
    judge_hypotheses(
        tally, "case", ONE, made.trace.tau[0], made.path, condition, None, certificates, 2.0**-23
    )
    return tally


def test_the_judge_agrees_with_what_is_true(played):
    found = judged(played, played[2])
    assert found.missed == [], found.notes
    assert 0 < found.counts["hypotheses hold"] < found.counts["judged"]


def test_the_judge_finds_what_is_false(played):
    """Everybody satisfied, all hypotheses said to hold: as many are called false as were not."""
    certificates = played[2]
    all_well = [
        replace(each, satisfied=True, generation=replace(each.generation, hypotheses_hold=True))
        for each in certificates
    ]
    found = judged(played, all_well)
    assert found.counts["false satisfied"] == sum(not each.satisfied for each in certificates) > 0
    assert found.counts["false hypotheses"] > 0
    assert {"false satisfied", "false hypotheses"} <= set(found.missed)


def test_the_judge_finds_refusals_without_a_reason(played):
    refused = [replace(each, satisfied=False, reason="so") for each in played[2]]
    found = judged(played, refused)
    assert found.counts["false refusals"] == sum(each.satisfied for each in played[2]) > 0
    assert "false refusals" in found.missed


@pytest.mark.parametrize("piece", sorted(PIECES))
def test_both_sides_have_the_same_margins(piece):
    problem = Problem((Private((piece,)),), agents=3, waypoints=3)
    condition, z, _, _ = draw(problem, np.random.default_rng(3), 20)
    z, known = z.astype(np.float64), truth.exact(condition)
    expected = truth.margins(problem.requirements[0], "r0", z[:, None], known, None)[:, 0]
    with jax.enable_x64(True):
        own = jax.vmap(lambda z, c: PIECES[piece](z, c, None).reshape(3, -1))
        found = np.sort(own(z, known["r0"][piece]), axis=-1)
    np.testing.assert_allclose(found, np.sort(expected, axis=-1), atol=1e-13)


def test_few_samples_have_all_kinds():
    chosen = certificate_game.cases(1000, 64)
    assert set(Counter(kind for kind, _ in chosen)) == set(certificate_game.KINDS)
    assert len(set(chosen)) == len(chosen)


def test_bounds_of_the_judge_at_both_ends():
    """Private: V(0) and the floor; shared: q(0) + slack and the end."""
    problem = Problem((Private(("discs",), buffer=0.1), Shared((Factor("ramp", slack=0.5),))))
    condition, z, _, _ = draw(problem, np.random.default_rng(4), 5)
    path = np.repeat(z[:, None].astype(np.float64), 2, axis=1)
    known = truth.exact(condition)
    over = truth.above_limits(problem, np.array([0.0, 1.0]), path, known, None, 1e-16)
    spec = problem.requirements[0]
    v = (truth.hinges(spec, "r0", path, known, None)[:, 1] ** 2).sum(axis=(1, 2)) / 2
    q = truth.q_of(Factor("ramp"), "r1", "f0", np.ones(1), path[:, 1:], known)[:, 0]
    expected = np.maximum(np.maximum(v - 0.005, q), -0.5)
    np.testing.assert_allclose(over, expected, atol=1e-6)
