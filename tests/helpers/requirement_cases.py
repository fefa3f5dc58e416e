"""Every named requirement once, with states on which some margins hold and others do not."""

from typing import Any, NamedTuple

import jax
import jax.numpy as jnp
import numpy as np

from deggflow import PrivateRequirement
from deggflow import requirements as req

AGENTS, WAYPOINTS = 4, 5


class Case(NamedTuple):
    requirement: PrivateRequirement
    dim: int
    condition: Any = None
    scale: float = 1.0
    unit: str = "m"
    coarse: float = 0.0  # what guidance may fall short of the exact margin in addition


PATHS = req.trajectories(WAYPOINTS)
SPACE = req.trajectories(WAYPOINTS, axes=3)
DISCS = req.Disc(np.array([[0.3, 0.2], [-0.8, 0.5]]), np.array([0.4, 0.2]))
BALL = req.Disc((0.2, 0.1, -0.3), 0.5)
BOXES = req.Box(np.array([[0.5, 0.0], [-0.6, -0.4]]), (0.8, 0.3), np.array([0.4, -1.1]))
CUBES = req.Box(np.array([[0.5, 0.0, 0.1], [-0.6, -0.4, 0.3]]), (0.8, 0.3, 0.5))
TRIANGLE = req.Polygon([(-0.5, -0.6), (0.9, -0.2), (0.0, 0.8)])
NOTCHED = req.Polygon([(-1.5, -1.5), (1.5, -1.5), (1.5, 1.5), (0.0, 0.1), (-1.5, 1.5)])
IMAGE = np.zeros((12, 16), bool)
IMAGE[3:5, 2:9] = IMAGE[7:11, 10:13] = IMAGE[9, 3] = True
GRID = req.Grid(IMAGE, origin=(-1.6, -1.2), cell=0.2)
START = np.linspace(-1.0, 1.0, 2 * AGENTS).reshape(AGENTS, 2)
HELD = req.trajectories(WAYPOINTS, start="start", goal=-START)

CASES = {
    "apart": Case(req.apart(distance=0.7, buffer=0.1), 2),
    "apart, radii": Case(req.apart(radius=np.array([0.2, 0.3, 0.1, 0.4]), buffer=0.1), 3),
    "apart, poses": Case(req.apart(radius="radius", layout=req.poses(), buffer=0.1), 3, {"radius": np.float32(0.4)}),
    "apart, paths": Case(req.apart(distance=0.4, layout=PATHS, buffer=0.1), 2 * WAYPOINTS),
    "apart, space": Case(req.apart(distance=0.7, layout=SPACE, buffer=0.1), 3 * WAYPOINTS),
    "apart, held": Case(
        req.apart(radius=0.1, layout=HELD, buffer=0.1), 2 * WAYPOINTS, {"start": START.astype("f4")}
    ),
    "outside discs": Case(req.outside(DISCS, radius=0.2, buffer=0.1), 2),
    "outside ball": Case(req.outside(BALL, layout=SPACE, buffer=0.1), 3 * WAYPOINTS),
    "outside boxes": Case(req.outside(BOXES, buffer=0.1), 2),
    "outside boxes, paths": Case(req.outside(BOXES, layout=PATHS, radius=0.1, buffer=0.1), 2 * WAYPOINTS),
    "outside boxes, thin": Case(
        req.outside(req.Box((0.0, 0.0), (4.0, 0.01)), layout=PATHS, buffer=0.05), 2 * WAYPOINTS
    ),
    "outside cubes": Case(req.outside(CUBES, layout=SPACE, buffer=0.1), 3 * WAYPOINTS),
    "outside polygon": Case(req.outside(TRIANGLE, buffer=0.1), 2),
    "outside polygon, paths": Case(req.outside(NOTCHED, layout=PATHS, radius=0.1, buffer=0.1), 2 * WAYPOINTS, None, 2.0),
    "outside union": Case(req.outside((DISCS, BOXES, TRIANGLE), layout=PATHS, buffer=0.1), 2 * WAYPOINTS),
    "outside grid": Case(req.outside(GRID, buffer=0.1), 2, None, 0.4, coarse=0.3),
    "outside grid, paths": Case(
        req.outside(GRID, layout=PATHS, radius=0.05, buffer=0.1), 2 * WAYPOINTS, coarse=1.0
    ),
    "outside, condition": Case(
        req.outside("boxes", layout=PATHS, buffer=0.1), 2 * WAYPOINTS,
        {"boxes": jax.tree.map(lambda leaf: leaf.astype("f4"), BOXES)},
    ),
    "inside disc": Case(req.inside(req.Disc((0.0, 0.0), 1.0), radius=0.1, buffer=0.1), 2),
    "inside box": Case(req.inside(req.Box((0.0, 0.0), (2.0, 3.0), 0.3), buffer=0.1), 2),
    "inside cube, paths": Case(req.inside(req.Box((0.1, 0.0, 0.2), (2.0, 2.5, 2.2)), layout=SPACE, buffer=0.1), 3 * WAYPOINTS),
    "inside polygon": Case(req.inside(TRIANGLE, buffer=0.1), 2, None, 0.5),
    "inside notched": Case(req.inside(NOTCHED, layout=PATHS, buffer=0.1), 2 * WAYPOINTS),
    "inside union": Case(req.inside((DISCS, BOXES, TRIANGLE), buffer=0.1), 2),
    "inside union, paths": Case(req.inside((DISCS, BOXES), layout=PATHS, buffer=0.1), 2 * WAYPOINTS, None, 0.4),
    "speed": Case(req.speed(1.2, layout=PATHS, buffer=0.1), 2 * WAYPOINTS, unit="m/s"),
    "speed, of each": Case(
        req.speed(lambda c: c["limit"], layout=HELD, buffer=0.1), 2 * WAYPOINTS,
        {"limit": np.linspace(0.8, 1.5, AGENTS).astype("f4"), "start": START.astype("f4")}, unit="m/s",
    ),
    "acceleration": Case(
        req.acceleration(2.0, layout=req.trajectories(WAYPOINTS, axes=3, dt=0.5), buffer=0.1), 3 * WAYPOINTS, None, 0.5,
        unit="m/s^2",
    ),
    "curvature": Case(req.curvature(6.0, layout=PATHS, buffer=0.1), 2 * WAYPOINTS, None, 2.0, unit="1/m"),
    "curvature, space": Case(req.curvature(3.0, layout=SPACE, buffer=0.1), 3 * WAYPOINTS, None, 2.0, unit="1/m"),
    "length": Case(req.path_length(3.0, layout=PATHS, buffer=0.1), 2 * WAYPOINTS),
    "near": Case(req.near(START, 1.5, layout=req.POINTS, buffer=0.1), 2),
    "deadline": Case(req.deadline("goal", 3, within=0.8, layout=PATHS, buffer=0.1), 2 * WAYPOINTS, {"goal": np.float32([0.1, 0.3])}),
    "bodies": Case(req.bodies_apart((0.8, 0.4), layout=req.poses(), buffer=0.1), 3),
    "bodies, vectors": Case(
        req.bodies_apart([(0.5, 0.0), (-0.3, 0.4), (-0.3, -0.4)], layout=req.poses(vector=True), buffer=0.1), 4
    ),
    "bodies, paths": Case(
        req.bodies_apart((0.5, 0.2), layout=req.trajectories(WAYPOINTS, heading="angle"), buffer=0.1), 3 * WAYPOINTS
    ),
    "formation": Case(req.formation(START, 0.9, buffer=0.1), 2),
    "formation, paths": Case(req.formation(START, 1.5, layout=PATHS, buffer=0.1), 2 * WAYPOINTS),
    "centroid": Case(req.centroid(np.array([0.1, 0.2, 0.0]), 0.5, buffer=0.1), 3),
    "neighbour": Case(req.neighbour(0.7, buffer=0.1), 2),
    "neighbour, paths": Case(req.neighbour(1.0, layout=PATHS, buffer=0.1), 2 * WAYPOINTS),
    "connected": Case(req.connected(0.9, buffer=0.1), 2),
    "connected, paths": Case(req.connected(1.2, layout=SPACE, buffer=0.1), 3 * WAYPOINTS),
    "heading": Case(req.heading(3.0, 1.2, layout=req.poses(), buffer=0.1), 3, None, 4.0, unit="rad"),
    "heading, vectors": Case(
        req.heading(np.linspace(-2.0, 2.0, AGENTS), 1.5, layout=req.poses(vector=True), buffer=0.1), 4, unit="rad"
    ),
    "equal": Case(req.equal(lambda z, c: jnp.sum(z**2, axis=1, keepdims=True) - 1.0, 0.5, unit="m^2"), 2, None, unit="m^2", coarse=1e9),
    "equal, of two": Case(
        req.equal(lambda z, c: z - z[np.array([2, 1, 3, 0])], 0.5, unit="m"), 3, coarse=1e9
    ),
    "until": Case(
        req.satisfies(req.Until(req.Without(BOXES), req.Within(DISCS)), layout=PATHS, buffer=0.1), 2 * WAYPOINTS, coarse=0.2
    ),
    "visits": Case(
        req.satisfies(
            req.Eventually(req.Within(DISCS, 0.05)) & req.Always(req.Without(TRIANGLE) | req.Within("box")), layout=PATHS, buffer=0.1
        ),
        2 * WAYPOINTS, {"box": jax.tree.map(lambda leaf: leaf.astype("f4"), BOXES)}, coarse=0.2,
    ),
    "sum": Case(
        req.apart(distance=0.7, buffer=0.1) + req.outside(BOXES, buffer=0.05) + req.inside(TRIANGLE, buffer=0.2), 2
    ),
}  # fmt: skip
