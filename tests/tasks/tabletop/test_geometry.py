"""Signed distances of rounded boxes against Shapely."""

import math

import jax
import jax.numpy as jnp
import numpy as np
import pytest
import shapely
from hypothesis import given, settings
from hypothesis import strategies as st
from shapely import affinity

from deggflow.tasks.tabletop.geometry import (
    RoundedBox,
    box_distance,
    point_distance,
    separating_gap,
    wall_margins,
)

CLOSE = 1e-9  # m
HALF_WIDTH, HALF_DEPTH = 0.70, 0.47
COUNT = 300  # random pairs
NO_SIZE = ("half_x", "half_y", "radius")


def numbers(low, high):
    return st.floats(low, high, allow_subnormal=False)


SIZE = st.one_of(st.just(0.0), numbers(1e-3, 0.3))
# (x, y, heading, half extents of the core, radius): boxes, segments and disks
ROW = st.tuples(
    numbers(-0.5, 0.5),
    numbers(-0.5, 0.5),
    st.one_of(numbers(-math.pi, math.pi), st.sampled_from((0.0, math.pi / 2, math.pi))),
    SIZE,
    SIZE,
    st.one_of(st.just(0.0), numbers(1e-3, 0.2)),
)


def placed(row):
    x, y, heading, half_x, half_y, radius = row
    return RoundedBox(x, y, jnp.cos(heading), jnp.sin(heading), half_x, half_y, radius)


@jax.jit
def _measure(first, second):
    a, b = placed(first), placed(second)
    return {
        "distance": box_distance(a, b),
        "reversed": box_distance(b, a),
        "gap": separating_gap(a, b),
        "gap reversed": separating_gap(b, a),
        "centre": point_distance(b.x, b.y, a),
        "centre as disk": box_distance(a, b._replace(**dict.fromkeys(NO_SIZE, jnp.zeros(())))),
        "walls": jnp.stack(wall_margins(a, jnp.asarray(HALF_WIDTH), jnp.asarray(HALF_DEPTH))),
    }


def measure(first, second):
    with jax.enable_x64(True):
        found = _measure(jnp.asarray(first), jnp.asarray(second))
    return {name: np.asarray(value) for name, value in found.items()}


def corners(row):
    x, y, heading, half_x, half_y, _ = row
    signs = np.array([1 + 1j, -1 + 1j, -1 - 1j, 1 - 1j])
    world = complex(x, y) + np.exp(1j * heading) * (signs.real * half_x + 1j * signs.imag * half_y)
    return np.stack([world.real, world.imag], axis=-1)


@settings(deadline=None, max_examples=150)
@given(ROW, ROW)
def test_distance_of_two_boxes(core_distance, first, second):
    """Shapely's distance of the cores, or the depth of the Minkowski difference, minus the radii."""
    found = measure(first, second)
    core = core_distance(corners(first), corners(second))
    expected = float(core) - first[-1] - second[-1]
    assert found["distance"] == pytest.approx(expected, abs=CLOSE)
    assert found["reversed"] == pytest.approx(expected, abs=CLOSE)


@settings(deadline=None, max_examples=50)
@given(ROW, ROW)
def test_sign_of_the_distance_of_buffered_shapes(first, second):
    """Shapes grown by Shapely meet if and only if the signed distance is negative."""
    cores = [shapely.convex_hull(shapely.multipoints(corners(row))) for row in (first, second)]
    grown = [
        core.buffer(row[-1], quad_segs=64) if row[-1] else core
        for core, row in zip(cores, (first, second), strict=True)
    ]
    apart = shapely.distance(*grown)
    chord = 2e-4 * (first[-1] + second[-1])  # a polygon of 256 sides lies inside its circle
    found = measure(first, second)["distance"]
    if found > CLOSE:
        assert apart > 0
    if apart > chord + CLOSE:
        assert found > 0
    if apart > 0:
        assert abs(apart - max(found, 0.0)) <= chord + CLOSE


@settings(deadline=None, max_examples=100)
@given(ROW, ROW)
def test_distance_of_a_point(core_distance, first, second):
    found = measure(first, second)
    expected = core_distance(corners(first), [second[:2]]) - first[-1]
    assert found["centre"] == pytest.approx(float(expected), abs=CLOSE)
    assert found["centre as disk"] == pytest.approx(float(expected), abs=CLOSE)


@settings(deadline=None, max_examples=100)
@given(ROW, ROW)
def test_separating_gap_is_a_lower_bound(first, second):
    """It never exceeds the distance, and is the same where cores overlap."""
    found = measure(first, second)
    radii = first[-1] + second[-1]
    assert found["gap"] == pytest.approx(found["gap reversed"], abs=CLOSE)
    assert found["gap"] <= found["distance"] + CLOSE
    if found["distance"] + radii < -CLOSE:
        assert found["gap"] == pytest.approx(found["distance"], abs=CLOSE)


@settings(deadline=None, max_examples=50)
@given(ROW)
def test_wall_margins(row):
    """The bounding box of the core, grown by the radius, against the table's edges."""
    half = np.array([HALF_WIDTH, HALF_DEPTH])
    core = affinity.translate(
        affinity.rotate(
            shapely.convex_hull(
                shapely.multipoints([(s * row[3], t * row[4]) for s in (-1, 1) for t in (-1, 1)])
            ),
            row[2],
            origin=(0, 0),
            use_radians=True,
        ),
        row[0],
        row[1],
    )
    bounds = np.abs(np.reshape(core.bounds, (2, 2))).max(axis=0)
    np.testing.assert_allclose(measure(row, row)["walls"], half - bounds - row[5], atol=CLOSE)


def random_rows(count):
    rng = np.random.default_rng(0)
    low = np.array([[-0.3, -0.3, -math.pi, 0.01, 0.01, 0.0]])
    rows = rng.uniform(low, [[0.3, 0.3, math.pi, 0.2, 0.2, 0.1]], (2, count, 6))
    rows[0, ::3, 3:5] = 0.0  # disks among them
    rows[1, ::5, 3:5] = 0.0
    return rows


MEASURES = (
    lambda a, b: box_distance(a, b),
    lambda a, b: separating_gap(a, b),
    lambda a, b: point_distance(b.x, b.y, a),
    lambda a, b: wall_margins(a, jnp.asarray(HALF_WIDTH), jnp.asarray(HALF_DEPTH))[0],
    lambda a, b: wall_margins(a, jnp.asarray(HALF_WIDTH), jnp.asarray(HALF_DEPTH))[1],
)


def _of_motions(motions, first, second):
    """All measures of two boxes as a function of their x, y and heading."""
    a = placed(jnp.concatenate([motions[0], first[3:]]))
    b = placed(jnp.concatenate([motions[1], second[3:]]))
    return jnp.stack([measured(a, b) for measured in MEASURES])


_values = jax.jit(jax.vmap(_of_motions))
_jacobians = jax.jit(jax.vmap(jax.jacrev(_of_motions)))


def test_gradients_are_those_of_finite_differences():
    """In float64; kinks are told by one-sided differences that disagree, and are rare."""
    first, second = random_rows(COUNT)
    motions = np.stack([first[:, :3], second[:, :3]], axis=1)
    step, smooth = 1e-6, []
    with jax.enable_x64(True):
        jacobian = np.asarray(_jacobians(motions, first, second))
        middle = np.asarray(_values(motions, first, second))
        for box in range(2):
            for axis in range(3):
                shift = np.zeros((1, 2, 3))
                shift[0, box, axis] = step
                ahead = np.asarray(_values(motions + shift, first, second)) - middle
                behind = middle - np.asarray(_values(motions - shift, first, second))
                flat = np.abs(ahead - behind) < 1e-4 * step
                error = np.abs((ahead + behind) / (2 * step) - jacobian[:, :, box, axis])
                assert error[flat].max() < 1e-6
                smooth.append(flat.mean())
    assert min(smooth) > 0.99


def special_rows():
    """Pairs on the kinks: coincident, parallel, touching, at a corner, nested, without any size."""
    box, bar, dot = (0.2, 0.1, 0.02), (0.1, 0.0, 0.05), (0.0, 0.0, 0.06)
    out = []
    for a in (box, bar, dot):
        for b in (box, bar, dot):
            for x, y, heading in (
                (0.0, 0.0, 0.0),
                (0.0, 0.0, math.pi / 2),
                (0.0, 0.0, 0.3),
                (a[0] + b[0], 0.0, 0.0),
                (a[0] + b[0], a[1] + b[1], 0.0),
                (a[0], a[1], 0.7),
                (0.0, 1e-170, 0.0),
                (1.0, 0.0, math.pi / 4),
            ):
                out.append(((0.0, 0.0, 0.0, *a), (x, y, heading, *b)))
    rows = np.array(out).swapaxes(0, 1)
    return rows[:, np.resize(np.arange(len(out)), COUNT)]  # the shape that is compiled already


def test_gradients_are_finite_everywhere():
    first, second = special_rows()
    motions = np.stack([first[:, :3], second[:, :3]], axis=1)
    with jax.enable_x64(True):
        jacobian = np.asarray(_jacobians(motions, first, second))
    assert np.isfinite(jacobian).all()
    # A distance grows by at most the length of a motion.
    assert np.abs(jacobian[..., :2]).max() <= 1 + CLOSE


def test_gradient_is_finite_at_coincident_boxes_in_float32():
    rows = np.array([[0.1, 0.2, 0.5, 0.1, 0.05, 0.01], [0.1, 0.2, 0.0, 0.0, 0.0, 0.03]], np.float32)
    motions = np.stack([rows[:, :3], rows[:, :3]], axis=1)
    jacobian = _jacobians(motions, rows, rows)
    assert jacobian.dtype == np.float32
    assert np.isfinite(np.asarray(jacobian)).all()
