"""How far the objects of a scene must at least move, in z, until its requirements can hold: a certified lower bound.

A requirement holds only if some direction n separates two parts: n . (b - a) >= R for all points a, b of their cores,
where R is the sum of their radii. While an object moves by a distance e in z, the point v of its body moves along n by at
most

    e (rho + kappa^2 q^2 / (2 (rho - nu kappa^2 e))),   rho = |(half width n_x, half depth n_y)|,

with q = |n x v|, nu = max(0, +-n . v) and kappa = 1.35 rad (docs/theory.md, section 7). The directions are covered by
cells, and every quantity is bounded over its cell. Shares the list of parts with the margins, and nothing with verdict and
oracle.
"""

from collections.abc import Iterator, Sequence
from itertools import combinations, permutations
from typing import NamedTuple

import numpy as np
from jaxtyping import Float

from deggflow.deviation import Cuts, least_square_sum

from .codec import ANGLE_SCALE, decode_exactly
from .condition import PartRow, SceneCondition, primitive_rows, region_rows
from .library import object_type

CELLS = 720  # of directions
FARTHEST = 1.0  # in z, distance that the first bound assumes no object to exceed
ROUNDING = 1e-9  # m, of float64 arithmetic on lengths of order one
RATIOS = tuple(np.exp(np.linspace(-0.4, 0.4, 9)))  # of the weights of a pair's cuts


class _Part(NamedTuple):
    """A rounded box of one object, in the world.

    Attributes:
        arm: Points of its core relative to the object's origin, m.
        place: The same points, m.
        radius: How far the core is grown, m.
    """

    arm: Float[np.ndarray, "points 2"]
    place: Float[np.ndarray, "points 2"]
    radius: float


class _Speed(NamedTuple):
    """What a point's motion along a direction depends on, bounded over a cell of directions.

    Attributes:
        most: Largest rho, m.
        least: Smallest rho, m.
        turn: Largest q, m.
        bend: Largest nu, m.
    """

    most: Float[np.ndarray, "..."]
    least: Float[np.ndarray, "..."]
    turn: Float[np.ndarray, "..."]
    bend: Float[np.ndarray, "..."]

    def along(self, farthest: float) -> Float[np.ndarray, "..."]:
        """Most metres along the direction per unit of z, for objects that move by at most `farthest`."""
        room = self.least - self.bend * ANGLE_SCALE**2 * farthest
        with np.errstate(divide="ignore", invalid="ignore"):
            gain = np.where(self.turn > 0, (ANGLE_SCALE * self.turn) ** 2 / (2 * room), 0.0)
        return np.where(room > 0, self.most + gain, np.inf)


class _Scene(NamedTuple):
    """A scene in the world.

    Attributes:
        half: Half the table's width and depth, m.
        scale: Metres per unit of z along both; the same numbers, rounded as compiled programs know them.
        bodies: Of each object.
        regions: Of each object, as required.
    """

    half: Float[np.ndarray, " 2"]
    scale: Float[np.ndarray, " 2"]
    bodies: Sequence[Sequence[_Part]]
    regions: Sequence[Sequence[_Part]]


class _Shortfall(NamedTuple):
    """A requirement that does not hold: what must be gained along each direction, for each pair of points.

    Attributes:
        agents: Who can act; twice the same object at a wall.
        metres: What is missing.
        first: Of the first object.
        second: Of the second; None at a wall.
    """

    agents: tuple[int, int]
    metres: Float[np.ndarray, "points cells"]
    first: _Speed
    second: _Speed | None


def least_deviation(
    condition: SceneCondition, z: Float[np.ndarray, "objects 3"], *, cells: int = CELLS
) -> float:
    """A lower bound on sum_i |z'_i - z_i|^2 over all z' that satisfy the scene's requirements.

    It bounds every method, however it makes its samples. A requirement on the centre of mass is ignored, which leaves the
    bound valid. The bound is zero exactly if none of the other requirements is violated, up to the cells' width.

    Args:
        condition: Objects, requirements and table.
        z: State of each object, without padding.
        cells: Number of cells of directions; more make the bound larger by little.
    """
    shortfalls = list(_shortfalls(_scene(condition, z), cells))
    best, farthest = 0.0, FARTHEST
    for _ in range(2):
        least = least_square_sum(_cuts(shortfalls, farthest), len(z))
        # Either no object moves farther than assumed, or one of them does.
        best = max(best, min(least, farthest**2))
        farthest = 1.05 * float(np.sqrt(best))
    return best


def _scene(condition: SceneCondition, z: Float[np.ndarray, "objects 3"]) -> _Scene:
    half = np.array([condition.width, condition.depth]) / 2
    scale = decode_exactly(np.ones((1, 3)), condition)[0, :2]
    bodies, regions = [], []
    for name, (x, y, heading) in zip(condition.objects, decode_exactly(z, condition), strict=True):
        kind, need, origin = object_type(name), condition.affordance(name), np.array([x, y])
        bodies.append([_part(row, origin, heading) for row in primitive_rows(kind)])
        regions.append([_part(row, origin, heading) for row in region_rows(kind, need)])
    return _Scene(half, scale, bodies, regions)


def _part(row: PartRow, origin: Float[np.ndarray, " 2"], heading: float) -> _Part:
    """Corners of the core and the middles of its edges."""
    x, y, half_x, half_y, radius = row
    signs = np.array([(i, j) for i in (-1, 0, 1) for j in (-1, 0, 1) if (i, j) != (0, 0)])
    local = np.unique(signs * [half_x, half_y] + [x, y], axis=0)
    cos, sin = np.cos(heading), np.sin(heading)
    arm = local @ np.array([[cos, sin], [-sin, cos]])
    return _Part(arm, origin + arm, radius)


def _shortfalls(scene: _Scene, cells: int) -> Iterator[_Shortfall]:
    for i, parts in enumerate(zip(scene.bodies, scene.regions, strict=True)):
        yield from _wall_shortfalls(scene, i, [part for each in parts for part in each])
    count = len(scene.bodies)
    pairs = [(i, j, scene.bodies[i], scene.bodies[j]) for i, j in combinations(range(count), 2)]
    pairs += [(i, j, scene.regions[i], scene.bodies[j]) for i, j in permutations(range(count), 2)]
    for i, j, these, those in pairs:
        for a in these:
            for b in those:
                shortfall = _pair_shortfall(scene, i, j, a, b, cells)
                if shortfall is not None:
                    yield shortfall


def _speed(
    arm: Float[np.ndarray, "points 2"],
    scale: Float[np.ndarray, " 2"],
    angle: Float[np.ndarray, " cells"],
    width: float,
) -> _Speed:
    """Of points that move against the directions within `width` of each angle."""
    normal = np.stack([np.cos(angle), np.sin(angle)])
    rho, length = np.hypot(*(scale[:, None] * normal)), np.hypot(*arm.T)[:, None]
    change = abs(scale[0] - scale[1]) * width  # |d rho / d angle| is at most the difference
    turn = np.abs(arm[:, :1] * normal[1] - arm[:, 1:] * normal[0])
    most, least = np.minimum(rho + change, scale.max()), np.maximum(rho - change, scale.min())
    shape = turn.shape
    return _Speed(
        np.broadcast_to(most, shape),
        np.broadcast_to(least, shape),
        np.minimum(turn + length * width, length),
        np.clip(arm @ normal + length * width, 0.0, length),
    )


def _wall_shortfalls(scene: _Scene, i: int, parts: Sequence[_Part]) -> Iterator[_Shortfall]:
    """At each wall by itself, where the direction is known."""
    for angle in np.arange(4) * np.pi / 2:
        normal = np.round([np.cos(angle), np.sin(angle)])
        for part in parts:
            over = part.place @ normal + part.radius - abs(normal) @ scene.half - ROUNDING
            if np.any(over > 0):
                speed = _speed(part.arm, scene.scale, np.array([angle]), 0.0)
                yield _Shortfall((i, i), over[:, None], speed, None)


def _pair_shortfall(
    scene: _Scene, i: int, j: int, a: _Part, b: _Part, cells: int
) -> _Shortfall | None:
    reach = a.radius + b.radius - ROUNDING
    centres = [np.mean(each.place, axis=0) for each in (a, b)]
    extent = sum(np.max(np.hypot(*(p.place - c).T)) for p, c in zip((a, b), centres, strict=True))
    if np.hypot(*(centres[1] - centres[0])) >= reach + extent:
        return None
    first, second = np.divmod(np.arange(len(a.place) * len(b.place)), len(b.place))
    offset = b.place[second] - a.place[first]
    length = np.hypot(*offset.T)[:, None]
    width, angle = np.pi / cells, (np.arange(cells) + 0.5) * 2 * np.pi / cells
    turn = angle - np.arctan2(offset[:, 1], offset[:, 0])[:, None]
    apart = np.abs(np.remainder(turn + np.pi, 2 * np.pi) - np.pi)
    metres = reach - length * np.cos(np.maximum(apart - width, 0.0))
    if np.any(np.all(metres <= 0, axis=0)):
        return None
    return _Shortfall(
        (i, j),
        metres,
        _Speed(*(each[first] for each in _speed(a.arm, scene.scale, angle, width))),
        _Speed(*(each[second] for each in _speed(b.arm, scene.scale, angle + np.pi, width))),
    )


def _cuts(shortfalls: Sequence[_Shortfall], farthest: float) -> Cuts:
    agents, weights, least = [], [], []
    for each in shortfalls:
        metres, first = np.maximum(each.metres, 0.0), 1 / each.first.along(farthest)
        second = first if each.second is None else 1 / each.second.along(farthest)
        for ratio in (1.0,) if each.second is None else RATIOS:
            # The pair's points must all be separated along one direction; e_i + ratio e_j is least along the best.
            depth = np.min(np.max(metres * np.minimum(first, ratio * second), axis=0))
            if depth > 0:
                agents.append(each.agents)
                weights.append((1.0, 0.0 if each.second is None else ratio))
                least.append(depth)
    return Cuts(
        np.array(agents, int).reshape(-1, 2),
        np.array(weights, np.float64).reshape(-1, 2),
        np.array(least, np.float64),
    )
