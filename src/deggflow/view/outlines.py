"""Outlines of solids seen from above, and bodies moved to their poses."""

import numpy as np
from jaxtyping import Float
from scipy.spatial import ConvexHull

from .solids import Solid, frustum_corners, rotation

# rad, corners of the polygon that stands for a circle
ROUND = np.linspace(0.0, 2.0 * np.pi, 33)[:-1]

Polygon = Float[np.ndarray, "_ 2"]


def placed(points: Polygon, pose: Float[np.ndarray, " 3"]) -> Polygon:
    """Points of a body frame in the world, for a body's pose (m, m, rad)."""
    cos, sin = np.cos(pose[2]), np.sin(pose[2])
    return points @ np.array([[cos, sin], [-sin, cos]]) + pose[:2]


def silhouette(solid: Solid) -> Float[np.ndarray, "corners 2"]:
    """The solid's outline seen from above, as a polygon."""
    points = _surface(solid)[:, :2]
    return points[ConvexHull(points).vertices]


def _surface(solid: Solid) -> Float[np.ndarray, "points 3"]:
    """Points whose convex hull is the solid (up to the polygon that stands for a circle)."""
    circle = np.stack([np.cos(ROUND), np.sin(ROUND), np.zeros_like(ROUND)], axis=-1)
    tilts = np.linspace(-np.pi / 2, np.pi / 2, 9)[:, None, None]
    up = np.array([0.0, 0.0, 1.0])
    sphere = (np.cos(tilts) * circle + np.sin(tilts) * up).reshape(-1, 3)
    match solid.shape:
        case "capsule":
            ends = np.array([solid.at, solid.to])
            return (ends[:, None] + solid.size[0] * sphere).reshape(-1, 3)
        case "cylinder":
            radius, half = solid.size
            local = np.concatenate([radius * circle - half * up, radius * circle + half * up])
        case "frustum":
            local = frustum_corners(solid)
        case "box":
            signs = np.stack(np.meshgrid(*[[-1.0, 1.0]] * 3), axis=-1).reshape(-1, 3)
            local = signs * solid.size
        case "ellipsoid":
            local = sphere * solid.size
    return local @ rotation(solid.turn).T + solid.at
