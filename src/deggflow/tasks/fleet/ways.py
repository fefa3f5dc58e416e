"""Ways from corner to corner: points along them at equal distances, round corners, and paths in time."""

from typing import NamedTuple

import numpy as np
from jaxtyping import Float, Int
from scipy.ndimage import gaussian_filter1d

FINE = 257  # points of a way before its timing
_ROUND = 6.0  # standard deviation of the kernel that rounds corners, in points


class Ways(NamedTuple):
    """Straight moves from corner to corner.

    Attributes:
        corners: Of each way, both ends included; behind its last corner, that corner again.
        sizes: How many each has; at least two.
    """

    corners: Float[np.ndarray, "ways most 2"]
    sizes: Int[np.ndarray, " ways"]

    @classmethod
    def straight(
        cls, start: Float[np.ndarray, "ways 2"], goal: Float[np.ndarray, "ways 2"]
    ) -> "Ways":
        """One move each."""
        return cls(np.stack([start, goal], axis=1), np.full(len(start), 2))


def joined(legs: Ways, each: int) -> Ways:
    """Ways of so many legs in a row; a leg begins where the one before it ends."""
    if each == 1:
        return legs
    parts = [
        corners[k % each > 0 : size] for k, (corners, size) in enumerate(zip(*legs, strict=True))
    ]
    ways = [np.concatenate(parts[k : k + each]) for k in range(0, len(parts), each)]
    sizes = np.array([len(way) for way in ways])
    last = [np.tile(way[-1:], (sizes.max() - len(way), 1)) for way in ways]
    return Ways(np.array([np.concatenate(pair) for pair in zip(ways, last, strict=True)]), sizes)


def evenly(
    ways: Ways,
) -> tuple[Float[np.ndarray, "ways fine 2"], Float[np.ndarray, " ways"]]:
    """Points at equal shares of each way's length, and these lengths.

    Example:
        >>> points, length = evenly(Ways(np.array([[[0.0, 0.0], [1.0, 0.0], [1.0, 3.0]]]), np.array([3])))
        >>> points[0, [0, 64, 128, 256]].tolist(), length.tolist()
        ([[0.0, 0.0], [1.0, 0.0], [1.0, 1.0], [1.0, 3.0]], [4.0])
    """
    corners, sizes = ways
    move, along = np.diff(corners, axis=1), np.zeros(corners.shape[:2])
    distance = np.hypot(move[..., 0], move[..., 1])
    np.cumsum(distance, axis=1, out=along[:, 1:])
    share = np.linspace(0.0, along[:, -1], FINE, axis=-1)
    passed = np.zeros(share.shape, int)
    for corner in along[:, 1:-1].T:
        passed += share >= corner[:, None]
    passed = np.minimum(passed, sizes[:, None] - 2)
    span = np.diff(along, axis=1)  # not the distance: it is what a share is compared with
    rest = share - np.take_along_axis(along, passed, 1)
    points = np.empty((*share.shape, 2))
    for axis in (0, 1):
        slope = move[..., axis] / np.where(span > 0, span, 1.0)
        here = np.take_along_axis(corners[..., axis], passed, 1)
        points[..., axis] = np.take_along_axis(slope, passed, 1) * rest + here
    points[:, -1] = corners[:, -1]
    return points, along[:, -1]


def rounded(points: Float[np.ndarray, "*ways fine 2"]) -> Float[np.ndarray, "*ways fine 2"]:
    """Ways with round corners, and the same ends."""
    room = FINE // 8
    width = [(0, 0)] * (points.ndim - 2) + [(room, room), (0, 0)]
    padded = np.pad(points, width, mode="reflect", reflect_type="odd")
    smooth = gaussian_filter1d(padded, _ROUND, axis=-2)[..., room:-room, :]
    smooth[..., [0, -1], :] = points[..., [0, -1], :]
    return smooth


def timed_points(
    points: Float[np.ndarray, "*shape fine 2"], progress: Float[np.ndarray, "*shape 64"]
) -> Float[np.ndarray, "*shape 64 2"]:
    """Where on their ways robots are, for progress from 0 to 1."""
    place = progress * (FINE - 1)
    low = np.clip(place.astype(int), 0, FINE - 2)
    share = (place - low)[..., None]
    at = [np.take_along_axis(points, (low + k)[..., None], axis=-2) for k in (0, 1)]
    return (1 - share) * at[0] + share * at[1]
