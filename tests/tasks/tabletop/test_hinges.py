"""Violations of pairs of boxes: bounds by Shapely's distances, continuity between parallel faces, curvature, descent."""

import math

import jax
import jax.numpy as jnp
import numpy as np
import pytest
import shapely
from shapely import affinity
from shapely.geometry import Point, box

from deggflow import generate
from deggflow.tasks.tabletop.codec import ANGLE_SCALE
from deggflow.tasks.tabletop.condition import SceneCondition, take, to_arrays
from deggflow.tasks.tabletop.geometry import RoundedBox
from deggflow.tasks.tabletop.hinges import DIAGONAL, box_violation, caught_violation, wall_violation
from deggflow.tasks.tabletop.library import object_type
from deggflow.tasks.tabletop.requirements import tabletop_guidance

BUFFER = 0.02
COUNT = 4000


def random_pairs(seed, spread=0.25):
    """Rows x, y, heading, half_x, half_y, radius of pairs near one another; points and segments among them."""
    rng = np.random.default_rng(seed)
    low = [-spread, -spread, -math.pi, 0.005, 0.005, 0.0]
    rows = rng.uniform(low, [spread, spread, math.pi, 0.2, 0.2, 0.05], (2, COUNT, 6))
    rows[0, ::5, 3:5] = 0.0
    rows[1, ::7, 3:5] = 0.0
    rows[0, ::11, 4] = 0.0
    rows[:, ::3, 2] = rng.integers(0, 4, (2, len(rows[0, ::3]))) * math.pi / 2  # parallel
    return rows


def placed(row):
    x, y, heading, half_x, half_y, radius = row
    return RoundedBox(x, y, jnp.cos(heading), jnp.sin(heading), half_x, half_y, radius)


@jax.jit
@jax.vmap
def _value(first, second):
    return box_violation(placed(first), placed(second), BUFFER)


@jax.jit
@jax.vmap
def _slope(first, second):
    def value(motion):
        a = placed(jnp.concatenate([motion[0], first[3:]]))
        b = placed(jnp.concatenate([motion[1], second[3:]]))
        return box_violation(a, b, BUFFER)

    return jax.value_and_grad(value)(jnp.stack([first[:3], second[:3]]))


def values(rows):
    with jax.enable_x64(True):
        return np.asarray(_value(*rows))


def slopes(rows):
    with jax.enable_x64(True):
        return jax.tree.map(np.asarray, _slope(*rows))


def core(row):
    x, y, heading, half_x, half_y, _ = row
    shape = box(-half_x, -half_y, half_x, half_y) if half_x > 0 and half_y > 0 else Point(0, 0)
    if half_x > 0 and half_y == 0:
        shape = shapely.LineString([(-half_x, 0), (half_x, 0)])
    return affinity.translate(affinity.rotate(shape, heading, (0, 0), use_radians=True), x, y)


def test_v_is_zero_where_the_distance_is_the_buffer_and_else_at_least_the_distances():
    rows = random_pairs(0)
    found = values(rows)
    distance = shapely.distance([core(row) for row in rows[0]], [core(row) for row in rows[1]])
    distance = distance - rows[0, :, 5] - rows[1, :, 5]
    exact = np.maximum(BUFFER - distance, 0.0) ** 2 / 2
    clear = np.abs(distance - BUFFER) > 1e-7
    np.testing.assert_array_equal(found[clear] > 0, distance[clear] < BUFFER)
    assert np.all(found >= exact * (1 - 1e-4))  # 1e-6 m of a root that is not taken
    assert np.all(found[distance < 0] > BUFFER**2 / 2)
    assert 0.2 < np.mean(distance < BUFFER) < 0.9


def test_v_of_overlapping_cores_grows_with_the_depth():
    """Crossing boxes too, of which no vertex is inside the other."""
    shift = np.linspace(0.0, 0.3, 31)
    rows = np.zeros((2, len(shift), 6))
    rows[:, :, 3:] = [0.2, 0.01, 0.002]
    rows[1, :, 2], rows[1, :, 0] = math.pi / 2, shift
    crossing = values(rows)
    assert crossing[0] > BUFFER**2 / 2
    assert np.all(np.diff(crossing) <= 1e-12)
    assert crossing[-1] == 0.0


def test_the_order_of_two_boxes_does_not_matter():
    rows = random_pairs(1)
    np.testing.assert_allclose(values(rows), values(rows[::-1]), rtol=1e-9, atol=1e-15)


@pytest.mark.parametrize("gap", [0.001, 0.015, 0.03])
@pytest.mark.parametrize("aside", [0.0, 0.05])
def test_v_has_no_convex_kink_between_parallel_faces(gap, aside):
    """Where another vertex becomes the nearest one, the distance's own slope jumps by a lever arm."""
    turn = np.array([-1e-7, 0.0, 1e-7])
    rows = np.zeros((2, 3, 6))
    rows[0, :, 3:], rows[1, :, 3:] = [0.14, 0.07, 0.01], [0.09, 0.06, 0.01]
    rows[1, :, 0], rows[1, :, 1], rows[1, :, 2] = aside, 0.13 + gap, turn
    value, slope = slopes(rows)
    assert value.min() > 0
    assert np.diff(slope[:, 1, 2]).max() < 1e-6
    if gap > DIAGONAL * (BUFFER + 0.02):  # no gap along an axis counts: no kink at all
        assert np.abs(np.diff(slope, axis=0)).max() < 1e-6
    assert np.abs(slope).max() > 1e-4


def motions(rng, size):
    return rng.normal(size=(COUNT, 2, 3)) * [1.0, 1.0, 5.0] * size


@pytest.mark.parametrize("size", [1e-4, 1e-3, 1e-2])
def test_v_rises_above_its_tangent_no_faster_than_the_geometric_bound(size):
    """Along random motions, kinks among them: V(z + d) <= V(z) + grad V(z) . d + bound(d), docs/theory.md section 3."""
    rows = random_pairs(2)
    rng = np.random.default_rng(3)
    motion = motions(rng, size)
    value, slope = slopes(rows)
    moved = rows.copy()
    moved[..., :3] += np.moveaxis(motion, 0, 1)
    rise = values(moved) - value - np.sum(slope * motion, axis=(1, 2))
    extent = np.hypot(rows[..., 3], rows[..., 4])
    reach = rows[..., 5].sum(axis=0) + BUFFER
    apart = np.hypot(*(rows[0] - rows[1])[:, :2].T)
    shift = np.hypot(motion[..., 0], motion[..., 1]).sum(axis=1)
    turn = np.abs(motion[..., 2])
    away = apart + shift + extent.max(axis=0)
    speed = shift + away * turn.sum(axis=1)
    hinge = reach + extent.sum(axis=0)
    bound = 8 * (speed**2 + 2 * hinge * turn.sum(axis=1) * speed)
    assert np.all(rise <= bound + 1e-15)
    assert np.max(rise / bound) > 0.005  # not a bound on nothing


@pytest.mark.parametrize("blocked", [1e-5, 1e-2])
def test_v_of_what_is_caught_has_concave_kinks_alone(blocked):
    """It rises above its tangent by at most (sigma^2 + 2 h t sigma) / 2, sigma and h as of two boxes."""

    @jax.jit
    @jax.vmap
    def both(motion, strip, obstacle):
        def value(motion):
            placed_strip = placed(jnp.concatenate([strip[:3] + motion[0], strip[3:]]))
            box = placed(jnp.concatenate([obstacle[:3] + motion[1], obstacle[3:]]))
            return caught_violation(placed_strip, box, jnp.asarray(blocked), BUFFER)

        return value(motion), jax.value_and_grad(value)(jnp.zeros((2, 3)))

    strips, obstacles = random_pairs(5)
    motion = motions(np.random.default_rng(6), 3e-3)
    with jax.enable_x64(True):
        moved, (value, slope) = jax.tree.map(np.asarray, both(motion, strips, obstacles))
    rise = moved - value - np.sum(slope * motion, axis=(1, 2))
    extent = strips[:, 4], np.hypot(obstacles[:, 3], obstacles[:, 4])
    shift, turn = np.hypot(motion[..., 0], motion[..., 1]).sum(axis=1), np.abs(motion[..., 2])
    away = np.hypot(*(strips - obstacles)[:, :2].T) + shift + extent[1]
    speed, hinge = (
        shift + away * turn.sum(axis=1),
        away + sum(extent) + strips[:, 5] + obstacles[:, 5],
    )
    bound = (speed**2 + 2 * (hinge + BUFFER) * turn.sum(axis=1) * speed) / 2
    assert np.all(rise <= bound + 1e-15)
    assert np.max(rise / bound) > 0.005
    assert np.mean(value > 0) > 0.3


def test_v_at_a_wall_is_at_least_its_margins_and_smooth_where_faces_are_parallel():
    turn = np.array([-1e-7, 0.0, 1e-7])
    rows = np.zeros((3, 6))
    rows[:, 3:], rows[:, 0], rows[:, 2] = [0.15, 0.08, 0.01], 0.55, turn

    def total(motion, row):
        shape = placed(jnp.concatenate([motion, row[3:]]))
        return wall_violation(shape, jnp.asarray(0.7), jnp.asarray(0.47), BUFFER)

    with jax.enable_x64(True):
        found = jax.vmap(jax.value_and_grad(total))(rows[:, :3], rows)
    value, slope = jax.tree.map(np.asarray, found)
    assert np.all(value >= (BUFFER + 0.01) ** 2 / 2)
    assert np.abs(np.diff(slope, axis=0)).max() < 1e-6


PAIR = SceneCondition(("drawer_organizer", "compact_printer"))


def face_to_face(gap):
    """The organizer and the printer back to back, with a drift of 2 toward one another, in z."""
    arrays = jax.tree.map(jnp.asarray, take(to_arrays([PAIR]), 0))
    halves = [object_type(name).primitives[0].half_y for name in PAIR.objects]
    z = np.zeros((len(arrays.mask), 3), np.float32)
    z[0, 1] = -0.03 / 0.47
    z[1] = 0.0, (-0.03 + sum(halves) + gap) / 0.47, math.pi / ANGLE_SCALE
    push = np.zeros_like(z)
    push[:2, 1] = 2.0, -2.0
    return arrays, jnp.asarray(z), jnp.asarray(push)


def test_faces_that_are_pressed_together_stay_apart_the_better_the_shorter_the_steps():
    """By the distance alone V rose to six times its floor here, in 1,000 steps and in 10,000."""
    guidance = tabletop_guidance()
    arrays, z0, push = face_to_face(0.03)
    largest = []
    for steps in (100, 1000, 10000):
        out = jax.jit(
            lambda z0, grid: generate(
                lambda tau, z, condition: push, guidance, z0, arrays,
                grid=grid, guard=None, mask=arrays.mask,
            )
        )(z0, jnp.linspace(0.0, 1.0, steps + 1))  # fmt: skip
        assert not int(out.summary.qp_infeasible_points.sum())
        assert not int(out.summary.infeasible_points.sum())
        largest.append(float(out.trace.value.max()))
    floor = BUFFER**2 / 2
    assert largest[0] > 10 * largest[1] > 100 * largest[2]
    assert largest[1] < 0.05 * floor
