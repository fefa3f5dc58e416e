"""Tabletop conditions and scenes as JSON Lines: parsing and validation."""

import math
from typing import Any

import numpy as np
from jaxtyping import Float

from deggflow.files import StrPath
from deggflow.jsonl import (
    InputError,
    expect_integer,
    expect_number,
    expect_object,
    join,
    quoted,
    read_lines,
    shorten,
)
from deggflow.records import parse_certificate
from deggflow.tables import read_results

from .condition import Affordance, Balance, SceneCondition
from .library import (
    MAX_LARGE,
    NAMES,
    TABLE_DEPTH,
    TABLE_WIDTH,
    is_object_name,
    type_name,
)
from .lines import LINES
from .scene import Scene

MIN_SCALE, MAX_SCALE = 0.01, 10.0
MIN_TABLE, MAX_TABLE = 0.01, 100.0  # m
MIN_RADIUS = 1e-3  # m, of the circle for the centre of mass
MAX_SEED = 2**31 - 1  # JAX's keys are made from 32-bit integers
MAX_ANGLE = 2 * math.pi + 1e-9  # rad


def _name(value: Any, field: str) -> str:
    if not isinstance(value, str):
        raise InputError(f"must be the name of an object; got {quoted(value)}", field=field)
    if not is_object_name(value):
        raise InputError(
            f"unknown object {shorten(value)!r}; known are {', '.join(NAMES)}, and further ones of a type as "
            "laptop#2, laptop#3, ...",
            field=field,
        )
    return value


def _objects(value: Any, field: str) -> tuple[str, ...]:
    if not isinstance(value, list):
        raise InputError(f"must be a list of names; got {quoted(value)}", field=field)
    if not 1 <= len(value) <= MAX_LARGE:
        raise InputError(f"must name 1 to {MAX_LARGE} objects; got {len(value)}", field=field)
    names: dict[str, None] = {}
    for k, item in enumerate(value):
        name = _name(item, f"{field}[{k}]")
        if name in names:
            raise InputError(
                f"{name} is listed twice; a second one is called {type_name(name)}#2",
                field=f"{field}[{k}]",
            )
        names[name] = None
    return tuple(names)


def _affordance(value: Any, field: str) -> Affordance:
    keys = ("offset_scale", "radius_scale", "direction")
    entries = expect_object(value, field, keys)
    limits = dict.fromkeys(keys[:2], (MIN_SCALE, MAX_SCALE, ""))
    limits["direction"] = (-MAX_ANGLE, MAX_ANGLE, "rad")
    return Affordance(
        **{key: expect_number(entries[key], join(field, key), *limits[key]) for key in entries}
    )


def _balance(value: Any, field: str) -> Balance:
    limits = {"x": (-MAX_TABLE, MAX_TABLE), "y": (-MAX_TABLE, MAX_TABLE)}
    limits["radius"] = (MIN_RADIUS, MAX_TABLE)
    entries = expect_object(value, field, tuple(limits))
    return Balance(
        **{key: expect_number(entries[key], join(field, key), *limits[key], "m") for key in entries}
    )


def parse_condition(value: Any, field: str = "") -> SceneCondition:
    """A condition from its JSON object; raises `InputError` with the field."""
    keys = ("objects", "requirements", "table", "balance")
    entries = expect_object(value, field, keys, ("objects",))
    objects = _objects(entries["objects"], join(field, "objects"))
    place = join(field, "requirements")
    requirements: dict[str, Affordance] = {}
    wishes = entries.get("requirements", {})
    numbered = filter(is_object_name, wishes if isinstance(wishes, dict) else ())
    present = set(objects)
    for name, need in expect_object(wishes, place, (*NAMES, *numbered)).items():
        if name not in present:
            raise InputError(f"{name} is not among the objects", field=join(place, name))
        requirements[name] = _affordance(need, join(place, name))
    width, depth = TABLE_WIDTH, TABLE_DEPTH
    if "table" in entries:
        place = join(field, "table")
        table = expect_object(entries["table"], place, ("width", "depth"), ("width", "depth"))
        width, depth = (
            expect_number(table[key], join(place, key), MIN_TABLE, MAX_TABLE, "m")
            for key in ("width", "depth")
        )
    balance = None
    if "balance" in entries:
        balance = _balance(entries["balance"], join(field, "balance"))
    return SceneCondition(objects, requirements, width, depth, balance, entries)


def read_conditions(path: StrPath) -> list[SceneCondition]:
    """All conditions of a file, or `InputError` for the first that is wrong."""
    return read_lines(path, parse_condition, "tabletop condition")


def parse_scene(value: Any) -> Scene:
    """A scene from its JSON object; raises `InputError` with the field."""
    keys = ("condition", "objects", "certificate", "seed")
    entries = expect_object(value, "", keys, keys)
    condition = parse_condition(entries["condition"], "condition")
    poses = parse_poses(entries["objects"], condition)
    seed = expect_integer(entries["seed"], "seed", 0, MAX_SEED)
    certificate = parse_certificate(entries["certificate"], "certificate")
    return Scene(condition, poses, certificate, seed)


def parse_poses(objects: Any, condition: SceneCondition) -> Float[np.ndarray, "objects 3"]:
    """The poses of a scene's objects from their JSON list, x, y and theta; raises `InputError` with the field."""
    if not isinstance(objects, list) or len(objects) != len(condition.objects):
        raise InputError("must list the condition's objects, one pose each", field="objects")
    poses = []
    for k, (item, name) in enumerate(zip(objects, condition.objects, strict=True)):
        field = f"objects[{k}]"
        entry = expect_object(item, field, ("name", "x", "y", "theta"), ("name", "x", "y", "theta"))
        if entry["name"] != name:
            raise InputError(f"must be {name}, as in the condition", field=f"{field}.name")
        poses.append(
            [
                expect_number(entry[key], f"{field}.{key}", -1e6, 1e6, "")
                for key in ("x", "y", "theta")
            ]
        )
    return np.array(poses)


def read_scenes(path: StrPath) -> list[Scene]:
    """All scenes of a JSON Lines file or a table, or `InputError` for the first that is wrong."""
    return read_results(path, parse_scene, "tabletop scene", LINES)
