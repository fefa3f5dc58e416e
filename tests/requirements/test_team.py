"""Bodies against Shapely, graphs against SciPy, angles and curvatures against what they are of circles."""

import jax
import numpy as np
import pytest
import shapely
from scipy.sparse.csgraph import connected_components, minimum_spanning_tree
from shapely.geometry import LineString, Polygon

from deggflow import requirements as req

RNG = np.random.default_rng(0)


def margins(requirement, z, condition=None):
    with jax.enable_x64(True):
        return np.asarray(jax.jit(jax.vmap(lambda z: requirement.margins(z, condition)))(z))


def test_oriented_boxes_and_polygons():
    z = RNG.normal(size=(60, 3, 3)) * np.array([0.6, 0.6, 2.0])
    shapes = {
        (0.8, 0.4): Polygon([(0.4, 0.2), (-0.4, 0.2), (-0.4, -0.2), (0.4, -0.2)]),
        ((0.5, 0.0), (-0.3, 0.4), (-0.3, -0.4)): Polygon([(0.5, 0.0), (-0.3, 0.4), (-0.3, -0.4)]),
    }
    apart = 0
    for shape, body in shapes.items():
        values = margins(req.bodies_apart(shape, layout=req.poses()), z)
        for state, rows in zip(z, values, strict=True):
            placed = [
                shapely.affinity.translate(
                    shapely.affinity.rotate(body, angle, origin=(0, 0), use_radians=True), x, y
                )
                for x, y, angle in state
            ]
            for i in range(3):
                for j in range(i):
                    distance = placed[i].distance(placed[j])
                    assert max(rows[i, j], 0) == pytest.approx(distance, abs=1e-9)
                    assert rows[i, j] == pytest.approx(rows[j, i], abs=1e-12)
                    assert (rows[i, j] < 0) == (placed[i].intersection(placed[j]).area > 0)
                    apart += distance > 0
    assert 50 < apart < 300


def test_connectivity_is_that_of_the_graph():
    x = RNG.normal(size=(80, 6, 2))
    values = margins(req.connected(1.2), x)
    neighbours = margins(req.neighbour(0.8), x)
    for points, connected, near in zip(x, values, neighbours, strict=True):
        distance = np.linalg.norm(points[:, None] - points[None], axis=-1)
        longest = minimum_spanning_tree(distance).max()
        assert np.allclose(connected, 1.2 - longest, atol=1e-12)
        count, _ = connected_components(distance <= 1.2)
        assert (connected[0, 0] >= 0) == (count == 1)
        assert np.allclose(near[:, 0], 0.8 - np.sort(distance, axis=1)[:, 1], atol=1e-12)


def test_a_spanning_tree_of_those_that_are_present():
    from deggflow.requirements.team import _spanning_tree

    x = RNG.normal(size=(2, 7, 20))
    present = np.array([False, True, True, True, False, True, True])
    tree = np.asarray(_spanning_tree(jax.numpy.asarray(x), jax.numpy.asarray(present)))
    assert not tree[~present].any()
    for k in range(20):
        points = x[:, present, k].T
        distance = np.linalg.norm(points[:, None] - points[None], axis=-1)
        edges = tree[:, :, k][np.ix_(present, present)]
        assert edges.sum() == present.sum() - 1
        assert distance[edges].sum() == pytest.approx(
            minimum_spanning_tree(distance).sum(), rel=1e-6
        )


def test_headings_are_close_either_way_round():
    z = np.stack([np.zeros(500), np.zeros(500), RNG.uniform(-20, 20, 500)], axis=1)
    target = 3.0
    values = margins(req.heading(target, 0.7, layout=req.poses()), z[None])[0, :, 0]
    angle = np.abs(np.angle(np.exp(1j * (z[:, 2] - target))))
    assert np.allclose(values, 0.7 - angle, atol=1e-7)
    vector = np.concatenate([z[:, :2], 3.0 * np.cos(z[:, 2:]), 3.0 * np.sin(z[:, 2:])], axis=1)
    same = margins(req.heading(target, 0.7, layout=req.poses(vector=True)), vector[None])[0, :, 0]
    assert np.allclose(values, same, atol=1e-7)


@pytest.mark.parametrize("axes", [2, 3])
def test_curvature_of_a_circle_is_one_over_its_radius(axes):
    angle = np.linspace(0, 3.0, 200)
    radius = 0.8
    circle = radius * np.stack([np.cos(angle), np.sin(angle), 0 * angle][:axes], axis=1)
    layout = req.trajectories(200, axes=axes)
    values = margins(req.curvature(2.0, layout=layout), circle.reshape(1, 1, -1))
    assert np.allclose(values, 2.0 - 1 / radius, atol=1e-4)
    still = margins(req.curvature(2.0, layout=layout), np.zeros((1, 1, 200 * axes)))
    assert np.array_equal(still, np.full((1, 1, 198), 2.0))


def test_motion_by_numpy_and_shapely():
    x = RNG.normal(size=(20, 3, 6, 2))
    z = x.reshape(20, 3, -1)
    layout = req.trajectories(6, dt=0.5)
    way = np.diff(x, axis=2)
    speed = np.linalg.norm(way, axis=-1) / 0.5
    assert np.allclose(margins(req.speed(3.0, layout=layout), z), 3.0 - speed)
    change = np.linalg.norm(np.diff(way, axis=2), axis=-1) / 0.25
    assert np.allclose(margins(req.acceleration(3.0, layout=layout), z), 3.0 - change)
    lengths = [[LineString(path).length for path in paths] for paths in x]
    assert np.allclose(
        margins(req.path_length(9.0, layout=layout), z)[..., 0], 9.0 - np.array(lengths)
    )
    goal = np.array([0.1, -0.2])
    values = margins(req.deadline(goal, 4, within=1.0, layout=layout), z)
    assert np.allclose(values, 1.0 - np.linalg.norm(x[:, :, 4:] - goal, axis=-1))


def test_formation_and_centroid():
    z = RNG.normal(size=(20, 4, 2))
    places = RNG.normal(size=(4, 2))
    values = margins(req.formation(places, 1.0), z)[..., 0]
    off = (z - z.mean(axis=1, keepdims=True)) - (places - places.mean(axis=0))
    assert np.allclose(values, 1.0 - np.linalg.norm(off, axis=-1))
    values = margins(req.centroid(np.array([0.3, 0.1]), 1.0), z)[..., 0]
    wanted = 1.0 - np.linalg.norm(z.mean(axis=1) - [0.3, 0.1], axis=-1)
    assert np.allclose(values, wanted[:, None])


@pytest.mark.parametrize("held", ["none", "both", "start", "goal"])
def test_modes_are_orthonormal_and_vanish_at_held_ends(held):
    start = "start" if held in ("both", "start") else None
    goal = "goal" if held in ("both", "goal") else None
    layout = req.trajectories(12, start=start, goal=goal)
    modes = req.SmoothModes(layout, 5, free=(0.5, 0.9))
    table = modes.basis()
    assert np.allclose(table.T @ table, np.eye(modes.degrees), atol=1e-12)
    assert (table[0] == 0).all() == (start is not None)
    assert (table[-1] == 0).all() == (goal is not None)
    rough = np.sum(np.diff(table, axis=0) ** 2, axis=0)
    assert (np.diff(rough) > 0).all()
    z = jax.numpy.zeros((2, 24))
    early, late = (np.asarray(modes(jax.numpy.asarray(tau), z, None)) for tau in (0.2, 1.0))
    assert early.shape == (2, 24, 2 * modes.degrees)
    assert np.linalg.matrix_rank(early[0]) == 10
    assert np.linalg.matrix_rank(late[0]) == 2 * modes.degrees
    path = (early[0] @ RNG.normal(size=2 * modes.degrees)).reshape(12, 2)
    assert np.allclose(path, table[:, :5] @ (table[:, :5].T @ path), atol=1e-5)


@pytest.mark.parametrize(
    ("make", "message"),
    [
        (lambda: req.speed(0.1, layout=req.POINTS), "`layout` must have at least 2 waypoints"),
        (lambda: req.speed(-0.1, layout=req.trajectories(3)), "`limit` must be positive"),
        (
            lambda: req.deadline("goal", 9, within=0.1, layout=req.trajectories(3)),
            "`since` must be one of 3",
        ),
        (lambda: req.heading(0.0, 0.1, layout=req.POINTS), "`layout` must have a heading"),
        (lambda: req.bodies_apart((1.0, 0.0), layout=req.poses()), "`shape` must be positive"),
        (lambda: req.SmoothModes(req.trajectories(5), 6), r"`modes` must be in \[1, 5\]"),
        (lambda: req.connected(0.0), "`within` must be positive"),
    ],
)
def test_bad_arguments_are_refused(make, message):
    with pytest.raises(ValueError, match=message):
        make()
