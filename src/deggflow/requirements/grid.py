"""Obstacles given by an image: a signed-distance grid for guidance, rectangles for the verdict."""

from typing import Any

import equinox as eqx
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Bool, Float, Int
from scipy.ndimage import distance_transform_edt

from .regions import AbstractObstacle, Box, Each, Positions
from .term import hinge, length, root

SLACK = (
    0.7072  # cells, at least sqrt(1/2): by which interpolated distances may exceed the exact ones
)


class Grid(AbstractObstacle):
    """The occupied cells of an image, as closed squares.

    Guidance interpolates exact signed distances at the cells' corners by quadratic B-splines, which are continuously
    differentiable and differ from the exact distance by at most `SLACK` cells. Between waypoints it looks at
    `samples` points of each segment, from which the distance falls by at most half their spacing. The verdict
    measures the exact distance to the rectangles into which the occupied cells are joined.

    Attributes:
        nodes: Signed distances at the corners of the cells, in m; rows are y.
        origin: Lower left corner of the image, in m.
        cell: Length of a cell, in m.
        rectangles: That cover the occupied cells, all of them together; they do not overlap.
        seams: That cover the lines along which these touch, so that what is on such a line is inside.
        samples: Parts of each segment that are looked at.

    Example:
        >>> image = np.zeros((4, 6), bool)
        >>> image[1, 2:4] = True
        >>> Grid(image, origin=(0.0, 0.0), cell=0.5).rectangles.centre
        array([[1.5 , 0.75]])
    """

    nodes: Float[Array | np.ndarray, "rows columns"]
    origin: Float[Array | np.ndarray, "2"]
    cell: Float[Array | np.ndarray, ""]
    rectangles: Box
    seams: Box | None
    samples: int = eqx.field(static=True)

    def __init__(self, occupied: Any, origin: Any, cell: float, samples: int = 4) -> None:
        """From an image of booleans, True where occupied; its first row is the lowest."""
        image = np.asarray(occupied)
        if image.ndim != 2 or image.dtype != bool or not image.any():
            raise ValueError(
                "`occupied` must be boolean of shape (rows, columns), with some cell occupied; got "
                f"{image.dtype} of shape {image.shape} with {int(np.sum(image != 0))} occupied."
            )
        if not cell > 0:
            raise ValueError(f"`cell` must be positive, the length of a cell; got {cell}.")
        if not isinstance(samples, int) or samples < 1:
            raise ValueError(f"`samples` must be a positive number of parts; got {samples!r}.")
        self.nodes, self.cell, self.samples = (
            _node_distances(image) * cell,
            np.asarray(cell, float),
            samples,
        )
        self.origin = np.asarray(origin, float)
        if self.origin.shape != (2,) or not np.isfinite(self.origin).all():
            raise ValueError(
                f"`origin` must be two finite numbers, the lower left corner; got {origin!r}."
            )

        def boxes(low: Int[np.ndarray, "_ 2"], size: Int[np.ndarray, "_ 2"]) -> Box:
            return Box(self.origin + cell * (low + size / 2), cell * size)

        low, size = _rectangles(image)
        self.rectangles = boxes(low, size)
        low, size = _seams(image, low, size)
        self.seams = boxes(low, size) if len(low) else None

    @property
    def extent(self) -> Box:
        """The whole image."""
        size = self.cell * (np.array(self.nodes.shape)[::-1] - 1)
        return Box(self.origin + size / 2, size)

    def field(self, x: Positions) -> Float[Array, "agents waypoints"]:
        """Interpolated signed distance; beyond the image, where nothing is occupied, by way of the nearest point of it."""
        most = np.array(self.nodes.shape)[::-1] - 1
        free = (x - self.origin[:, None, None]) / self.cell
        place = jnp.clip(free, 0.0, jnp.asarray(most, x.dtype)[:, None, None])
        middle = jnp.round(place)
        weight = _spline(place - middle)
        total = jnp.zeros(x.shape[1:], x.dtype)
        for i in range(3):
            for j in range(3):
                column = jnp.clip(middle[0].astype(int) + i - 1, 0, int(most[0]))
                row = jnp.clip(middle[1].astype(int) + j - 1, 0, int(most[1]))
                total = total + weight[i][0] * weight[j][1] * jnp.asarray(self.nodes)[row, column]
        # No obstacle is nearer than the two legs of a right angle say.
        beyond = length(free - place) * self.cell
        farther = root(beyond**2 + jnp.where(total > 0, total, 0.0) ** 2)
        return jnp.where(beyond > 0, farther + jnp.where(total > 0, 0.0, total), total)

    def repulsion(self, x: Positions, reach: Any, eps: float) -> Each:
        slack = SLACK * self.cell
        if x.shape[2] == 1:
            distance = self.field(x)
        else:
            part = (jnp.arange(self.samples, dtype=x.dtype) / self.samples)[None, None, None]
            way = (x[..., 1:] - x[..., :-1])[..., None] * part
            points = (x[..., :-1][..., None] + way).reshape(*x.shape[:2], -1)
            values = self.field(jnp.concatenate([points, x[..., -1:]], axis=2))
            step = jnp.repeat(length(x[..., 1:] - x[..., :-1]), self.samples, axis=1) / self.samples
            distance = (values[:, 1:] + values[:, :-1] - step) / 2
        return hinge(reach + slack - distance[None])

    def clearance(self, x: Positions, swept: bool) -> Each:
        parts = (self.rectangles,) if self.seams is None else (self.rectangles, self.seams)
        every = jnp.concatenate([part.clearance(x, swept) for part in parts])
        return jnp.min(every, axis=0, keepdims=True)


def _spline(offset: Float[Array, "..."]) -> tuple[Float[Array, "..."], ...]:
    """Weights of the nodes before, at and after the nearest one; they reproduce linear functions."""
    return (0.5 - offset) ** 2 / 2, 0.75 - offset**2, (0.5 + offset) ** 2 / 2


def _node_distances(image: Bool[np.ndarray, "rows columns"]) -> Float[np.ndarray, "rows1 columns1"]:
    """Exact signed distances of all corners of cells to the occupied squares, in cells, negative inside.

    The nearest point of a square to a corner of the grid is a corner of that square.
    """

    def distance(cells: Bool[np.ndarray, "rows columns"]) -> Float[np.ndarray, "rows1 columns1"]:
        padded = np.pad(cells, 1)
        touches = padded[1:, 1:] | padded[:-1, 1:] | padded[1:, :-1] | padded[:-1, :-1]
        return distance_transform_edt(~touches)

    # The image ends in free space.
    inside = distance_transform_edt(~_touched_by_free(image))
    return distance(image) - inside


def _touched_by_free(image: Bool[np.ndarray, "rows columns"]) -> Bool[np.ndarray, "rows1 columns1"]:
    free = np.pad(~image, 1, constant_values=True)
    return free[1:, 1:] | free[:-1, 1:] | free[1:, :-1] | free[:-1, :-1]


def _rectangles(
    image: Bool[np.ndarray, "rows columns"],
) -> tuple[Int[np.ndarray, "rectangles 2"], Int[np.ndarray, "rectangles 2"]]:
    """Lower left corners and sizes, in cells, of rectangles that cover the occupied cells, each cell once."""
    left, low, size = image.copy(), [], []
    for row, column in np.argwhere(image):
        if not left[row, column]:
            continue
        run = left[row, column:]
        width = len(run) if run.all() else int(np.argmin(run))
        block = np.asarray(left[row:, column : column + width].all(axis=1))
        height = len(block) if block.all() else int(np.argmin(block))
        left[row : row + height, column : column + width] = False
        low.append((column, row))
        size.append((width, height))
    return np.array(low), np.array(size)


def _seams(
    image: Bool[np.ndarray, "rows columns"],
    low: Int[np.ndarray, "rectangles 2"],
    size: Int[np.ndarray, "rectangles 2"],
) -> tuple[Int[np.ndarray, "seams 2"], Int[np.ndarray, "seams 2"]]:
    """Lower left corners and sizes of rectangles of occupied cells that hold every inner point at which others touch.

    Of every line of the grid, the longest runs of pairs of occupied cells on both of its sides, if they are not of one
    rectangle.
    """
    owner = np.full(image.shape, -1)
    for k, ((x, y), (width, height)) in enumerate(zip(low, size, strict=True)):
        owner[y : y + height, x : x + width] = k
    out: list[tuple[Any, Any]] = []
    for cells, flip in ((owner, 1), (owner.T, -1)):
        both = np.pad((cells[1:] >= 0) & (cells[:-1] >= 0), ((0, 0), (1, 1)))
        change = np.diff(both.astype(int), axis=1)
        begins, ends = np.argwhere(change == 1), np.argwhere(change == -1)
        for (line, first), (_, last) in zip(begins, ends, strict=True):
            if np.ptp(cells[line : line + 2, first:last]) > 0:
                out.append(((first, line)[::flip], (last - first, 2)[::flip]))
    found = np.array(out, int).reshape(-1, 2, 2)
    return found[:, 0], found[:, 1]
