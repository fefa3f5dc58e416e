"""Generated scenes: who they depend on, what is said of them, and what happens when nothing works."""

import json
import math

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
import pytest

from deggflow import AfterPrediction, Extrapolated, ExtrapolatedEndpoint
from deggflow.step_guard import StepGuard
from deggflow.tasks.tabletop.changes import random_conditions
from deggflow.tasks.tabletop.condition import SceneCondition, to_arrays
from deggflow.tasks.tabletop.formats import parse_scene
from deggflow.tasks.tabletop.generator import TabletopGenerator, initial_noise
from deggflow.tasks.tabletop.oracle import least_margin, refutes
from deggflow.tasks.tabletop.requirements import tabletop_guidance
from deggflow.tasks.tabletop.verdict import judge

SEED = 3
IMPOSSIBLE = SceneCondition(("laptop", "desk_lamp"), width=0.1, depth=0.1)
ROUNDING = 1e-4  # m and rad, of float32 over a whole generation


@pytest.fixture(scope="module")
def conditions():
    """Of several sizes, so that in one batch all are padded to the largest, under changed requirements."""
    return [
        random_conditions(size, 1, "changed", SEED, k)[0]
        for k, size in enumerate((1, 3, 4, 6, 5, 8))
    ]


@pytest.fixture(scope="module")
def scenes(guided, conditions):
    return guided.scenes(conditions, seed=SEED)


def lines(scenes):
    return [json.dumps(scene.to_json(), allow_nan=False) for scene in scenes]


def same(some, others):
    """The same scenes up to rounding, after the same number of draws."""
    for a, b in zip(some, others, strict=True):
        assert a.condition == b.condition
        assert a.certificate.draws == b.certificate.draws
        assert a.certificate.satisfied == b.certificate.satisfied
        np.testing.assert_allclose(a.poses, b.poses, atol=ROUNDING)


def test_one_scene_per_condition_in_order(scenes, conditions):
    for scene, condition in zip(scenes, conditions, strict=True):
        assert scene.condition == condition
        assert scene.poses.shape == (len(condition.objects), 3)
        assert scene.seed == SEED


def test_certificates_are_true(scenes):
    """By Shapely, and by the verdict made afresh."""
    for scene in scenes:
        certificate, verdict = scene.certificate, scene.verdict()
        assert certificate.satisfied != refutes(scene.condition, scene.poses)
        assert certificate.satisfied == (certificate.min_margin >= 0)
        assert (certificate.reason is None) == certificate.satisfied
        assert certificate.min_margin == verdict.min_margin
        assert certificate.violation == verdict.violation
        if certificate.satisfied:
            assert certificate.min_margin == pytest.approx(
                least_margin(scene.condition, scene.poses), abs=1e-9
            )


def test_same_seed_same_scenes(guided, conditions, scenes):
    assert lines(guided.scenes(conditions, seed=SEED)) == lines(scenes)


def test_another_seed_gives_other_scenes(guided, conditions, scenes):
    for a, b in zip(guided.scenes(conditions, seed=SEED + 1, max_draws=1), scenes, strict=True):
        assert np.abs(a.poses - b.poses).max() > 0.01


def test_first_is_the_place_in_the_run(guided, conditions, scenes):
    same(guided.scenes(conditions[2:], seed=SEED, first=2), scenes[2:])


def test_a_scene_alone_is_the_scene_in_its_batch(guided, conditions, scenes):
    """Alone it is a batch of one, padded to six objects instead of eight."""
    for k in (1, 3):
        same(guided.scenes(conditions[k : k + 1], seed=SEED, first=k), scenes[k : k + 1])


def test_nothing_asked_for_nothing_made(guided):
    assert guided.scenes([]) == []


def test_guidance_brings_the_violation_down(guided, nominal, conditions):
    """From the same z(0): guided scenes violate less, and no guidance leaves the nominal sample alone."""
    noise = initial_noise(SEED, np.arange(6), 0)
    before = judge(conditions, nominal.batch(noise, conditions).poses)
    after = judge(conditions, guided.batch(noise, conditions).poses)
    assert sum(v.satisfied for v in after) > sum(v.satisfied for v in before)
    for a, b in zip(after, before, strict=True):
        assert a.violation <= b.violation + 1e-12


def test_a_path_leads_from_the_noise_to_the_sample(nominal, conditions):
    noise = initial_noise(SEED, np.arange(6), 0)
    path = nominal.path(noise[2], conditions[2])
    assert len(path) == 12 + 1
    scale = np.array([[0.70, 0.47, 1.35]])
    np.testing.assert_allclose(path[0], noise[2, : len(path[0])] * scale, atol=1e-6)
    np.testing.assert_allclose(path[-1], nominal.batch(noise, conditions).poses[2], atol=ROUNDING)


def test_noise_depends_on_number_and_draw_alone():
    whole = initial_noise(SEED, np.arange(20), 0)
    np.testing.assert_array_equal(initial_noise(SEED, np.array([7]), 0)[0], whole[7])
    np.testing.assert_array_equal(
        initial_noise(SEED, np.array([19, 4]), 0), whole[np.array([19, 4])]
    )
    assert np.abs(initial_noise(SEED, np.arange(20), 1) - whole).min() > 0
    assert np.abs(initial_noise(SEED + 1, np.arange(20), 0) - whole).min() > 0


def test_noise_is_standard_normal():
    noise = initial_noise(0, np.arange(600), 0).ravel()  # more than one batch
    assert len(noise) == 600 * 36
    spread = 1 / math.sqrt(len(noise))
    assert abs(noise.mean()) < 4 * spread
    assert abs(noise.var() - 1) < 4 * math.sqrt(2) * spread
    assert abs(np.mean(noise**4) - 3) < 4 * math.sqrt(96) * spread


def test_an_impossible_scene_is_said_to_be_impossible(guided):
    """After as many draws as were allowed, with the closest of them and a reason."""
    margins = []
    for limit in (1, 3):
        (scene,) = guided.scenes([IMPOSSIBLE], seed=SEED, max_draws=limit)
        assert not scene.certificate.satisfied
        assert scene.certificate.draws == limit
        assert "laptop" in scene.certificate.reason or "desk_lamp" in scene.certificate.reason
        assert scene.certificate.min_margin < 0
        margins.append(scene.certificate.min_margin)
    assert margins[1] >= margins[0]


def test_an_impossible_scene_does_not_change_its_neighbours(guided, conditions, scenes):
    """Though it is drawn again and again beside them."""
    together = guided.scenes([*conditions[:4], IMPOSSIBLE, *conditions[5:]], seed=SEED)
    assert not together[4].certificate.satisfied
    same(together[:4] + together[5:], scenes[:4] + scenes[5:])


@pytest.mark.parametrize("limit", [0, -1])
def test_at_least_one_draw(nominal, conditions, limit):
    with pytest.raises(ValueError, match="max_draws"):
        nominal.scenes(conditions, max_draws=limit)


class Runaway(eqx.Module):
    """The same velocity everywhere; one compiled program serves every speed."""

    speed: jax.Array

    def __call__(self, tau, z, condition):
        return jnp.full_like(z, 1.0) * self.speed


@pytest.mark.parametrize("speed", [math.nan, math.inf, 1e30, 1e9])
def test_a_diverging_field_is_said_to_diverge(speed):
    """Finite numbers in the file, a line that can be read back, and no claim."""
    runaway = TabletopGenerator(Runaway(jnp.asarray(speed)), steps=2)
    conditions = [SceneCondition(("laptop",)), SceneCondition(("laptop", "teacup"))]
    for scene, text in zip(
        (made := runaway.scenes(conditions, max_draws=2)), lines(made), strict=True
    ):
        assert not scene.certificate.satisfied
        assert scene.certificate.reason
        assert np.isfinite(scene.poses).all()
        assert parse_scene(json.loads(text)).to_json() == scene.to_json()


def test_a_diverged_draw_is_never_closer_than_a_finite_one():
    """The closest draw is kept; one that diverged has no place at all."""
    noise = initial_noise(0, np.array([0]), 0)[0, 0]

    def first_draw_diverges(tau, z, condition):
        first = jnp.all(jnp.abs(z[0] - noise[:3]) < 1e-6)
        return jnp.where(first, jnp.nan, 0.0) * jnp.ones_like(z)

    condition = SceneCondition(("laptop",), width=0.3, depth=0.3)
    generator = TabletopGenerator(first_draw_diverges, steps=1)
    finite = generator.batch(initial_noise(0, np.array([0]), 1), [condition]).poses[0]
    assert not judge([condition], [finite])[0].satisfied
    (scene,) = generator.scenes([condition], max_draws=2)
    np.testing.assert_array_equal(scene.poses, finite)


@pytest.mark.parametrize("speed", [math.nan, math.inf, 1e30, 0.0])
def test_a_guided_generation_is_on_record_even_if_it_diverges(speed):
    """In finite numbers that a file holds, with the trace of it."""
    guided = TabletopGenerator(
        Runaway(jnp.asarray(speed)), tabletop_guidance(), steps=2, guard=StepGuard(1)
    )
    condition = SceneCondition(("laptop", "teacup"))
    # A program for one scene alone would hold the speed as a constant.
    scene, _ = guided.scenes([condition] * 2, max_draws=1, keep_trace=True)
    made = scene.certificate.generation
    assert parse_scene(json.loads(*lines([scene]))).certificate == scene.certificate
    assert len(made.trace.tau) == 3
    assert [len(row) for row in made.trace.value] == [1, 1, 1]
    if speed:
        assert not made.hypotheses_hold
        assert (
            made.first_failure in scene.certificate.reason or "diverged" in scene.certificate.reason
        )
        assert not scene.certificate.satisfied


def test_every_draw_is_told_while_it_is_made(guided, conditions):
    """By its number in the run; the last that is told of a scene that is satisfied is the scene."""
    told = []
    made = guided.scenes(
        [*conditions[:4], IMPOSSIBLE, *conditions[5:]],
        seed=SEED,
        first=7,
        max_draws=2,
        on_draw=lambda number, scene: told.append((number, scene)),
    )
    assert {number for number, _ in told} == set(range(7, 13))
    for number, scene in enumerate(made, start=7):
        draws = [each for k, each in told if k == number]
        assert [each.certificate.draws for each in draws] == list(range(1, len(draws) + 1))
        assert len(draws) == scene.certificate.draws
        assert not any(each.certificate.satisfied for each in draws[:-1])
        if scene.certificate.satisfied:
            assert draws[-1].to_json() == scene.to_json()
        else:
            best = max(each.certificate.min_margin for each in draws)
            assert scene.certificate.min_margin == best


def test_reasons_tell_what_went_wrong_on_the_way(guided):
    """Of a scene that has no room: the verdict first, then the condition of the theorem that failed."""
    (scene,) = guided.scenes([IMPOSSIBLE], seed=SEED, max_draws=1)
    made = scene.certificate.generation
    assert not made.hypotheses_hold
    assert scene.certificate.reason.endswith(f"; on the way {made.first_failure}")
    assert scene.certificate.reason.startswith(scene.verdict().reason(IMPOSSIBLE.objects))


def test_scenes_take_sixteen_evaluations_by_default(field):
    wanted, noise = random_conditions(5, 4, "changed", SEED), initial_noise(SEED, np.arange(4), 0)
    for generator in (TabletopGenerator(field), TabletopGenerator(field, tabletop_guidance())):
        work = generator.draw(noise[:, :5], to_arrays(wanted, 5)).work
        np.testing.assert_array_equal(work.field_evaluations, 16)
    assert TabletopGenerator(field, steps=4).drift.evaluations == 4


def test_guidance_after_a_prediction_moves_scenes_less(field):
    wanted, noise = random_conditions(5, 16, "changed", SEED), initial_noise(SEED, np.arange(16), 0)
    prediction = ExtrapolatedEndpoint(8)
    nominal = TabletopGenerator(field, drift=prediction).batch(noise, wanted)
    late = TabletopGenerator(field, tabletop_guidance(), drift=AfterPrediction(prediction))
    after = late.batch(noise, wanted)
    assert all(each.satisfied for each in judge(wanted, after.poses))
    during = TabletopGenerator(field, tabletop_guidance(), drift=prediction).batch(noise, wanted)
    assert np.sum((after.z - nominal.z) ** 2) < np.sum((during.z - nominal.z) ** 2)
    path = late.path(noise[0], wanted[0])
    assert np.abs(path[0] - nominal.poses[0]).max() < 1e-5
    assert TabletopGenerator(field, drift=late.drift).drift == prediction
    assert TabletopGenerator(field, late.guidance).drift == AfterPrediction(
        ExtrapolatedEndpoint(16)
    )


def test_few_evaluations_of_the_field_suffice(field):
    """Scenes hold all the same, by Shapely."""
    few = TabletopGenerator(field, tabletop_guidance(), steps=60, drift=Extrapolated(5))
    wanted = random_conditions(5, 4, "changed", SEED)
    for scene in few.scenes(wanted, seed=SEED):
        assert scene.certificate.satisfied
        assert not refutes(scene.condition, scene.poses)
    generation = few.generation(initial_noise(SEED, np.arange(1), 0)[0], wanted[0])
    assert int(generation.work.field_evaluations) == 5
    assert int(generation.work.evaluations) > 60
