"""Polygons and images with corners within edges, on seams and on integer coordinates, against Shapely."""

import jax
import jax.numpy as jnp
import numpy as np
import pytest
import shapely
from shapely.geometry import LineString, Point, Polygon

from deggflow import requirements as req
from deggflow import verdicts
from deggflow.requirements import exact

ELL = [(0, 0), (2, 0), (2, 1), (1, 1), (1, 2), (0, 2)]
CUP = [(0, 0), (3, 0), (3, 3), (2, 3), (2, 1), (1, 1), (1, 3), (0, 3)]
MOTION = req.trajectories(2)
FEW = np.arange(-1.0, 8.5, 0.5)


def margin(requirement, *numbers):
    return verdicts(np.array([numbers], float), (requirement,))[0].margin


def random_ring(rng):
    """A simple polygon on a grid of integers, with many corners on lines through others."""
    while True:
        ring = rng.integers(0, 7, (int(rng.integers(3, 9)), 2)).astype(float)
        shape = Polygon(ring)
        if shape.is_valid and shape.area > 0:
            return ring, shape


def test_what_lies_between_the_pieces_is_inside():
    ell, cup = req.Polygon(ELL), req.Polygon(CUP)
    assert margin(req.outside(ell), 0.5, 0.5) == pytest.approx(-0.5)
    assert margin(req.outside(ell, layout=MOTION), -0.5, -0.5, 1.5, 1.5) < -0.1
    assert margin(req.inside(cup), 1.5, 2.0) == pytest.approx(-0.5)
    always = req.Always(req.Without(ell))
    assert margin(req.satisfies(always, layout=MOTION), 0.5, 0.5, 0.5, 0.5) == pytest.approx(-0.5)


@jax.jit
def distances(ends, ring):
    """Of both ends and of the motion between them."""
    first, last = ends[:, 0].T, ends[:, 1].T
    points = jnp.stack([exact.point_from_ring(each, ring) for each in (first, last)])
    return points, exact.segment_from_ring(first, last, ring)


@pytest.mark.parametrize("seed", range(12))
def test_points_and_motions_on_a_grid_of_halves(seed):
    """Signed distances of points; of motions the distance, and whether they enter the polygon."""
    rng = np.random.default_rng(seed)
    ring, shape = random_ring(rng)
    ends = rng.choice(FEW, (60, 2, 2))
    corners = np.concatenate(
        [ring, np.repeat(ring[-1:], 8 - len(ring), axis=0)]
    )  # edges of no length
    with jax.enable_x64(True):
        points, motions = (np.asarray(each) for each in distances(ends, corners))
    for k, (first, last) in enumerate(ends):
        for point, value in zip((first, last), points[:, k], strict=True):
            signed = shape.exterior.distance(Point(point))
            signed *= -1 if shape.contains(Point(point)) else 1
            assert value == pytest.approx(signed, abs=1e-9)
        motion = LineString([first, last]) if (first != last).any() else Point(first)
        enters = shape.relate_pattern(motion, "T********")
        assert max(motions[k], 0.0) == pytest.approx(shape.distance(motion), abs=1e-9)
        assert (motions[k] < -1e-9) == enters


@pytest.mark.parametrize("seed", range(40))
def test_polygons_on_a_grid_are_cut_up_whole(seed):
    rng = np.random.default_rng(seed)
    for _ in range(20):
        ring, shape = random_ring(rng)
        turn = rng.uniform(0, 7)
        cos, sin = np.cos(turn), np.sin(turn)
        for corners in (ring, ring / 10 - 0.3, ring @ np.array([[cos, sin], [-sin, cos]])):
            region, whole = req.Polygon(corners), Polygon(corners)
            parts = [Polygon(each) for each in region.pieces.corners]
            assert sum(part.area for part in parts) == pytest.approx(whole.area)
            assert shapely.union_all(parts).symmetric_difference(whole).area < 1e-9
            if region.notches is None:
                assert whole.convex_hull.area == pytest.approx(whole.area)
            else:
                rest = sum(Polygon(each.ring).area for each in region.notches.regions)
                assert Polygon(region.hull.corners[0]).area - rest == pytest.approx(whole.area)
    assert shape.area > 0


def test_a_corner_on_the_third_edge_of_an_ear():
    corners = [
        (0.2, 0.0), (0.7, 0.4), (-0.2, 0.3), (-0.4, 0.0), (-0.8, -0.5), (0.0, -0.3), (0.1, -0.6),
    ]  # fmt: skip
    pieces = req.Polygon(corners).pieces.corners
    assert sum(Polygon(each).area for each in pieces) == pytest.approx(Polygon(corners).area)


@pytest.mark.parametrize("turn", np.linspace(0, 1.6, 50))
def test_corners_within_edges_are_left_out(turn):
    cos, sin = np.cos(turn), np.sin(turn)
    corners = np.array([(0, 0), (0.5, 0), (1, 0), (1, 0.3), (1, 1), (0.5, 1), (0, 1), (0, 0.5)])
    turned = corners @ np.array([[cos, sin], [-sin, cos]])
    square = req.Polygon(turned)
    assert square.notches is None
    assert len(square.ring) == 4
    req.bodies_apart(turned, layout=req.poses())
    assert len(req.Polygon([(0, 0), (1, 0), (0.7, 0.3), (0.4, 0.6), (0, 1)]).ring) == 3


@pytest.mark.parametrize(
    "corners",
    [
        [(0, 0), (4, 0), (4, 2), (2, 0), (2, -2), (0, -2)],
        [(0, 0), (2, 0), (2, 2), (1, 0), (0, 2)],
        [(0, 0), (1, 0), (2, 0), (1, 0), (1, 1)],
        [(0, 0), (1, 0), (1, 1), (0, 1), (0, 0), (1, 0), (1, 1), (0, 1)],
    ],
    ids=["a corner met again", "a corner on an edge", "a spike", "traced twice"],
)
def test_polygons_that_touch_themselves_are_refused(corners):
    assert not Polygon(corners).is_valid
    with pytest.raises(ValueError, match="whose edges neither cross nor touch each other"):
        req.Polygon(corners)


@jax.jit
def clearance(ends, centre, size):
    boxes = req.Box(centre, size)
    return jnp.min(boxes.clearance(jnp.moveaxis(ends, 2, 0), True), axis=0)[:, 0]


@pytest.mark.parametrize("seed", range(8))
def test_an_image_is_solid_where_its_rectangles_meet(seed):
    """Along lines of the grid, and everywhere else."""
    rng = np.random.default_rng(seed)
    image = rng.random((7, 7)) < 0.6
    grid = req.Grid(image, (0.0, 0.0), 1.0)
    cells = [shapely.box(x, y, x + 1, y + 1) for y, x in np.argwhere(image)]
    shape = shapely.union_all(cells)
    ends = rng.choice(FEW, (150, 2, 2))
    along = rng.random(150) < 0.6
    ends[along, 1, 0] = ends[along, 0, 0]
    boxes = (grid.rectangles,) if grid.seams is None else (grid.rectangles, grid.seams)
    centre, size = (np.concatenate([getattr(box, n) for box in boxes]) for n in ("centre", "size"))
    again = np.arange(60) % len(centre)  # of one shape, so that one program serves all images
    with jax.enable_x64(True):
        values = np.asarray(clearance(ends, centre[again], size[again]))
    if seed == 0:
        alone = grid.clearance(jnp.asarray(ends.transpose(2, 0, 1)), True)
        np.testing.assert_allclose(alone[0, :, 0], values, atol=1e-5)
    for (first, last), value in zip(ends, values, strict=True):
        motion = LineString([first, last]) if (first != last).any() else Point(first)
        assert (value < 0) == shape.relate_pattern(motion, "T********")
        assert max(value, 0.0) == pytest.approx(shape.distance(motion), abs=1e-12)


def test_far_from_an_image_nothing_is_asked():
    image = np.zeros((12, 12), bool)
    image[[0, -1]] = True
    image[:, [0, -1]] = True
    room = req.outside(req.Grid(image, (-1.0, -1.0), 1 / 6))
    rng = np.random.default_rng(0)
    z = jnp.asarray(rng.uniform(-3, 3, (400, 2)), jnp.float32)
    margins = np.asarray(room.margins(z, None))[:, 0]
    parts, slope = room.margins.violation_and_gradient(z, None, room.buffer)
    beyond = np.abs(z).max(axis=1) > 1.0
    assert (np.asarray(parts)[beyond & (margins > room.buffer + 0.3)] == 0).all()
    assert (np.asarray(parts)[margins < 0] > room.floor).all()
    assert np.isfinite(slope).all()


def test_an_agent_of_its_own_radius_beside_an_image():
    image = np.zeros((6, 6), bool)
    image[2:4, 2:4] = True
    grid = req.Grid(image, (-1.5, -1.5), 0.5)
    z = jnp.array([[0.0, 0.7], [0.0, 0.7]])
    radii = np.array([0.1, 0.3])
    for layout, states in ((req.POINTS, z), (MOTION, jnp.tile(z, (1, 2)))):
        each = [
            req.outside(grid, radius=float(r), layout=layout).margins.violation(states, None, 0.01)
            for r in radii
        ]
        both = req.outside(grid, radius=radii, layout=layout)
        values = both.margins.violation(states, None, 0.01)
        np.testing.assert_allclose(values, [each[0][0], each[1][1]])
        assert both.margins(states, None).shape == (2, 1)
