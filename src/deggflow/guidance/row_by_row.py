"""Projection of the origin onto a polyhedron in three dimensions or fewer, row by row (Seidel, 1991).

If the nearest point so far breaks the next row, the new one lies on that row's plane; if that plane's nearest
point breaks a row, on the line where both planes meet. Everything has a fixed shape and acts on all samples of
a batch at once.
"""

import jax
import jax.numpy as jnp
from jaxtyping import Array, Bool, Float, Int

from .active_set import crossing

MAX_INPUTS = 3
MAX_ROWS = 12  # the work grows with the cube of the rows
ROUNDING = 8  # times the precision: what sums of a few products may be off

Vector = tuple[Array, Array, Array]
"""Coordinates of points or directions; arrays of one shape, samples last."""


@jax.custom_batching.custom_vmap
def project_row_by_row(
    unit: Float[Array, "rows inputs *batch"], distance: Float[Array, "rows *batch"]
) -> tuple[Float[Array, "inputs *batch"], Bool[Array, "*batch"]]:
    """The point nearest to the origin with `unit @ v + distance <= 0`, and whether there is one.

    Where there is none, the point meets the rows before the first that contradicts them.

    Args:
        unit: Rows of length one, of at most `MAX_INPUTS` inputs; rows of zeros must have a distance of at most zero.
        distance: How far along its row the origin is outside each half-space.
    """
    rows, inputs = unit.shape[:2]
    zero = jnp.zeros_like(distance)
    normals = _vector([unit[:, k] if k < inputs else zero for k in range(MAX_INPUTS)])

    def add(
        k: Int[Array, ""], so_far: tuple[Vector, Array, Vector, Array]
    ) -> tuple[Vector, Array, Vector, Array]:
        v, feasible, on_planes, exists = so_far
        normal, offset, there = _row(normals, k), _pick(distance, k), _pick(exists, k)
        breaks = ~_met(normal, offset, v)
        v = _where(breaks & there, _row(on_planes, k), v)
        feasible &= there | ~breaks
        # From here on, planes of later rows have this row to meet, too; those of earlier ones are not asked for again.
        on_lines, meet = _on_lines(normals, distance, k)
        breaks = ~_met(normal, offset, on_planes)
        return v, feasible, _where(breaks & meet, on_lines, on_planes), exists & (meet | ~breaks)

    feet = _vector([-distance * part for part in normals])
    start = _vector([zero[:1]] * MAX_INPUTS), zero[:1] == 0, feet, zero == 0
    v, feasible, _, _ = jax.lax.fori_loop(0, rows, add, start)
    return jnp.concatenate(v[:inputs]), feasible[0]


@project_row_by_row.def_vmap
def _samples_last(axis_size, in_batched, unit, distance):  # type: ignore[no-untyped-def]
    """So that every operation is one on a vector of samples, not on a handful of rows or inputs."""
    leaves = [
        jnp.moveaxis(leaf, 0, -1) if batched else jnp.repeat(leaf[..., None], axis_size, -1)
        for leaf, batched in zip((unit, distance), in_batched, strict=True)
    ]
    v, feasible = project_row_by_row(*leaves)
    return (jnp.moveaxis(v, -1, 0), jnp.moveaxis(feasible, -1, 0)), (True, True)


def _on_lines(
    normals: Vector, distance: Float[Array, "rows *batch"], k: Int[Array, ""]
) -> tuple[Vector, Bool[Array, "rows *batch"]]:
    """On the line where plane k meets each other plane, the point nearest to the origin that meets the rows before k.

    And whether there is one; planes that are parallel meet nowhere.
    """
    normal, offset = _row(normals, k), _pick(distance, k)
    precision = float(jnp.finfo(distance.dtype).eps)
    across = _cross(normal, normals)
    square = _dot(across, across)  # of the sine between the two planes
    meet = square > crossing(distance.dtype) ** 2
    scale = jnp.where(meet, 1 / jnp.sqrt(jnp.where(meet, square, 1.0)), 0.0)
    along = _vector([part * scale for part in across])
    aside = _cross(along, normal)
    beyond = (distance - _dot(normal, normals) * offset) * scale
    foot = _vector([-offset * n - beyond * e for n, e in zip(normal, aside, strict=True)])
    size = jnp.sqrt(offset**2 + beyond**2)

    def cut(row: Int[Array, ""], ends: tuple[Array, Array]) -> tuple[Array, Array]:
        """What one more row leaves of the lines, as places along them."""
        least, most = ends
        other, apart = _row(normals, row), _pick(distance, row)
        slope, level = _dot(other, along), _dot(other, foot) + apart
        rises = slope > crossing(distance.dtype)
        falls = slope < -crossing(distance.dtype)
        place = -level / jnp.where(rises | falls, slope, 1.0)
        # A row that is level along the line is met everywhere on it or nowhere.
        above = level > ROUNDING * precision * (size + jnp.abs(apart))
        nowhere = above & ~rises & ~falls
        from_here = jnp.where(falls, place, jnp.where(nowhere, jnp.inf, -jnp.inf))
        to_there = jnp.where(rises, place, jnp.where(nowhere, -jnp.inf, jnp.inf))
        return (
            jnp.where(from_here > least, from_here, least),
            jnp.where(to_there < most, to_there, most),
        )

    endless = jnp.full_like(distance, jnp.inf)
    least, most = jax.lax.fori_loop(0, k, cut, (-endless, endless))
    place = jnp.where(least > 0, least, jnp.where(most < 0, most, 0.0))
    place = jnp.where(jnp.isfinite(place), place, 0.0)
    meet &= least <= most + ROUNDING * precision * (jnp.abs(place) + size)
    return _vector([f + place * a for f, a in zip(foot, along, strict=True)]), meet


def _met(normal: Vector, offset: Float[Array, "*batch"], v: Vector) -> Bool[Array, "..."]:
    """Whether a row holds at v, up to rounding."""
    rounding = ROUNDING * float(jnp.finfo(offset.dtype).eps)
    return _dot(normal, v) + offset <= rounding * (jnp.sqrt(_dot(v, v)) + jnp.abs(offset))


def _vector(parts: list[Array]) -> Vector:
    x, y, z = parts
    return x, y, z


def _pick(rows: Array, k: Int[Array, ""]) -> Array:
    """One of the rows, with an axis of length one."""
    return jax.lax.dynamic_index_in_dim(rows, k)


def _row(rows: Vector, k: Int[Array, ""]) -> Vector:
    return _vector([_pick(part, k) for part in rows])


def _where(condition: Array, new: Vector, old: Vector) -> Vector:
    return _vector([jnp.where(condition, a, b) for a, b in zip(new, old, strict=True)])


def _dot(a: Vector, b: Vector) -> Array:
    return a[0] * b[0] + a[1] * b[1] + a[2] * b[2]


def _cross(a: Vector, b: Vector) -> Vector:
    return (
        a[1] * b[2] - a[2] * b[1],
        a[2] * b[0] - a[0] * b[2],
        a[0] * b[1] - a[1] * b[0],
    )
