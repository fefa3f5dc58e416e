"""Demonstrations of teams: candidate paths of each robot with its map's skill, and a choice without conflicts.

Skills after MMD: straight on the empty map; through the upper corridor of the conveyor to the left, through the lower one
to the right; counter-clockwise on highways; by way of a waiting point on drop_region; elsewhere short ways.
"""

from functools import lru_cache
from typing import NamedTuple

import numpy as np
from jaxtyping import Bool, Float

from .choice import choose, least_distance
from .clearance import clearance, within
from .condition import APART, FleetCondition
from .maps import NAMED, WAITING_POINTS
from .paths import WAYPOINTS
from .roadmap import Roadmap, make_roadmap
from .ways import FINE, evenly, joined, rounded, timed_points

ROUTES, SHAPES = 4, 5  # candidates of a robot: routes, and bends and timings of each
ATTEMPTS = 8  # choices of a team, with new candidates each
CLEAR = 0.006  # map units, room between a disc and an obstacle or the bounds along a demonstration
SPARE = 0.002  # map units, beyond the least distance of two robots
BLOCKED = 50.0  # cost of a candidate that is not clear or too fast
PACE = 0.95  # largest share of the speed limit
VARIANTS = 24  # weightings of the roadmaps of named maps
_BEND = {"empty": 0.12}  # map units, standard deviation of the slowest bend
_BEND_ELSEWHERE = 0.05
_WAIT = 0.25  # share of the time at a waiting point
_CORRIDOR, _END, _JITTER = 0.175, 0.4, 0.045  # of the conveyor: height, ends in x, spread in y

Point = Float[np.ndarray, " 2"]


class Routes(NamedTuple):
    """Routes of robots.

    Attributes:
        points: Points at equal shares of each one's length, corners rounded.
        length: In map units.
        stop: Share of the length where the robot waits a quarter of the time; negative if it does not.
    """

    points: Float[np.ndarray, "robots routes fine 2"]
    length: Float[np.ndarray, "robots routes"]
    stop: Float[np.ndarray, "robots routes"]


class Team(NamedTuple):
    """A demonstration.

    Attributes:
        paths: One path per robot, in map units.
        apart: Least distance of two robots' centres at any time.
    """

    paths: Float[np.ndarray, "robots 64 2"]
    apart: float


@lru_cache(maxsize=8)
def _named_roadmap(name: str) -> Roadmap:
    rng = np.random.default_rng([len(name), *name.encode()])
    return make_roadmap(NAMED[name], rng, VARIANTS, one_way=name == "highways")


def roadmap(condition: FleetCondition, rng: np.random.Generator) -> Roadmap:
    """The roadmap of a condition's map; that of a named map is always the same."""
    if isinstance(condition.map, str):
        return _named_roadmap(condition.map)
    return make_roadmap(condition.floor, rng, ROUTES, radius=condition.radius)


def _stops(name: str, start: Point, goal: Point, rng: np.random.Generator) -> list[Point]:
    """Where a map's skill leads a robot on its way."""
    if name == "drop_region":
        return [np.array(WAITING_POINTS[rng.integers(len(WAITING_POINTS))])]
    if name == "conveyor":
        across = goal[0] - start[0]
        right = across > 0 if abs(across) > 1e-6 else rng.uniform() < 0.5
        side = 1.0 if right else -1.0
        y = rng.uniform(-_JITTER, _JITTER) - side * _CORRIDOR
        return [np.array([-side * _END, y]), np.array([side * _END, y])]
    return []


def _draw_routes(condition: FleetCondition, rng: np.random.Generator) -> Routes:
    roads, name = roadmap(condition, rng), _name(condition)
    stops, variants = [], []
    for start, goal in zip(condition.starts, condition.goals, strict=True):
        for _ in range(ROUTES):
            stops.append([start, *_stops(name, start, goal, rng), goal])
            variants.append(rng.integers(len(roads.length)))
    places = np.array(stops)
    each = places.shape[1] - 1  # legs of a route
    ends = np.stack([places[:, :-1].reshape(-1, 2), places[:, 1:].reshape(-1, 2)])
    legs = roads.ways(ends, np.repeat(variants, each)[:, None])
    points, length = evenly(joined(legs, each))
    stop = np.full(len(length), -1.0)
    if name == "drop_region":
        first = np.linalg.norm(np.diff(legs.corners[::each], axis=1), axis=-1).sum(-1)
        stop = first / np.maximum(length, 1e-9)
    shape = (len(condition.robots), ROUTES)
    return Routes(
        rounded(points).reshape(*shape, FINE, 2), length.reshape(shape), stop.reshape(shape)
    )


def _name(condition: FleetCondition) -> str:
    """Of the map; empty for one that has none."""
    return condition.map if isinstance(condition.map, str) else ""


def _bends(
    rng: np.random.Generator, size: float, shape: tuple[int, ...]
) -> Float[np.ndarray, "*shape fine 2"]:
    """Smooth random offsets, zero at both ends and for the first shape of every route."""
    amplitude = size * rng.normal(size=(*shape, 3, 2)) / np.arange(1, 4)[:, None]
    amplitude[..., 0, :, :] = 0.0
    waves = np.sin(np.pi * np.outer(np.linspace(0, 1, FINE), np.arange(1, 4)))
    return waves @ amplitude


def _timing(
    rng: np.random.Generator, most: Float[np.ndarray, "*shape"]
) -> Float[np.ndarray, "*shape 64"]:
    """Random progress from 0 to 1 that never advances by more than `most` in a step; the first shape's is even."""
    shape, steps = most.shape, WAYPOINTS - 1
    t = (np.arange(steps) + 0.5) / steps
    ramps = rng.normal(size=(*shape, 2)) * np.array([0.6, 0.4])
    speed = np.exp(ramps @ np.stack([2 * t - 1, np.cos(2 * np.pi * t)]))
    waits = rng.uniform(0.0, 0.35, shape) * (rng.uniform(size=shape) < 0.4)
    late = rng.uniform(size=shape) < 0.5
    share = np.where(late[..., None], 1 - t, t)
    speed = speed / (1 + np.exp((waits[..., None] - share) / 0.02) * (waits[..., None] > 0))
    advance = speed / speed.sum(-1, keepdims=True)
    even = 1 / steps
    room = np.maximum(most - even, 0.0) / np.maximum(advance.max(-1) - even, 1e-9)
    mix = np.minimum(room, 1.0)
    mix[..., 0] = 0.0
    advance = even + mix[..., None] * (advance - even)
    progress = np.concatenate([np.zeros((*shape, 1)), np.cumsum(advance, axis=-1)], axis=-1)
    return progress / progress[..., -1:]


def _held(
    progress: Float[np.ndarray, "*shape 64"], stop: Float[np.ndarray, "*shape"]
) -> Float[np.ndarray, "*shape 64"]:
    """Progress along the way when a quarter of the time is spent at `stop`."""
    reach = stop[..., None] * (1 - _WAIT)
    before = np.minimum(progress / (1 - _WAIT), stop[..., None])
    after = stop[..., None] + np.maximum(progress - reach - _WAIT, 0.0) / (1 - _WAIT)
    return np.where(
        stop[..., None] < 0, progress, np.where(progress < reach + _WAIT, before, after)
    )


def candidates(
    condition: FleetCondition, rng: np.random.Generator
) -> tuple[
    Float[np.ndarray, "robots candidates 64 2"],
    Float[np.ndarray, "robots candidates"],
    Bool[np.ndarray, "robots candidates"],
]:
    """Paths of each robot, what each costs without the others, and whether it is clear and within the speed limit."""
    name, routes = _name(condition), _draw_routes(condition, rng)
    points, length, stop = (each[:, :, None] for each in routes)
    shape = (*routes.length.shape, SHAPES)
    bends = _bends(rng, _BEND.get(name, _BEND_ELSEWHERE), shape)
    slope = np.where(stop < 0, 1.0, 1 / (1 - _WAIT))
    most = PACE * condition.speed_limit / np.maximum(1.1 * length * slope, 1e-9)
    progress = _timing(rng, np.broadcast_to(most, shape).copy())
    paths = timed_points(points + bends, _held(progress, np.broadcast_to(stop, shape)))
    paths = paths.reshape(shape[0], ROUTES * SHAPES, WAYPOINTS, 2)
    paths[:, :, 0], paths[:, :, -1] = condition.starts[:, None], condition.goals[:, None]
    room = condition.radius + CLEAR
    step = np.linalg.norm(np.diff(paths, axis=2), axis=-1).max(-1)
    clear = np.all(clearance(condition.floor, paths) >= room, axis=-1)
    clear &= np.all(within(condition.floor, paths, room), axis=-1)
    travelled = np.linalg.norm(np.diff(paths, axis=2), axis=-1).sum(-1)
    excess = travelled / np.maximum(travelled.min(1, keepdims=True), 0.1) - 1
    cost = np.minimum(2 * excess, 2.0) + rng.gumbel(scale=0.3, size=excess.shape)
    cost[:, ::SHAPES] -= 0.3  # the plain shape of a route
    return paths, cost, clear & (step <= condition.speed_limit)


def demonstrate(condition: FleetCondition, rng: np.random.Generator) -> Team:
    """Paths of a team: robots choose among candidates, and among new ones and the last choice while a conflict is left."""
    paths, cost, valid = candidates(condition, rng)
    robots, least = np.arange(len(paths)), APART * condition.radius + SPARE
    for _ in range(ATTEMPTS):
        chosen = choose(paths, cost + np.where(valid, 0.0, BLOCKED), rng)
        team = Team(paths[robots, chosen], least_distance(paths[robots, chosen]))
        kept = tuple(each[robots, chosen][:, None] for each in (paths, cost, valid))
        if team.apart >= least and kept[2].all():
            break
        drawn = candidates(condition, rng)
        paths, cost, valid = (
            np.concatenate(pair, axis=1) for pair in zip(kept, drawn, strict=True)
        )
    return team
