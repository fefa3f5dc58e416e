"""Large scenes: the same requirements and the same field as on a table, of neighbours alone; and what guidance makes of them."""

import json
import math
from dataclasses import replace
from itertools import combinations

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
import pytest

from deggflow import Extrapolated
from deggflow.runtime.part import within_links
from deggflow.tasks.tabletop.changes import random_conditions, random_table
from deggflow.tasks.tabletop.codec import decode as decode_scene
from deggflow.tasks.tabletop.condition import SceneCondition, take
from deggflow.tasks.tabletop.condition import to_arrays as scene_arrays
from deggflow.tasks.tabletop.field import load_field
from deggflow.tasks.tabletop.generator import TabletopGenerator
from deggflow.tasks.tabletop.large import (
    LargeSceneGenerator,
    is_large,
    large_scene_guidance,
    large_scenes_like,
    make_scenes,
)
from deggflow.tasks.tabletop.large.condition import (
    anchors,
    decode,
    decode_exactly,
    padded_count,
    window_size,
    windows,
)
from deggflow.tasks.tabletop.large.condition import to_arrays as numpy_arrays
from deggflow.tasks.tabletop.large.field import FADE, large_scene_field
from deggflow.tasks.tabletop.large.margins import LargeSceneMargins
from deggflow.tasks.tabletop.large.parts import ObjectNeighbourhood
from deggflow.tasks.tabletop.library import numbered
from deggflow.tasks.tabletop.margins import TABLETOP
from deggflow.tasks.tabletop.oracle import least_margin, refutes
from deggflow.tasks.tabletop.recorded import recorded_violation
from deggflow.tasks.tabletop.requirements import tabletop_guidance
from deggflow.tasks.tabletop.verdict import BUFFER, judge

SLOTS = 48  # more than any of these scenes needs


def large(size=30, family="changed", seed=0):
    return random_conditions(size, 1, family, seed)[0]


def to_arrays(condition):
    return jax.tree.map(jnp.asarray, numpy_arrays(condition, BUFFER))


def states(condition, seed=0, spread=0.8):
    rng = np.random.default_rng(seed)
    count = padded_count(len(condition.objects))
    return rng.normal(scale=spread, size=(count, 3)).astype(np.float32)


def test_repeated_types_make_a_hall():
    assert is_large(large(13))
    assert is_large(SceneCondition(("teacup", "teacup#2")))
    assert not is_large(random_conditions(12, 1, "changed", 0)[0])


@pytest.mark.parametrize("size", [13, 100, 1000, 3000])
def test_a_hall_has_a_tables_area_for_every_eight(size):
    width, depth = random_table(size)
    assert width * depth == pytest.approx(1.40 * 0.94 * size / 8, rel=1e-5)
    assert 0.5 < width / depth < 2.0


def test_padded_sizes_waste_little_and_are_few():
    sizes = {padded_count(count) for count in range(13, 3001)}
    assert all(count <= padded_count(count) <= 1.13 * count + 1 for count in range(13, 3001))
    assert len(sizes) < 80


def test_objects_are_spread_over_all_windows():
    condition = large(200)
    columns, rows = windows(condition)
    where, count = np.unique(anchors(condition), axis=0, return_counts=True)
    assert len(where) == columns * rows
    assert count.min() >= 7
    assert count.max() <= 9
    half = np.array([condition.width, condition.depth]) / 2
    assert np.all(np.abs(where) + window_size(condition) <= half + 1e-9)


def test_decoding_is_the_same_in_both_precisions():
    condition = large()
    z = states(condition)
    pose = decode(jnp.asarray(z), to_arrays(condition))
    exact = decode_exactly(z, condition)
    for column, name in enumerate(("x", "y", "theta")):
        got = np.asarray(getattr(pose, name))[: len(exact)]
        np.testing.assert_allclose(got, exact[:, column], atol=1e-5)


@pytest.mark.parametrize("family", ["default", "combined"])
def test_violation_is_that_of_exact_geometry(family):
    condition = large(40, family)
    z = states(condition)
    with jax.enable_x64(True):
        given = to_arrays(condition)
        found = eqx.filter_jit(LargeSceneMargins(SLOTS).violation)(
            jnp.asarray(z, jnp.float64), given, BUFFER
        )
        found = np.asarray(found)
    poses = decode_exactly(z[: len(condition.objects)], condition)
    exact = judge([condition], [poses])[0]
    assert exact.violation > 0.01
    assert float(np.sum(found)) >= exact.violation
    assert float(np.sum(found)) == pytest.approx(recorded_violation(condition, poses), rel=2e-5)
    assert not np.any(found[len(condition.objects) :])


def table_and_hall(size, seed):
    """One scene of different objects both ways, and states of the same poses."""
    condition = random_conditions(size, 1, "changed", seed)[0]
    dense = jax.tree.map(jnp.asarray, take(scene_arrays([condition]), 0))
    sparse = to_arrays(condition)
    z = np.random.default_rng(seed).normal(scale=0.5, size=(len(dense.mask), 3)).astype(np.float32)
    padded = np.zeros((len(sparse.mask), 3), np.float32)
    padded[: len(z)] = z
    return dense, sparse, jnp.asarray(z), jnp.asarray(padded)


def test_violation_gradient_and_dependence_are_those_of_a_table():
    size = 12
    dense, sparse, z, padded = table_and_hall(size, 3)

    def slope(margins, z, condition):
        def total(z):
            return jnp.sum(margins.violation(z, condition, BUFFER))

        return eqx.filter_jit(jax.value_and_grad(total))(z)

    value, gradient = slope(TABLETOP, z, dense)
    other, steep = slope(LargeSceneMargins(SLOTS), padded, sparse)
    assert float(other) == pytest.approx(float(value), rel=1e-5)
    np.testing.assert_allclose(steep[:size], gradient[:size], atol=1e-6)
    wanted = eqx.filter_jit(TABLETOP.dependence)(z, dense, BUFFER)[:size, :size]
    pairs = eqx.filter_jit(LargeSceneMargins(SLOTS).dependence)(padded, sparse, BUFFER)
    got = np.zeros((len(padded), len(padded)), bool)
    got[pairs.owner[pairs.active], pairs.agent[pairs.active]] = True
    assert np.array_equal(got[:size, :size], wanted)


def test_the_field_is_the_tables_where_everybody_is_near():
    dense, sparse, z, padded = table_and_hall(6, 1)
    z, padded = 0.2 * z, 0.2 * padded
    pose = decode_scene(z, dense)
    where = np.stack([pose.x, pose.y], axis=-1)[:6]
    assert np.linalg.norm(where[:, None] - where[None], axis=-1).max() < FADE
    field, tau = load_field(), jnp.float32(0.3)
    wanted = eqx.filter_jit(field)(tau, z, dense)[:6]
    got = eqx.filter_jit(large_scene_field(field, SLOTS))(tau, padded, sparse)[:6]
    np.testing.assert_allclose(got, wanted, atol=2e-5)


def test_the_field_does_not_jump_as_a_neighbour_leaves():
    condition = SceneCondition(("teacup", "teacup#2"))
    sparse, field = to_arrays(condition), eqx.filter_jit(large_scene_field(load_field(), 4))
    z = np.zeros((len(sparse.mask), 3), np.float32)

    def push(gap):
        z[1, 0] = gap / 0.7
        return field(jnp.float32(0.5), jnp.asarray(z), sparse)[0]

    before, after = push(0.6999), push(0.7001)
    np.testing.assert_allclose(before, after, atol=1e-4)
    assert float(jnp.abs(push(0.3) - after).max()) > 1e-3


def test_rows_need_the_states_within_three_links_of_a_list_made_before_all_moved_by_half_the_skin():
    """All other objects are forgotten; a list made without the skin would not do."""
    condition, near = large(60), ObjectNeighbourhood(SLOTS)
    given, guidance = to_arrays(condition), large_scene_guidance(SLOTS)
    before = jnp.asarray(states(condition))
    rng = np.random.default_rng(1)
    towards = jnp.asarray(rng.normal(size=before.shape), jnp.float32)
    size = near.skin / 2 / jax.jit(near.way)(before, before + towards, given)
    after = before + 0.99 * size[:, None] * towards
    pairs, complete = jax.jit(near.pairs)(before, given)
    assert bool(complete)
    state = jax.jit(guidance.init)(after, given, given.mask)

    @jax.jit
    def rows(z, condition, known):
        return guidance.rows(state, jnp.float32(0.5), z, jnp.zeros_like(z), condition, known)

    whole = rows(after, given, given.mask)
    assert int(jnp.sum(whole.b > 0)) > 30
    for first in range(0, 60, 6):
        own = np.arange(len(before)) // 6 == first // 6
        known = jnp.asarray(within_links(pairs, own))
        part = rows(jnp.where(known[:, None], after, 0.0), near.only(known, given), known)
        assert int(jnp.sum(known)) < len(condition.objects)
        for name in ("ell", "b", "contribution"):
            mine, theirs = (np.asarray(getattr(each, name))[:, own] for each in (part, whole))
            np.testing.assert_allclose(mine, theirs, rtol=1e-4, atol=1e-6)


def test_a_list_that_is_too_short_gives_no_number():
    condition = large(40)
    z, given = jnp.asarray(states(condition, spread=0.05)), to_arrays(condition)
    assert np.isnan(eqx.filter_jit(LargeSceneMargins(2).violation)(z, given, BUFFER)).all()
    assert np.isnan(
        eqx.filter_jit(large_scene_field(load_field(), 2))(jnp.float32(0.5), z, given)
    ).all()


BIG = large(20)


@pytest.fixture(scope="module")
def generator():
    return TabletopGenerator(load_field(), tabletop_guidance())


@pytest.fixture(scope="module")
def mixed(generator):
    """A scene, a large scene and a scene, made in one run."""
    first, second = random_conditions(5, 2, "changed", 0)
    return make_scenes(generator, [first, BIG, second], seed=1)


def test_large_scenes_have_the_drift_of_the_generator(generator):
    few = TabletopGenerator(generator.field, tabletop_guidance(), drift=Extrapolated(8))
    assert large_scenes_like(few).drift == Extrapolated(8)
    scene = large_scenes_like(few).scene(BIG, seed=1, number=1)
    assert scene.certificate.satisfied
    assert not refutes(BIG, scene.poses)


def test_a_guided_hall_holds_and_says_so(generator):
    scene = large_scenes_like(generator).scene(BIG, seed=1, number=0)
    certificate = scene.certificate
    assert certificate.satisfied
    assert not refutes(BIG, scene.poses)
    exact = judge([BIG], [scene.poses])[0].min_margin
    assert least_margin(BIG, scene.poses) == pytest.approx(exact, abs=1e-9)
    record = certificate.generation
    assert record is not None
    assert record.requirements[0].name == "affordance"
    assert record.hypotheses_hold
    assert 130 <= record.steps < 400
    before = LargeSceneGenerator(generator.field, guided=False).batch(BIG, 1, 0, 0)
    assert judge([BIG], before.poses)[0].breaches


def test_scenes_and_halls_in_one_run(generator, mixed):
    assert [len(scene.poses) for scene in mixed] == [5, 20, 5]
    alone = make_scenes(generator, [BIG], seed=1, first=1)[0]
    np.testing.assert_array_equal(alone.poses, mixed[1].poses)


def test_a_program_is_compiled_once(generator, mixed, caplog):
    with jax.log_compiles(), caplog.at_level("WARNING"):
        LargeSceneGenerator(generator.field).batch(BIG, 1, 1, 1)
        assert not [line for line in caplog.messages if "Compiling" in line]
        jax.jit(lambda x: x + 3)(jnp.ones(7))
        assert [line for line in caplog.messages if "Compiling" in line]  # it would have been told


def test_the_path_ends_where_the_scene_is(generator, mixed):
    path = LargeSceneGenerator(generator.field).path(BIG, 1, 1, mixed[1].certificate.draws - 1)
    np.testing.assert_allclose(path[-1], mixed[1].poses, atol=0.05)


def test_a_hall_takes_more_steps_in_the_same_proportion(generator):
    fewer = TabletopGenerator(generator.field, generator.guidance, steps=20, power=1.0)
    np.testing.assert_allclose(large_scenes_like(fewer).grid, np.linspace(0, 1, 27), atol=1e-6)
    np.testing.assert_array_equal(
        large_scenes_like(generator).grid, LargeSceneGenerator(generator.field).grid
    )


def test_a_hall_without_room_is_told(generator):
    names = numbered(["drawer_organizer"] * 16)
    (scene,) = make_scenes(generator, [SceneCondition(names)], max_draws=1)
    assert not scene.certificate.satisfied
    assert "drawer_organizer" in scene.certificate.reason
    assert np.isfinite(scene.poses).all()


def test_shared_and_private_requirements_of_a_hall(generator):
    condition = large(20, "balanced")
    assert large_scene_guidance(balanced=True).names == ("affordance", "balance")
    (scene,) = make_scenes(generator, [condition], seed=0)
    assert scene.certificate.satisfied
    assert json.loads(json.dumps(scene.to_json()))["condition"]["balance"]


@pytest.mark.parametrize("spread", [0.3, 0.8, 3.0])
def test_the_verdict_on_many_objects_is_that_of_all_pairs(spread):
    """Scenes of two objects, of which every pair of shapes is measured, say the same of all 1,770 pairs."""
    size = 60
    condition = large(size)
    poses = decode_exactly(states(condition, 5, spread)[:size], condition)
    one, alone = judge([condition], [poses])[0], parts(condition, poses, 1)
    pairs = parts(condition, poses, 2)
    assert one.min_margin == min(each.min_margin for each in pairs.values())
    # V adds up pair by pair, but each object's own part is then counted once for each of its pairs.
    whole = math.fsum(each.violation for each in pairs.values())
    own = math.fsum(each.violation for each in alone.values())
    assert one.violation == pytest.approx(whole - (size - 2) * own, rel=1e-12)
    breaches = {
        breach._replace(
            owner=pair[breach.owner], other=pair[breach.other] if breach.other >= 0 else -1
        )
        for pair, each in pairs.items()
        for breach in each.breaches
    }
    assert set(one.breaches) == breaches


def parts(condition, poses, count):
    """Verdicts on all scenes of a few of the objects, by the objects' indices."""
    chosen = list(combinations(range(len(condition.objects)), count))
    scenes = [
        replace(condition, objects=tuple(condition.objects[k] for k in few)) for few in chosen
    ]
    verdicts = judge(scenes, [poses[list(few)] for few in chosen])
    return dict(zip(chosen, verdicts, strict=True))
