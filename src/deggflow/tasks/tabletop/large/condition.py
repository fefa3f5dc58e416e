"""A large scene's condition as the padded arrays a compiled program reads, and the way from z to poses."""

from collections.abc import Iterable
from typing import Any, NamedTuple

import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Bool, Float, Int

from deggflow.shapes import Scalar
from deggflow.tasks.tabletop.codec import ANGLE_SCALE, Pose, in_frames
from deggflow.tasks.tabletop.condition import (
    EVERYWHERE,
    PartRow,
    SceneCondition,
    access_rows,
    primitive_rows,
    region_rows,
    strip_rows,
)
from deggflow.tasks.tabletop.geometry import RoundedBox
from deggflow.tasks.tabletop.library import (
    MAX_OBJECTS,
    NAMES,
    TABLE_DEPTH,
    TABLE_WIDTH,
    object_type,
    type_name,
)

STEPS = 8  # padded sizes between a number and its double


class LargeSceneParts(NamedTuple):
    """Rounded boxes fixed to agents, in a list of their own."""

    x: Float[Array, " parts"]  # m, in the owner's body frame
    y: Float[Array, " parts"]
    half_x: Float[Array, " parts"]  # m, of the core
    half_y: Float[Array, " parts"]
    radius: Float[Array, " parts"]
    valid: Bool[Array, " parts"]
    owner: Int[Array, " parts"]


class LargeSceneCondition(NamedTuple):
    """One large scene's condition chi, padded."""

    mask: Bool[Array, " agents"]
    kind: Int[Array, " agents"]
    anchor: Float[Array, "agents 2"]  # m, centre of each agent's window
    window: Float[Array, " 2"]  # m, half extents of a window
    bodies: LargeSceneParts
    regions: LargeSceneParts  # as required by the user
    strips: LargeSceneParts  # of each region: the row of its owner's, as of a table
    shape: LargeSceneParts  # one box per agent: its main body, which the field sees
    access: LargeSceneParts  # one capsule per agent: its default regions, which the field sees
    half_width: Scalar  # m, of the table
    half_depth: Scalar
    body_reach: Float[
        Array, ""
    ]  # m, between centres of bodies farther apart than this nothing binds
    region_reach: Scalar  # m, the same between a region and a body
    mass: Float[Array, " agents"]  # kg; zero for padding
    balance: Float[Array, " 3"]  # x, y, radius of the circle for the centre of mass, m


def is_large(condition: SceneCondition) -> bool:
    """Whether a scene has more objects than the library, or two of a type."""
    types = {type_name(name) for name in condition.objects}
    return len(types) < len(condition.objects)


def padded_count(count: int) -> int:
    """The next of the sizes that programs are compiled for: eight between a number and its double."""
    step = max(1, (1 << (max(count, MAX_OBJECTS) - 1).bit_length()) // (2 * STEPS))
    return -(-max(count, MAX_OBJECTS) // step) * step


def windows(condition: SceneCondition) -> tuple[int, int]:
    """Columns and rows of windows: as many as bring them closest to the trained table's size."""
    columns, rows = condition.width / TABLE_WIDTH, condition.depth / TABLE_DEPTH
    return max(1, round(columns)), max(1, round(rows))


def anchors(condition: SceneCondition) -> Float[np.ndarray, "objects 2"]:
    """Centre of each object's window, in m: windows are filled in turn, by the order of the objects."""
    columns, rows = windows(condition)
    count = len(condition.objects)
    # A large scene with fewer objects than windows leaves windows free all over, not at its end.
    spot = np.arange(count) * columns * rows // count
    row, column = np.divmod(spot, columns)
    x = ((column + 0.5) / columns - 0.5) * condition.width
    y = ((row + 0.5) / rows - 0.5) * condition.depth
    return np.stack([x, y], axis=-1)


def window_size(condition: SceneCondition) -> Float[np.ndarray, " 2"]:
    """Half extents of a window, m."""
    columns, rows = windows(condition)
    return np.array([condition.width / columns, condition.depth / rows]) / 2


def decode(z: Float[Array, "agents 3"], condition: LargeSceneCondition) -> Pose:
    """The decoder: anchor + diag(half window, 1.35) z."""
    place = condition.anchor + condition.window[None] * z[:, :2]
    return Pose(place[:, 0], place[:, 1], ANGLE_SCALE * z[:, 2])


def decode_exactly(
    z: Float[np.ndarray, "agents 3"], condition: SceneCondition
) -> Float[np.ndarray, "objects 3"]:
    """`decode` in float64 without the padding: x, y in m and theta in rad of each object."""
    own = z[: len(condition.objects)].astype(np.float64)
    place = anchors(condition) + window_size(condition) * own[:, :2]
    return np.concatenate([place, ANGLE_SCALE * own[:, 2:]], axis=1)


def place(parts: LargeSceneParts, pose: Pose) -> RoundedBox:
    """Parts put into the world with their owners' poses."""
    x, y, theta = (value[parts.owner] for value in pose)
    return in_frames(parts, x, y, jnp.cos(theta), jnp.sin(theta))


def _parts(rows: Iterable[tuple[int, PartRow]], size: int | None = None) -> LargeSceneParts:
    listed = list(rows)
    size = padded_count(len(listed)) if size is None else size
    values, valid = np.zeros((5, size), np.float32), np.zeros(size, bool)
    owner = np.zeros(size, np.int32)
    for k, (agent, row) in enumerate(listed):
        values[:, k], valid[k], owner[k] = row, True, agent
    columns: Any = (*values, valid, owner)
    return LargeSceneParts(*columns)


def _extent(parts: LargeSceneParts) -> float:
    """The farthest that any part reaches from its own centre, m."""
    return float(np.max(np.hypot(parts.half_x, parts.half_y) + np.asarray(parts.radius)))


def to_arrays(condition: SceneCondition, buffer: float) -> LargeSceneCondition:
    """One large scene as arrays; `buffer` is the violation's, m, by which cut-off radii go beyond the shapes."""
    names = condition.objects
    types = [object_type(name) for name in names]
    size = padded_count(len(names))
    mask, kind, mass = np.zeros(size, bool), np.zeros(size, np.int32), np.zeros(size, np.float32)
    anchor = np.zeros((size, 2), np.float32)
    mask[: len(names)] = True
    kind[: len(names)] = [NAMES.index(one.name) for one in types]
    mass[: len(names)] = [one.mass for one in types]
    anchor[: len(names)] = anchors(condition)
    bodies = _parts((k, row) for k, one in enumerate(types) for row in primitive_rows(one))
    needs = [condition.affordance(name) for name in names]
    regions, strips = (
        _parts(
            (k, row)
            for k, (one, need) in enumerate(zip(types, needs, strict=True))
            for row in rows(one, need)
        )
        for rows in (region_rows, strip_rows)
    )
    circle = condition.balance
    rest: Any = (
        bodies,
        regions,
        strips,
        _parts(((k, primitive_rows(one)[0]) for k, one in enumerate(types)), size),
        _parts(((k, access_rows(one)[0]) for k, one in enumerate(types)), size),
        np.float32(condition.width / 2),
        np.float32(condition.depth / 2),
        np.float32(2 * _extent(bodies) + buffer),
        np.float32(_extent(bodies) + _extent(regions) + buffer),
        mass,
        np.array(EVERYWHERE if circle is None else (circle.x, circle.y, circle.radius), np.float32),
    )
    arrays: Any = (mask, kind, anchor, window_size(condition).astype(np.float32))
    return LargeSceneCondition(*arrays, *rest)
