"""Fleet conditions and plans as JSON Lines: parsing and validation."""

from typing import Any

import numpy as np
from jaxtyping import Float

from deggflow.jsonl import (
    InputError,
    expect_choice,
    expect_integer,
    expect_list,
    expect_number,
    expect_object,
    join,
    quoted,
)
from deggflow.records import parse_certificate
from deggflow.requirements import polygon

from .condition import MAX_ROBOTS, MIN_ROBOTS, SPEED_LIMIT, FleetCondition, Robot
from .maps import BOUNDS, NAMED, RADIUS, FloorMap
from .paths import WAYPOINTS
from .plan import Plan

MAX_COORDINATE = 100.0  # map units, of maps
MAX_OBSTACLES = 1_000  # of each kind
MAX_CORNERS = 256  # of a polygon
MIN_LENGTH = 1e-4  # map units
MAX_SEED = 2**31 - 1  # JAX's keys are made from 32-bit integers
_ANYWHERE = 1e6  # map units; a nominal path may end far out


def _numbers(value: Any, field: str, names: str, low: float = -MAX_COORDINATE) -> tuple[float, ...]:
    """A list of as many numbers as there are names."""
    count = len(names.split(", "))
    if not isinstance(value, list) or len(value) != count:
        raise InputError(f"must be [{names}]; got {quoted(value)}", field=field)
    return tuple(
        expect_number(item, f"{field}[{k}]", low, MAX_COORDINATE, "map units")
        for k, item in enumerate(value)
    )


def _point(value: Any, field: str) -> tuple[float, float]:
    x, y = _numbers(value, field, "x, y")
    return x, y


def _rows(value: Any, field: str) -> list[tuple[Any, str]]:
    rows = expect_list(value, field)
    if len(rows) > MAX_OBSTACLES:
        raise InputError(f"must hold at most {MAX_OBSTACLES}; got {len(rows)}", field=field)
    return [(item, f"{field}[{k}]") for k, item in enumerate(rows)]


def _box(value: Any, field: str) -> tuple[float, float, float, float]:
    x, y, w, h = _numbers(value, field, "centre x, centre y, width, height")
    for k, length in ((2, w), (3, h)):
        expect_number(length, f"{field}[{k}]", MIN_LENGTH, MAX_COORDINATE, "map units")
    return x, y, w, h


def _disc(value: Any, field: str) -> tuple[float, float, float]:
    x, y, radius = _numbers(value, field, "centre x, centre y, radius")
    expect_number(radius, f"{field}[2]", MIN_LENGTH, MAX_COORDINATE, "map units")
    return x, y, radius


def _polygon(value: Any, field: str) -> tuple[tuple[float, float], ...]:
    corners = expect_list(value, field)
    if not 3 <= len(corners) <= MAX_CORNERS:
        raise InputError(f"must have 3 to {MAX_CORNERS} corners; got {len(corners)}", field=field)
    ring = tuple(_point(corner, f"{field}[{k}]") for k, corner in enumerate(corners))
    try:
        polygon.triangles(polygon.counter_clockwise(np.array(ring)))
    except ValueError:
        text = "must be a simple polygon that encloses an area, whose edges neither cross nor touch"
        raise InputError(text, field=field) from None
    return ring


def parse_map(value: Any, field: str) -> str | FloorMap:
    """A map from its name or its JSON object; raises `InputError` with the field."""
    if isinstance(value, str):
        return expect_choice(value, field, tuple(NAMED))
    entries = expect_object(value, field, ("bounds", "boxes", "discs", "polygons"))
    place = join(field, "bounds")
    x0, y0, x1, y1 = _numbers(entries.get("bounds", list(BOUNDS)), place, "x0, y0, x1, y1")
    if not (x0 < x1 and y0 < y1):
        raise InputError("must be [x0, y0, x1, y1] with x0 < x1 and y0 < y1", field=place)
    boxes, discs, polygons = (
        _rows(entries.get(name, []), join(field, name)) for name in ("boxes", "discs", "polygons")
    )
    return FloorMap(
        (x0, y0, x1, y1),
        tuple(_box(*each) for each in boxes),
        tuple(_disc(*each) for each in discs),
        tuple(_polygon(*each) for each in polygons),
    )


def _robot(value: Any, field: str) -> Robot:
    entries = expect_object(value, field, ("start", "goal"), ("start", "goal"))
    return Robot(*(_point(entries[key], join(field, key)) for key in ("start", "goal")))


def parse_condition(value: Any, field: str = "") -> FleetCondition:
    """A condition from its JSON object; raises `InputError` with the field."""
    keys = ("map", "robots", "radius", "speed_limit")
    entries = expect_object(value, field, keys, keys[:2])
    floor = parse_map(entries["map"], join(field, "map"))
    place = join(field, "robots")
    robots = expect_list(entries["robots"], place)
    if not MIN_ROBOTS <= len(robots) <= MAX_ROBOTS:
        text = f"must list {MIN_ROBOTS} to {MAX_ROBOTS} robots; got {len(robots)}"
        raise InputError(text, field=place)
    radius, limit = (
        expect_number(
            entries.get(key, default), join(field, key), MIN_LENGTH, MAX_COORDINATE, "map units"
        )
        for key, default in (("radius", RADIUS), ("speed_limit", SPEED_LIMIT))
    )
    listed = tuple(_robot(item, f"{place}[{k}]") for k, item in enumerate(robots))
    return FleetCondition(floor, listed, radius, limit, entries)


def parse_paths(value: Any, field: str, robots: int) -> Float[np.ndarray, "robots 64 2"]:
    """Paths of all robots; raises `InputError` with the field."""
    if not isinstance(value, list) or len(value) != robots:
        raise InputError("must list the condition's robots, one path each", field=field)
    out = np.zeros((robots, WAYPOINTS, 2))
    for k, path in enumerate(value):
        place = f"{field}[{k}]"
        if not isinstance(path, list) or len(path) != WAYPOINTS:
            raise InputError(f"must be {WAYPOINTS} waypoints [x, y]", field=place)
        for t, point in enumerate(path):
            where = f"{place}[{t}]"
            if not isinstance(point, list) or len(point) != 2:
                raise InputError(f"must be [x, y]; got {quoted(point)}", field=where)
            out[k, t] = [
                expect_number(number, f"{where}[{j}]", -_ANYWHERE, _ANYWHERE, "map units")
                for j, number in enumerate(point)
            ]
    return out


def parse_plan(value: Any) -> Plan:
    """A plan from its JSON object; raises `InputError` with the field."""
    keys = ("condition", "paths", "certificate", "seed")
    entries = expect_object(value, "", keys, keys)
    condition = parse_condition(entries["condition"], "condition")
    paths = parse_paths(entries["paths"], "paths", len(condition.robots))
    certificate = parse_certificate(entries["certificate"], "certificate")
    return Plan(condition, paths, certificate, expect_integer(entries["seed"], "seed", 0, MAX_SEED))
