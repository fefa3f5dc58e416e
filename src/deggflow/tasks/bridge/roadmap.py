"""Roadmaps: straight moves of whole ticks between points of a lattice, starts and goals."""

from typing import NamedTuple

import numpy as np
from jaxtyping import Float, Int
from scipy.sparse import csr_array
from scipy.sparse.csgraph import connected_components
from scipy.spatial import cKDTree

from .ground import Clear, Points, Pose, placed
from .process import TICK
from .world import ROBOT_SPEED, X_MAX, X_MIN, Y_MAX, Y_MIN

STRIDE = ROBOT_SPEED * TICK  # m, longest path of a robot in one tick
PITCH = 0.17  # m, spacing of lattices: two ticks along them, three across
LINK = 0.55  # m, longest move between a lattice and a start or goal


class Lattice(NamedTuple):
    """Points where a robot can be, and straight moves between neighbours, each listed once."""

    points: Float[np.ndarray, "points 2"]
    one: Int[np.ndarray, " pairs"]
    other: Int[np.ndarray, " pairs"]
    component: Int[np.ndarray, " points"]  # points with the same number are connected


class Roadmap(NamedTuple):
    """Points, and moves between them in the order of their heads; every point has a move that waits."""

    points: Float[np.ndarray, "points 2"]
    tail: Int[np.ndarray, " moves"]
    head: Int[np.ndarray, " moves"]
    ticks: Int[np.ndarray, " moves"]  # that a move takes
    length: Float[np.ndarray, " moves"]  # m
    first: Int[np.ndarray, " points"]  # the first move that leads to each point
    wait: Int[np.ndarray, " points"]  # the last one, which waits there
    middles: cKDTree  # of the moves


def lines(pitch: float, offset: float) -> Float[np.ndarray, " lines"]:
    """Offset + k pitch, as far as the workspace can reach from any of its points."""
    count = int(np.hypot(X_MAX - X_MIN, Y_MAX - Y_MIN) / pitch) + 1
    return offset + pitch * np.arange(-count, count + 1)


def make_lattice(
    pose: Pose, x: Float[np.ndarray, " columns"], y: Float[np.ndarray, " rows"], clear: Clear
) -> Lattice:
    """The free part of the lattice of columns and rows in the frame at a pose, with diagonals."""
    points = placed(pose, np.stack(np.meshgrid(x, y, indexing="ij"), -1).reshape(-1, 2))
    free = clear(points, points)
    number = np.where(free, np.cumsum(free) - 1, -1).reshape(len(x), len(y))
    points = points[free]
    pairs = [
        (number[:-1], number[1:]),
        (number[:, :-1], number[:, 1:]),
        (number[:-1, :-1], number[1:, 1:]),
        (number[:-1, 1:], number[1:, :-1]),
    ]
    one, other = (np.concatenate([pair[k].ravel() for pair in pairs]) for k in (0, 1))
    one, other = one[(one >= 0) & (other >= 0)], other[(one >= 0) & (other >= 0)]
    straight = clear(points[one], points[other])
    one, other = one[straight], other[straight]
    graph = csr_array((np.ones(len(one)), (one, other)), shape=(len(points), len(points)))
    return Lattice(points, one, other, connected_components(graph, directed=False)[1])


def links(
    points: Points, lattice: Lattice, clear: Clear
) -> tuple[Int[np.ndarray, " links"], Int[np.ndarray, " links"]]:
    """Straight moves from points to the lattice: numbers of the points, and of the lattice's points."""
    near = cKDTree(points).sparse_distance_matrix(
        cKDTree(lattice.points), LINK, output_type="ndarray"
    )
    point, to = near["i"], near["j"]
    straight = clear(points[point], lattice.points[to])
    return point[straight], to[straight]


def make_roadmap(
    lattice: Lattice, starts: Points, goals: Points, clear: Clear
) -> tuple[Roadmap, list[tuple[int, int]]]:
    """The roadmap of a lattice, and the numbers of every robot's start and goal on it."""
    count = len(lattice.points)
    start, out = links(starts, lattice, clear)
    goal, into = links(goals, lattice, clear)
    points = np.concatenate([lattice.points, starts, goals])
    stay = np.arange(len(points))
    first_goal = count + len(starts)
    tail = np.concatenate([lattice.one, lattice.other, start + count, into, stay])
    head = np.concatenate([lattice.other, lattice.one, out, goal + first_goal, stay])
    order = np.argsort(head, kind="stable")
    tail, head = tail[order], head[order]
    length = np.linalg.norm(points[head] - points[tail], axis=-1)
    ticks = np.maximum(np.ceil(length / STRIDE - 1e-9), 1).astype(int)
    first, after = (np.searchsorted(head, stay, side) for side in ("left", "right"))
    middles = cKDTree((points[tail] + points[head]) / 2)
    ends = [(count + k, first_goal + k) for k in range(len(starts))]
    return Roadmap(points, tail, head, ticks, length, first, after - 1, middles), ends
