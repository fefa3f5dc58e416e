"""The requirement that all objects share: their common centre of mass lies in a circle on the table."""

import math
from dataclasses import replace

import jax
import jax.numpy as jnp
import numpy as np
import pytest

from deggflow.tasks.tabletop.changes import random_conditions
from deggflow.tasks.tabletop.condition import Balance, SceneCondition, to_arrays
from deggflow.tasks.tabletop.generator import initial_noise
from deggflow.tasks.tabletop.oracle import TOLERANCE, least_margin, refutes
from deggflow.tasks.tabletop.requirements import imbalance
from deggflow.tasks.tabletop.verdict import Kind, judge

SCALE = np.array([[0.70, 0.47]])  # m per unit of z (paper)
AGENTS, SEED = 6, 4
ROOMY = {"width": 60.0, "depth": 60.0}  # m; nothing but the circle is in anybody's way


def random_circles(count, seed):
    """Conditions of one to six objects, each with a circle of its own, and states with noise in the padding."""
    rng = np.random.default_rng(seed)
    conditions = []
    for k in range(count):
        (plain,) = random_conditions(1 + k % AGENTS, 1, "default", seed, k)
        x, y, radius = rng.uniform([-0.5, -0.4, 0.01], [0.5, 0.4, 0.3])
        conditions.append(replace(plain, balance=Balance(x, y, radius)))
    return conditions, rng.normal(size=(count, AGENTS, 3))


def centre_of(condition, places, masses):
    """Centre of mass (m) in float64, exactly summed."""
    weights = [masses[name] for name in condition.objects]
    return [
        math.fsum(w * p[k] for w, p in zip(weights, places, strict=True)) / math.fsum(weights)
        for k in range(2)
    ]


def by_hand(condition, z, masses):
    """q from the definition, in float64."""
    circle = condition.balance
    centre = centre_of(condition, z[: len(condition.objects), :2] * SCALE, masses)
    away = math.dist(centre, (circle.x, circle.y)) / circle.radius
    return (away**2 - 1) / 2


@jax.jit
@jax.vmap
def values(z, condition):
    return imbalance(jnp.asarray(0.5), z, condition)  # tau does not enter


gradients = jax.jit(jax.vmap(jax.grad(lambda z, c: imbalance(jnp.asarray(0.5), z, c))))


def test_the_value_is_that_of_the_definition(masses):
    """Masses and circle are float32 in a compiled program, the rest is float64 here."""
    conditions, z = random_circles(40, 0)
    with jax.enable_x64(True):
        found = np.asarray(values(jnp.asarray(z), to_arrays(conditions, AGENTS)))
    expected = [by_hand(c, row, masses) for c, row in zip(conditions, z, strict=True)]
    np.testing.assert_allclose(found, expected, rtol=2e-6, atol=2e-6)


def test_the_gradient_is_that_of_finite_differences(masses):
    """Of the definition, not of the code; padding and headings do not enter."""
    conditions, z = random_circles(6, 1)
    with jax.enable_x64(True):
        found = np.asarray(gradients(jnp.asarray(z), to_arrays(conditions, AGENTS)))
    step = 1e-6
    for condition, row, slope in zip(conditions, z, found, strict=True):
        expected = np.zeros((AGENTS, 3))
        for index in np.ndindex(AGENTS, 3):
            ends = []
            for sign in (1, -1):
                moved = row.copy()
                moved[index] += sign * step
                ends.append(by_hand(condition, moved, masses))
            expected[index] = (ends[0] - ends[1]) / (2 * step)
        np.testing.assert_allclose(slope, expected, rtol=1e-5, atol=1e-5 * np.abs(slope).max())


@pytest.mark.parametrize("radius", [1e-3, 0.05, 1.0])
def test_a_value_below_zero_is_inside_the_circle(masses, radius):
    """In float32, of states around the circle's edge, also where it is small and far from the table's centre."""
    rng = np.random.default_rng(2)
    conditions, states = [], []
    for k in range(400):
        (plain,) = random_conditions(1 + k % AGENTS, 1, "default", 5, k)
        circle = Balance(*rng.uniform([-0.6, -0.4], [0.6, 0.4]), radius)
        angle, reach = rng.uniform(0, 2 * math.pi), radius * rng.uniform(0.95, 1.02)
        z = rng.normal(size=(AGENTS, 3))
        objects = z[: len(plain.objects), :2]
        target = [circle.x + reach * math.cos(angle), circle.y + reach * math.sin(angle)]
        shift = (np.array(target) - centre_of(plain, objects * SCALE, masses)) / SCALE[0]
        objects += shift[None]
        conditions.append(replace(plain, balance=circle))
        states.append(z.astype(np.float32))
    met = np.asarray(values(jnp.asarray(np.array(states)), to_arrays(conditions, AGENTS))) <= 0
    assert 50 < met.sum() < 350
    for condition, z, below in zip(conditions, states, met, strict=True):
        circle = condition.balance
        places = z[: len(condition.objects), :2].astype(float) * SCALE
        away = math.dist(centre_of(condition, places, masses), (circle.x, circle.y))
        assert not below or away <= circle.radius


LAPTOP_AND_CUP = ("laptop", "pen_cup")  # 1.4 and 0.3 kg
APART = np.array([(-0.3, 0.0, math.pi), (0.3, 0.0, 0.0)])
# Their centre of mass: -0.3 + 0.6 * 0.3 / 1.7 m from the table's centre.
CENTRE = -0.3 + 0.6 * 0.3 / 1.7


def verdict(circle, poses=APART, **table):
    return judge([SceneCondition(LAPTOP_AND_CUP, balance=circle, **table)], [poses])[0]


@pytest.mark.parametrize("heading", [0.0, 0.7, math.pi / 2, -2.5])
def test_the_margin_is_the_way_to_the_circles_edge(heading):
    """Any way off its centre, inside and outside; nothing else is close."""
    aside = 0.08 * math.cos(heading), 0.08 * math.sin(heading)
    inside = verdict(Balance(CENTRE + aside[0], aside[1], 0.1))
    assert inside.satisfied
    assert inside.min_margin == pytest.approx(0.02, abs=1e-12)
    outside = verdict(Balance(CENTRE + aside[0], aside[1], 0.05))
    assert not outside.satisfied
    assert outside.min_margin == pytest.approx(-0.03, abs=1e-12)
    (breach,) = outside.breaches
    assert (breach.kind, breach.owner, breach.other) == (Kind.BALANCE, -1, -1)
    assert breach.margin == outside.min_margin
    assert outside.reason(LAPTOP_AND_CUP) == "the centre of mass lies 0.0300 m outside its circle"


def test_headings_do_not_move_the_centre_of_mass():
    turned = APART + np.array([[0.0, 0.0, 1.1]])
    circle = Balance(CENTRE + 0.1, 0.0, 0.05)
    for poses in (APART, turned):
        assert verdict(circle, poses).min_margin == pytest.approx(-0.05, abs=1e-12)


def test_the_violation_is_of_private_requirements_alone():
    """V says how far each object is from what it needs itself; no circle changes it."""
    close = np.array([(0.0, 0.0, math.pi), (0.09, 0.0, 0.0)])  # into each other
    for poses, private in ((APART, True), (close, False)):
        plain = verdict(None, poses)
        assert plain.satisfied == private
        assert (plain.violation == 0) == private
        for circle in (Balance(0.0, 0.0, 1.0), Balance(0.4, 0.3, 1e-3), Balance(50.0, 50.0, 0.05)):
            found = verdict(circle, poses)
            assert found.violation == plain.violation
            own = tuple(b for b in found.breaches if b.kind is not Kind.BALANCE)
            assert own == plain.breaches


def test_a_worse_breach_stands_before_it():
    """The two overlap by about 0.03 m, the circle is missed by 0.01 m or by 1 m."""
    close = np.array([(0.0, 0.0, math.pi), (0.09, 0.0, 0.0)])
    centre = 0.09 * 0.3 / 1.7
    first = verdict(Balance(centre + 0.06, 0.0, 0.05), close).reason(LAPTOP_AND_CUP)
    assert first == "laptop and pen_cup overlap by 0.0290 m (and 1 more)"
    second = verdict(Balance(centre, 1.05, 0.05), close).reason(LAPTOP_AND_CUP)
    assert second == "the centre of mass lies 1.0000 m outside its circle (and 1 more)"


def test_a_place_that_is_not_a_number_is_not_balanced():
    condition = SceneCondition(("pen_cup", "desk_lamp"), balance=Balance(0.0, 0.0, 100.0), **ROOMY)
    good = np.array([(-0.3, 0.0, math.pi), (0.3, 0.0, 0.0)])
    assert judge([condition], [good])[0].satisfied
    for agent, column in np.ndindex(2, 2):
        poses = good.copy()
        poses[agent, column] = np.nan
        assert Kind.BALANCE in {b.kind for b in judge([condition], [poses])[0].breaches}
        assert refutes(condition, poses)


def test_shapely_agrees_with_the_verdict(random_scenes, reference):
    """On tables with so much room that the circle decides, and on the paper's, where other things do."""
    decided = kept = 0
    for crowding, table in ((6.0, ROOMY), (1.0, {})):
        conditions, poses = random_scenes(6, 60, 5, "balanced", crowding)
        rng = np.random.default_rng(7)
        conditions = [
            replace(c, balance=Balance(*rng.normal(size=2), rng.uniform(0.5, 2.0)), **table)
            for c in conditions
        ]
        for condition, pose, found in zip(conditions, poses, judge(conditions, poses), strict=True):
            margins = reference(condition, pose)
            opinion = least_margin(condition, pose)
            assert (opinion >= 0) == found.satisfied
            assert refutes(condition, pose) == (not found.satisfied)
            cores = [margins["separation of cores"], margins["unobstructed of cores"]]
            if np.all(np.concatenate(cores) > 0):
                assert opinion == pytest.approx(found.min_margin, abs=1e-9)
                decided += found.min_margin == pytest.approx(margins["balance"][0], abs=1e-9)
                kept += found.satisfied
    assert decided > 30
    assert kept > 10


def test_touching_the_circle_refutes_nobody():
    circle = Balance(CENTRE + 0.05, 0.0, 0.05)
    condition = SceneCondition(LAPTOP_AND_CUP, balance=circle)
    assert abs(least_margin(condition, APART)) < TOLERANCE
    assert not refutes(condition, APART)
    assert refutes(replace(condition, balance=replace(circle, radius=0.05 - 1e-6)), APART)
    assert refutes(replace(condition, balance=replace(circle, x=circle.x + 1e-6)), APART)


@pytest.fixture(scope="module")
def plain():
    """Two of each of N = 4, 5, 6, and one of 8 that decides the padding, as in other tests: one compiled program."""
    sizes = (4, 4, 5, 5, 6, 6, 8)
    return [random_conditions(n, 1, "changed", SEED, k)[0] for k, n in enumerate(sizes)]


@pytest.fixture(scope="module")
def mixed(plain):
    """Every other one shares a circle, the first of them not the table's own."""
    return [
        replace(c, balance=Balance(0.1, -0.05, 0.04) if k == 0 else Balance()) if k % 2 == 0 else c
        for k, c in enumerate(plain)
    ]


@pytest.fixture(scope="module")
def scenes(guided, mixed):
    return guided.scenes(mixed, seed=SEED)


def inside(condition, poses, masses):
    circle = condition.balance
    away = math.dist(centre_of(condition, poses, masses), (circle.x, circle.y))
    return away <= circle.radius


def test_guided_scenes_are_balanced_where_nominal_ones_are_not(nominal, mixed, scenes, masses):
    before = nominal.batch(initial_noise(SEED, np.arange(len(mixed)), 0), mixed).poses
    missed = 0
    for condition, pose, scene in zip(mixed, before, scenes, strict=True):
        assert scene.certificate.satisfied
        assert scene.certificate.draws <= 8
        assert not refutes(condition, scene.poses)
        if condition.balance is not None:
            assert inside(condition, scene.poses, masses)
            missed += not inside(condition, pose, masses)
    assert missed >= 3  # of four


def test_certificates_tell_of_both_requirements(scenes, masses):
    """Of the one only where it is asked for."""
    for scene in scenes:
        made = scene.certificate.generation
        shared = scene.condition.balance is not None
        names = ("affordance", "balance") if shared else ("affordance",)
        assert tuple(each.name for each in made.requirements) == names
        if shared:
            balance = made.requirements[1]
            z = scene.poses / [*SCALE[0], 1.0]
            assert balance.value == pytest.approx(by_hand(scene.condition, z, masses), abs=1e-4)
            assert balance.value <= balance.limit == 0


def test_scenes_that_share_no_circle_are_what_they_are_without(guided, plain, mixed):
    noise = initial_noise(SEED, np.arange(len(plain)), 0)
    with_circles, without = guided.batch(noise, mixed), guided.batch(noise, plain)
    for k, condition in enumerate(mixed):
        if condition.balance is None:
            np.testing.assert_allclose(with_circles.poses[k], without.poses[k], atol=1e-4)
