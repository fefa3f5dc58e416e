"""Margins and violations that guidance uses, against the verdict's exact geometry."""

import math
from functools import partial
from itertools import permutations

import jax
import jax.numpy as jnp
import numpy as np
import pytest

from deggflow.tasks.tabletop.changes import random_conditions
from deggflow.tasks.tabletop.condition import SIZES, SceneCondition, take, to_arrays
from deggflow.tasks.tabletop.library import NAMES, object_type
from deggflow.tasks.tabletop.margins import (
    ABSENT,
    TABLETOP,
    least_margin,
    scene_margins,
)
from deggflow.tasks.tabletop.recorded import recorded_violation
from deggflow.tasks.tabletop.verdict import judge

SCALE = np.array([[0.70, 0.47, 1.35]])  # paper: [p, theta] = diag(0.70, 0.47, 1.35) z
BUFFER = 0.02  # m, paper: delta^PE


def violation_of(z, condition):
    return TABLETOP.violation(z, condition, BUFFER)


def and_gradient(z, condition):
    return TABLETOP.violation_and_gradient(z, condition, BUFFER)


ROUNDING = 5e-7  # m, object sizes are float32 in a compiled program


BATCH = 160  # scenes measured at once, so that each padded size is compiled once


@jax.jit
@jax.vmap
def _measured(z, condition):
    parts = violation_of(z, condition)
    return least_margin(z, condition), parts, scene_margins(z, condition)


def measured(z, arrays):
    """Least margin, V_i and all margins of scenes, in float64."""
    chunks = []
    for start in range(0, len(z), BATCH):
        index = np.resize(np.arange(start, min(start + BATCH, len(z))), BATCH)
        with jax.enable_x64(True):
            found = _measured(z[index], take(arrays, index))
        chunks.append(jax.tree.map(np.asarray, found))
    return jax.tree.map(lambda *parts: np.concatenate(parts)[: len(z)], *chunks)


def padded(conditions, poses, agents):
    """States of shape (scenes, agents, 3); what stands in the padding is noise."""
    z = np.random.default_rng(agents).normal(size=(len(poses), agents, 3))
    for row, pose in zip(z, poses, strict=True):
        row[: len(pose)] = pose / SCALE
    return z, to_arrays(conditions, agents)


def teams(random_scenes, agents):
    """Scenes of every number of objects that has this padded size, under all families of requirements."""
    conditions, poses = [], []
    sizes = (
        range(1, agents + 1)
        if agents == SIZES[0]
        else range(SIZES[SIZES.index(agents) - 1] + 1, agents + 1)
    )
    for size in sizes:
        for family in ("default", "changed", "combined"):
            some = random_scenes(size, 8, size, family)
            conditions, poses = conditions + some[0], poses + some[1]
    return conditions, poses


@pytest.mark.parametrize("agents", SIZES)
def test_margins_and_violations_are_the_verdicts(random_scenes, agents):
    conditions, poses = teams(random_scenes, agents)
    verdicts = judge(conditions, poses)
    least, parts, _ = measured(*padded(conditions, poses, agents))
    np.testing.assert_allclose(least, [v.min_margin for v in verdicts], atol=ROUNDING)
    total, exact = parts.sum(axis=1), np.array([v.violation for v in verdicts])
    wanted = [recorded_violation(*one) for one in zip(conditions, poses, strict=True)]
    np.testing.assert_allclose(total, wanted, rtol=2e-5, atol=1e-9)
    assert np.all(total >= exact * (1 - 1e-4))
    assert np.all(total <= 8 * exact + 1e-9)


@pytest.mark.parametrize("agents", SIZES)
def test_every_margin_is_the_references(random_scenes, reference, agents):
    """Not only the least: the same numbers, those that do not exist apart."""
    conditions, poses = teams(random_scenes, agents)
    conditions, poses = conditions[::7], poses[::7]
    margins = measured(*padded(conditions, poses, agents))[2]
    for k, (condition, pose) in enumerate(zip(conditions, poses, strict=True)):
        expected = reference(condition, pose)
        found = jax.tree.map(lambda leaf, k=k: leaf[k], margins)
        for kind, values in (
            ("separation", found.separation),
            ("unobstructed", found.unobstructed),
            ("object on table", found.object_wall),
            ("region on table", found.region_wall),
        ):
            values = np.sort(values[values != ABSENT])
            np.testing.assert_allclose(values, np.sort(expected[kind]), atol=ROUNDING)


def test_violations_belong_to_their_owners():
    """A separation counts for both objects, an obstructed region for its owner alone."""
    objects = ("pen_cup", "desk_lamp")
    inside = (BUFFER + 0.005) ** 2 / 2
    scenes = {
        # 0.01 m between the two
        (0.104, 0.0): ((math.pi, 0.0), [0.01**2 / 2, 0.01**2 / 2]),
        # the lamp 0.005 m inside the pen cup's region, and as far on the strip that leads out over it
        (0.177, 0.0): ((0.0, 0.0), [inside + inside / (inside + 0.03**2) * inside, 0.0]),
    }
    conditions = [SceneCondition(objects)] * len(scenes)
    poses = [
        np.array([[0.0, 0.0, cup], [*place, lamp]]) for place, ((cup, lamp), _) in scenes.items()
    ]
    parts = measured(*padded(conditions, poses, 6))[1]
    np.testing.assert_allclose(parts[:, :2], [v for _, v in scenes.values()], atol=1e-8)


def caught_pairs():
    """Every object with every other one between it and its regions, turned at random."""
    rng, conditions, poses = np.random.default_rng(0), [], []
    for owner, obstacle in permutations(NAMES, 2):
        row = np.mean([[region.x, region.y] for region in object_type(owner).regions], axis=0)
        place = row * rng.uniform(0.3, 1.0) + rng.normal(scale=0.02, size=2)
        conditions.append(SceneCondition((owner, obstacle)))
        poses.append(np.array([[0.0, 0.0, 0.0], [*place, rng.uniform(-math.pi, math.pi)]]))
    return jax.tree.map(jnp.asarray, padded(conditions, poses, 2))


def test_what_is_caught_between_an_object_and_its_regions_is_led_out():
    """By descent of V. By hinges of margins alone, 16 of these 132 end at local minima."""

    def descent(_, z):
        return z - 0.15 * jax.vmap(and_gradient)(z, arrays)[1]

    z, arrays = caught_pairs()
    end = jax.jit(lambda z: jax.lax.fori_loop(0, 2000, descent, z))(z)
    value = jax.jit(jax.vmap(violation_of))(end, arrays).sum(axis=1)
    assert np.sum(value > BUFFER**2 / 2) <= 4


def test_little_violation_implies_satisfaction():
    """V <= buffer^2 / 2 leaves no margin negative, and V > buffer^2 / 2 follows from a negative one."""
    condition = SceneCondition(("pen_cup", "desk_lamp", "laptop"))
    rng = np.random.default_rng(0)
    place = np.array([[-0.5, 0.0, 2.5], [0.0, 0.3, 0.0], [0.4, 0.0, -0.5]])
    poses = place + rng.normal(size=(3200, 3, 3)) * rng.uniform(0.0, 0.3, (3200, 1, 1))
    least, parts, _ = measured(*padded([condition] * len(poses), list(poses), 6))
    little = parts.sum(axis=1) <= BUFFER**2 / 2
    assert least[little].min() >= 0.0
    assert np.all(parts.sum(axis=1)[least < 0] > BUFFER**2 / 2)
    assert np.sum(little & (parts.sum(axis=1) > 0)) > 30  # the buffer was entered, not only avoided


def test_no_violation_beyond_the_buffer(random_scenes):
    """V = 0 if and only if every margin is at least the buffer."""
    conditions, poses = random_scenes(5, 300, 2)
    least, parts, _ = measured(*padded(conditions, poses, 6))
    np.testing.assert_array_equal(parts.sum(axis=1) == 0.0, least >= BUFFER)
    assert 0 < np.sum(least >= BUFFER) < 300


def test_padding_does_not_matter(random_scenes):
    """Neither its size nor what stands in it; padded agents violate nothing."""
    conditions, poses = random_scenes(1, 20, 4, "changed")
    found = {agents: measured(*padded(conditions, poses, agents))[:2] for agents in SIZES}
    for agents, (least, parts) in found.items():
        np.testing.assert_allclose(least, found[SIZES[0]][0], atol=1e-12)
        np.testing.assert_allclose(parts[:, :4], found[SIZES[0]][1][:, :4], atol=1e-14)
        np.testing.assert_array_equal(parts[:, 4:], np.zeros((20, agents - 4)))


COUNT = 24  # scenes whose gradients are taken


@jax.jit
def _totals(z, condition):
    return jax.vmap(lambda state: violation_of(state, condition).sum())(z)


_slopes = jax.jit(
    jax.vmap(jax.value_and_grad(lambda z, condition: violation_of(z, condition).sum())),
)


def test_gradient_is_that_of_finite_differences(random_scenes):
    """In float64, in every coordinate; kinks (a change of the nearest edge inside a core) are rare."""
    conditions, poses = random_scenes(2, COUNT, 5, "changed", crowding=0.7)
    z, arrays = padded(conditions, poses, 6)
    step, rough, checked = 1e-6, 0, 0
    shifts = step * np.eye(18).reshape(18, 6, 3)
    with jax.enable_x64(True):
        values, gradients = jax.tree.map(np.asarray, _slopes(z, arrays))
        for k, state in enumerate(z):
            around = np.concatenate([state[None] + shifts, state[None] - shifts])
            ahead, behind = np.split(np.asarray(_totals(around, take(arrays, k))), 2)
            ahead, behind = ahead - values[k], values[k] - behind
            # V is of order 0.01 and curved by about 1: one-sided differences differ by step^2 where it is smooth.
            smooth = np.abs(ahead - behind) < 100 * step**2
            error = np.abs((ahead + behind) / (2 * step) - gradients[k].ravel())
            assert error[smooth].max() < 1e-6
            rough, checked = rough + np.sum(~smooth), checked + smooth.size
    assert rough < 0.01 * checked
    assert np.abs(gradients[:, :5]).max() > 0.01
    np.testing.assert_array_equal(gradients[:, 5:], np.zeros((COUNT, 1, 3)))


def test_gradient_is_finite_where_all_objects_coincide():
    condition = SceneCondition(("teacup", "laptop", "desk_lamp", "drawer_organizer", "pen_cup"))
    z, arrays = padded([condition], [np.zeros((5, 3))], 6)
    with jax.enable_x64(True):
        gradients = _slopes(
            *jax.tree.map(lambda leaf: np.repeat(leaf, COUNT, axis=0), (z, arrays))
        )[1]
    assert np.isfinite(np.asarray(gradients)).all()


@jax.jit
@jax.vmap
def _influence(z, condition):
    slopes = jax.jacrev(lambda state: violation_of(state, condition))(z)
    return slopes, TABLETOP.dependence(z, condition, BUFFER)


def test_a_violation_depends_on_nobody_else(random_scenes):
    """Where `dependence` is False the Jacobian of V_j in z_i is zero; where it is True mostly not."""
    conditions, poses = random_scenes(3, 40, 9, "changed")
    more = random_scenes(4, 10, 12, "changed")
    slopes, depends = jax.tree.map(
        np.asarray, _influence(*padded(conditions + more[0], poses + more[1], 12))
    )
    moved = np.abs(slopes).max(axis=-1) > 0
    assert not np.any(moved & ~depends)
    assert np.all(depends[:, np.arange(12), np.arange(12)])  # on oneself, always
    others = depends & ~np.eye(12, dtype=bool)
    assert np.mean(moved[others]) > 0.95
    assert 0.02 < others[:, :9, :9].mean() < 0.9
    present = np.arange(12)[None] < np.array([[len(c.objects)] for c in conditions + more[0]])
    apart = ~(present[:, :, None] & present[:, None, :]) & ~np.eye(12, dtype=bool)
    assert not np.any(depends & apart)


def test_value_and_gradient_of_a_batch_are_those_of_its_scenes():
    """With the samples along the last axis inside, by automatic differentiation of one scene outside."""
    conditions = random_conditions(7, 5, "changed", 2)
    arrays = jax.tree.map(jnp.asarray, to_arrays(conditions))
    z = jax.random.normal(jax.random.key(0), (*arrays.mask.shape, 3)) * 0.5

    def plain(z, condition):
        return violation_of(z, condition), jax.grad(lambda z: jnp.sum(violation_of(z, condition)))(
            z
        )

    wanted = jax.jit(jax.vmap(plain))(z, arrays)
    for run in (jax.jit(jax.vmap(and_gradient)), partial(_one_by_one, jax.jit(and_gradient))):
        got = run(z, arrays)
        np.testing.assert_allclose(got[0], wanted[0], rtol=1e-5, atol=1e-8)
        np.testing.assert_allclose(got[1], wanted[1], rtol=1e-4, atol=1e-6)
    assert float(jnp.sum(wanted[0])) > 0.1
    # States alone in the batch, one condition for all of them.
    alone = jax.jit(jax.vmap(and_gradient, in_axes=(0, None)))(z, take(arrays, 0))
    np.testing.assert_allclose(alone[1][0], wanted[1][0], rtol=1e-4, atol=1e-6)


def _one_by_one(function, z, arrays):
    found = [function(z[k], take(arrays, k)) for k in range(len(z))]
    return jax.tree.map(lambda *leaves: jnp.stack(leaves), *found)


def test_the_gradient_has_a_derivative_in_a_batch_too():
    """What the growth of distances between samples needs."""
    arrays = jax.tree.map(jnp.asarray, to_arrays(random_conditions(5, 2, "changed", 1)))
    z = jax.random.normal(jax.random.key(3), (*arrays.mask.shape, 3)) * 0.5
    push = jax.random.normal(jax.random.key(4), z.shape)

    def slope(gradient):
        return jax.jit(lambda z: jax.jvp(lambda z: jax.vmap(gradient)(z, arrays), (z,), (push,)))(z)

    def plain(z, condition):
        return jax.grad(lambda z: jnp.sum(violation_of(z, condition)))(z)

    got, wanted = slope(lambda z, c: and_gradient(z, c)[1]), slope(plain)
    np.testing.assert_allclose(got[1], wanted[1], rtol=1e-3, atol=1e-4)
