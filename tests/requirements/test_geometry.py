"""Exact margins against Shapely, and against dense sampling in space."""

import hypothesis.strategies as st
import jax
import jax.numpy as jnp
import numpy as np
import pytest
import shapely
from hypothesis import given
from requirement_cases import BOXES, CUBES, DISCS, GRID, IMAGE, NOTCHED, TRIANGLE
from shapely.geometry import LineString, Point, Polygon

from deggflow import requirements as req
from deggflow.requirements import exact

RNG = np.random.default_rng(0)
PATHS = RNG.normal(size=(150, 2, 2, 3)) * 0.9  # samples, axes, agents, waypoints


def rectangle(centre, size, angle):
    x, y = np.asarray(size) / 2
    shape = Polygon([(-x, -y), (x, -y), (x, y), (-x, y)])
    return shapely.affinity.translate(
        shapely.affinity.rotate(shape, angle, origin=(0, 0), use_radians=True), *centre
    )


SHAPES = {
    "boxes": (BOXES, [rectangle(*each) for each in zip(BOXES.centre, BOXES.size, BOXES.angle, strict=True)]),
    "triangle": (TRIANGLE, [Polygon(TRIANGLE.hull.corners[0])]),
    "notched": (NOTCHED, [Polygon(NOTCHED.ring)]),
    "grid": (GRID, [shapely.union_all([
        shapely.box(-1.6 + 0.2 * x, -1.2 + 0.2 * y, -1.4 + 0.2 * x, -1.0 + 0.2 * y) for y, x in np.argwhere(IMAGE)
    ])]),
}  # fmt: skip


def clearances(region, swept):
    with jax.enable_x64(True):
        return np.asarray(jax.jit(jax.vmap(lambda x: region.clearance(x, swept)))(PATHS))


@pytest.mark.parametrize("name", SHAPES)
@pytest.mark.parametrize("swept", [False, True])
def test_clearances_are_shapelys_distances(name, swept):
    """Outside; of overlap, the depth is that of the translation that parts them."""
    region, shapes = SHAPES[name]
    values = clearances(region, swept)
    outside = 0
    for k, path in enumerate(PATHS):
        for agent in range(2):
            for step in range(2 if swept else 3):
                ends = path[:, agent, step : step + 1 + swept].T
                motion = LineString(ends) if swept else Point(ends[0])
                for shape, value in zip(shapes, values[k, :, agent, step], strict=True):
                    distance = shape.distance(motion)
                    assert max(value, 0.0) == pytest.approx(distance, abs=1e-9)
                    assert value > 0 or distance < 1e-9
                    outside += distance > 0
    assert outside > 30


@jax.jit
def both_ways(ends, half):
    """A segment and a box around the origin, as such and as two polygons."""
    corner = jnp.stack([half, half * jnp.array([-1.0, 1.0]), -half, half * jnp.array([1.0, -1.0])])
    one = exact.segment_from_box(ends[0], ends[1], half)
    return one, exact.polygons_apart(corner, ends)


NUMBERS = st.integers(-8, 8).map(lambda k: k / 4)


@given(
    st.tuples(*[st.tuples(NUMBERS, NUMBERS)] * 2),
    st.tuples(*[st.sampled_from([0.25, 0.5, 1.0])] * 2),
)
def test_a_box_is_a_polygon(ends, half):
    """Two codes agree, with coordinates such that touching, parallel and standing still are common."""
    with jax.enable_x64(True):
        one, other = both_ways(np.array(ends), np.array(half))
    assert float(one) == pytest.approx(float(other), abs=1e-12)


def test_depths_part_what_overlaps():
    """Moved by its depth along some direction, a segment touches the box at most; by less, along none."""
    values = clearances(BOXES, True)
    angles = np.linspace(0, 2 * np.pi, 721)
    found = 0
    for k, agent, step in np.argwhere(values[:, 0] < -1e-3)[:20]:
        shape = SHAPES["boxes"][1][0]
        motion = LineString(PATHS[k, :, agent, step : step + 2].T)
        depth = -values[k, 0, agent, step]

        def parts(by, motion=motion, shape=shape):
            moved = [
                shapely.affinity.translate(motion, by * np.cos(a), by * np.sin(a)) for a in angles
            ]
            return any(shape.distance(each) > 0 for each in moved)

        assert not parts(0.999 * depth)
        assert parts(1.01 * depth)
        found += 1
    assert found == 20


def test_depth_inside_is_the_distance_to_the_boundary():
    with jax.enable_x64(True):
        depth = np.asarray(jax.vmap(TRIANGLE.depth)(PATHS))[:, 0]
    shape = Polygon(TRIANGLE.hull.corners[0])
    for value, point in zip(depth.ravel(), np.moveaxis(PATHS, 1, -1).reshape(-1, 2), strict=True):
        point = Point(point)
        signed = shape.exterior.distance(point) * (1 if shape.contains(point) else -1)
        if signed > 0:
            assert value == pytest.approx(signed, abs=1e-9)
        else:
            assert value <= 1e-9


def test_motion_in_space_by_dense_sampling():
    x = RNG.normal(size=(40, 3, 2, 2)) * 0.8
    with jax.enable_x64(True):
        values = np.asarray(jax.jit(jax.vmap(lambda x: CUBES.clearance(x, True)))(x))[..., 0]
        ball = req.Disc((0.1, 0.2, 0.0), 0.3)
        balls = np.asarray(jax.vmap(lambda x: ball.clearance(x, True))(x))[:, 0, :, 0]
    s = np.linspace(0, 1, 4001)
    points = x[..., :1] + (x[..., 1:] - x[..., :1]) * s
    for k in range(2):
        gap = np.abs(points - CUBES.centre[k][:, None, None]) - CUBES.size[k][:, None, None] / 2
        least = np.linalg.norm(np.maximum(gap, 0), axis=1).min(axis=-1)
        assert np.abs(np.maximum(values[:, k], 0) - least).max() < 2e-3
        assert ((values[:, k] < 0) >= (gap.max(axis=1) < 0).any(axis=-1)).all()
    least = np.linalg.norm(points - ball.centre[0][:, None, None], axis=1).min(axis=-1) - 0.3
    assert np.abs(balls - least).max() < 1e-3


def test_a_polygon_that_is_not_convex_is_its_pieces_and_its_hull_less_its_notches():
    pieces = shapely.union_all([Polygon(each) for each in NOTCHED.pieces.corners])
    ring = Polygon([(-1.5, -1.5), (1.5, -1.5), (1.5, 1.5), (0.0, 0.1), (-1.5, 1.5)])
    hull, notches = NOTCHED.hull.corners[0], NOTCHED.notches.regions
    rest = Polygon(hull).difference(shapely.union_all([Polygon(each.ring) for each in notches]))
    assert pieces.symmetric_difference(ring).area < 1e-12
    assert rest.symmetric_difference(ring).area < 1e-12


@pytest.mark.parametrize("seed", range(20))
def test_random_simple_polygons_are_cut_up_whole(seed):
    rng = np.random.default_rng(seed)
    angle = np.sort(rng.uniform(0, 2 * np.pi, 9))
    corners = rng.uniform(0.2, 1.0, 9)[:, None] * np.stack([np.cos(angle), np.sin(angle)], axis=1)
    ring = Polygon(corners)
    if not ring.is_valid:
        pytest.skip("edges cross")
    region = req.Polygon(corners[:: rng.choice([-1, 1])])
    pieces = shapely.union_all([Polygon(each) for each in region.pieces.corners])
    assert pieces.symmetric_difference(ring).area < 1e-9
    assert sum(Polygon(each).area for each in region.pieces.corners) == pytest.approx(ring.area)
    if region.notches is not None:
        area = sum(Polygon(each.ring).area for each in region.notches.regions)
        assert Polygon(region.hull.corners[0]).area - area == pytest.approx(ring.area)


def test_interpolated_distances_of_a_grid_are_within_its_slack():
    points = RNG.uniform(-1.6, 1.6, (2, 400, 1)) * np.array([1.0, 0.75])[:, None, None]
    with jax.enable_x64(True):
        x = jnp.asarray(points)
        field, verdict = np.asarray(GRID.field(x)), np.asarray(GRID.clearance(x, False))[0]
    shape = SHAPES["grid"][1][0]
    for value, own, point in zip(field.ravel(), verdict.ravel(), points[..., 0].T, strict=True):
        distance = shape.distance(Point(point))
        if distance > 0:
            assert abs(value - distance) <= 0.7072 * 0.2
            assert own == pytest.approx(distance, abs=1e-12)


def test_discs_meet_the_motion_of_points():
    values = clearances(DISCS, True)
    for k, path in enumerate(PATHS[:50]):
        for disc in range(2):
            motion = LineString(path[:, 0, :2].T)
            distance = motion.distance(Point(DISCS.centre[disc])) - DISCS.radius[disc]
            assert values[k, disc, 0, 0] == pytest.approx(distance, abs=1e-12)


@pytest.mark.parametrize(
    ("make", "message"),
    [
        (lambda: req.Polygon([(0.0, 0.0), (1.0, 1.0)]), "`corners` must enclose an area"),
        (lambda: req.Polygon([(0, 0), (1, 1), (1, 0), (0, 2.0)]), "edges neither cross nor touch"),
        (
            lambda: req.Disc(np.zeros((3, 2)), np.ones(2)),
            "`radius` must be one number or one for each of 3",
        ),
        (
            lambda: req.Box(np.zeros((3, 2)), np.ones((2, 2))),
            "`size` and `angle` must be one or one for each",
        ),
        (lambda: req.Grid(np.zeros((3, 3), bool), (0, 0), 0.1), "some cell occupied"),
        (lambda: req.Grid(IMAGE, (0, 0), -0.1), "`cell` must be positive"),
        (lambda: req.apart(distance=-1.0), "`distance` must be positive"),
        (lambda: req.trajectories(0), "`waypoints` must be a positive number"),
    ],
)
def test_bad_regions_are_refused(make, message):
    with pytest.raises(ValueError, match=message):
        make()


def test_wrong_kinds_are_refused():
    with pytest.raises(TypeError, match="exactly one of `distance` and `radius`"):
        req.apart()
    with pytest.raises(TypeError, match="`region` must be a"):
        req.outside(0.5)
