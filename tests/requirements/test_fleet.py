"""A fleet's plans end to end: robots that change places, by a field of straight lines and noise, in a few lines."""

from dataclasses import replace

import jax
import jax.numpy as jnp
import numpy as np
import shapely
from shapely.geometry import LineString, Point, box

from deggflow import DecoupledGuidance, sample
from deggflow import requirements as req
from deggflow.guidance import PowerSchedule

ROBOTS, WAYPOINTS, RADIUS, STEP = 5, 64, 0.05, 0.12
ANGLE = 2 * np.pi * np.arange(ROBOTS) / ROBOTS
START = (0.8 * np.stack([np.cos(ANGLE), np.sin(ANGLE)], axis=1)).astype(np.float32)
CONDITION = {"start": START, "goal": -START}
MODES = 12


def field(tau, z, condition):
    """The exact field from N(0, I) to a Gaussian around straight lines: std 0.1 / k along the sine modes of a path."""
    table = jnp.asarray(req.SmoothModes(LAYOUT, MODES).basis()[:, :MODES], z.dtype)
    s = jnp.linspace(0.0, 1.0, WAYPOINTS, dtype=z.dtype)[None, :, None]
    start, goal = condition["start"][:, None], condition["goal"][:, None]
    mean = start + s * (goal - start)
    offset = z.reshape(len(z), WAYPOINTS, 2) - tau * mean
    variance = (0.8 / jnp.arange(1, MODES + 1, dtype=z.dtype)) ** 2
    gain = tau * variance / (tau**2 * variance + (1 - tau) ** 2 + 1e-6)
    amplitude = gain[None, :, None] * jnp.einsum("tk,ntd->nkd", table, offset)
    end = mean + jnp.einsum("tk,nkd->ntd", table, amplitude)
    return (end.reshape(z.shape) - z) / jnp.maximum(1 - tau, 0.01)


LAYOUT = req.trajectories(WAYPOINTS, start="start", goal="goal")
BOXES = req.Box(np.array([[0.35, 0.3], [-0.3, -0.25]]), (0.16, 0.1))
POLYGON = req.Polygon([(-0.3, 0.25), (-0.1, 0.3), (-0.25, 0.45)])
DISC = req.Disc((0.25, -0.35), 0.08)


def plan_requirements():
    """The whole problem."""
    whole = (
        req.apart(distance=2.1 * RADIUS, layout=LAYOUT)
        + req.outside((BOXES, POLYGON, DISC), radius=RADIUS, layout=LAYOUT)
        + req.speed(STEP, layout=LAYOUT, buffer=0.005)
    )
    return replace(whole, omega=PowerSchedule(8.0))


GUIDANCE = DecoupledGuidance(
    (plan_requirements(),), control=req.SmoothModes(LAYOUT, 20, free=(0.8, 0.95))
)


def obstacles():
    shapes = [
        box(x - w / 2, y - h / 2, x + w / 2, y + h / 2)
        for (x, y), (w, h) in zip(BOXES.centre, BOXES.size, strict=True)
    ]
    return [*shapes, shapely.Polygon(POLYGON.hull.corners[0]), Point(0.25, -0.35).buffer(0.08, 512)]


def test_a_fleets_plans_are_certified_and_right():
    arguments = {"key": jax.random.key(0), "count": 4, "shape": (ROBOTS, 2 * WAYPOINTS)}
    nominal = sample(field, GUIDANCE, CONDITION, guided=False, **arguments)
    assert not nominal.satisfied.any()
    result = sample(field, GUIDANCE, CONDITION, **arguments)
    assert result.satisfied.all(), str(result)
    with jax.enable_x64(True):
        exact = jax.tree.map(lambda leaf: np.asarray(leaf, float), CONDITION)
        all_paths = np.asarray(LAYOUT.paths(np.asarray(result.z, float), exact))
    for paths in all_paths:
        assert np.array_equal(paths[:, 0], START)
        assert np.array_equal(paths[:, -1], -START)
        assert np.linalg.norm(np.diff(paths, axis=1), axis=-1).max() <= STEP
        for path in paths:
            motion = LineString(path)
            assert min(motion.distance(shape) for shape in obstacles()) >= RADIUS - 1e-5
        s = np.linspace(0, 1, 101)[:, None]
        for i in range(ROBOTS):
            for j in range(i):
                way = paths[i] - paths[j]
                between = way[:-1, None] + s * (way[1:] - way[:-1])[:, None]
                assert np.linalg.norm(between, axis=-1).min() >= 2.1 * RADIUS
