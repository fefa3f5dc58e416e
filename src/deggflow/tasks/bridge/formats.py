"""Bridge conditions and trials as JSON Lines: what is accepted, and what is refused and why."""

import math
from pathlib import Path
from typing import Any

import numpy as np
from jaxtyping import Float

from deggflow.jsonl import InputError, expect_number, expect_object, join, read_lines, shorten

from .condition import TrialCondition
from .world import (
    CONTACT_SIDE,
    MAX_ROBOTS,
    MIN_ROBOTS,
    PLANK_LENGTH,
    ROBOT_RADIUS,
    X_MAX,
    X_MIN,
    Y_MAX,
    Y_MIN,
)

MAX_ANGLE = 2 * math.pi + 1e-9  # rad
MAX_SPEED = 100.0  # m/s and rad/s
MAX_ACTIONS = 10_000
_EDGE = 1e-6  # m by which a contact point may miss the plank's edge, as it was written in decimals


def _pose(value: Any, field: str) -> tuple[float, float, float]:
    keys = ("x", "y", "theta")
    given = expect_object(value, field, keys, keys)
    return (
        expect_number(given["x"], join(field, "x"), X_MIN, X_MAX, "m"),
        expect_number(given["y"], join(field, "y"), Y_MIN, Y_MAX, "m"),
        expect_number(given["theta"], join(field, "theta"), -MAX_ANGLE, MAX_ANGLE, "rad"),
    )


def _contact(value: Any, field: str) -> tuple[float, float]:
    if not isinstance(value, list) or len(value) != 2:
        raise InputError(f"must be [r_x, r_y]; got {shorten(value)}", field=field)
    half = PLANK_LENGTH / 2
    x = expect_number(value[0], f"{field}[0]", -half, half, "m")
    y = expect_number(value[1], f"{field}[1]", -half, half, "m")
    if abs(abs(y) - CONTACT_SIDE) > _EDGE:
        raise InputError(
            f"must be {CONTACT_SIDE} or -{CONTACT_SIDE} m, on a long edge of the plank; got {y:g}",
            field=f"{field}[1]",
        )
    return x, y


def _contacts(value: Any, field: str) -> tuple[tuple[float, float], ...]:
    if not isinstance(value, list) or not MIN_ROBOTS <= len(value) <= MAX_ROBOTS:
        raise InputError(
            f"must list the contact points of {MIN_ROBOTS} to {MAX_ROBOTS} robots; got {shorten(value)}",
            field=field,
        )
    points = tuple(_contact(item, f"{field}[{k}]") for k, item in enumerate(value))
    for k, (x, y) in enumerate(points):
        for j in range(k):
            if y * points[j][1] > 0 and abs(x - points[j][0]) < 2 * ROBOT_RADIUS:
                raise InputError(
                    f"robots {j + 1} and {k + 1} overlap: their contact points are "
                    f"{abs(x - points[j][0]):g} m apart, less than {2 * ROBOT_RADIUS:g} m",
                    field=f"{field}[{k}]",
                )
    return points


def parse_condition(value: Any, field: str = "") -> TrialCondition:
    """A condition from its JSON object; raises `InputError` with the field."""
    keys = ("plank", "goal", "contacts")
    given = expect_object(value, field, keys, keys)
    return TrialCondition(
        _pose(given["plank"], join(field, "plank")),
        _pose(given["goal"], join(field, "goal")),
        _contacts(given["contacts"], join(field, "contacts")),
        given,
    )


def parse_twists(value: Any, field: str) -> Float[np.ndarray, "actions 3"]:
    """A list of body twists [v_x, v_y, omega]; raises `InputError` with the field."""
    if not isinstance(value, list) or len(value) > MAX_ACTIONS:
        raise InputError(f"must be a list of at most {MAX_ACTIONS} twists", field=field)
    rows = []
    for k, item in enumerate(value):
        if not isinstance(item, list) or len(item) != 3:
            raise InputError("must be [v_x, v_y, omega]", field=f"{field}[{k}]")
        rows.append(
            [
                expect_number(v, f"{field}[{k}][{j}]", -MAX_SPEED, MAX_SPEED, "")
                for j, v in enumerate(item)
            ]
        )
    return np.array(rows, np.float64).reshape(-1, 3)


def read_conditions(path: Path) -> list[TrialCondition]:
    """All conditions of a file, or `InputError` for the first that is wrong."""
    return read_lines(path, parse_condition, "bridge condition")
