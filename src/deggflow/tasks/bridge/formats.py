"""Bridge conditions and trials as JSON Lines: parsing and validation."""

import math
from typing import Any

import numpy as np
from jaxtyping import Float

from deggflow.divergence import END_OF_SCALE
from deggflow.files import StrPath
from deggflow.jsonl import (
    InputError,
    expect_flag,
    expect_integer,
    expect_number,
    expect_object,
    expect_reason,
    join,
    quoted,
    read_lines,
)
from deggflow.records import parse_generation
from deggflow.tables import read_results

from .condition import TrialCondition
from .lines import LINES
from .trial import MAX_SPEED, PolicyRecord, Trial, TrialCertificate
from .world import (
    CONTACT_SIDE,
    DT,
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
MAX_ACTIONS = 10_000
MAX_SEED = 2**31 - 1  # JAX's keys are made from 32-bit integers
MAX_DRAWS = 10_000  # as `generate` allows
_ANYWHERE = 1e6  # m and rad; a nominal trial may end far out
_ANY = END_OF_SCALE  # of values of factors and margins
_EDGE = 1e-6  # m, tolerance for contacts, whose coordinates are rounded decimals


def _pose(value: Any, field: str) -> tuple[float, float, float]:
    keys = ("x", "y", "theta")
    entries = expect_object(value, field, keys, keys)
    return (
        expect_number(entries["x"], join(field, "x"), X_MIN, X_MAX, "m"),
        expect_number(entries["y"], join(field, "y"), Y_MIN, Y_MAX, "m"),
        expect_number(entries["theta"], join(field, "theta"), -MAX_ANGLE, MAX_ANGLE, "rad"),
    )


def _contact(value: Any, field: str) -> tuple[float, float]:
    if not isinstance(value, list) or len(value) != 2:
        raise InputError(f"must be [r_x, r_y]; got {quoted(value)}", field=field)
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
            f"must list the contact points of {MIN_ROBOTS} to {MAX_ROBOTS} robots; got {quoted(value)}",
            field=field,
        )
    points = tuple(_contact(item, f"{field}[{k}]") for k, item in enumerate(value))
    for k, (x, y) in enumerate(points):
        for j in range(k):
            if y * points[j][1] > 0 and abs(x - points[j][0]) < 2 * ROBOT_RADIUS - _EDGE:
                raise InputError(
                    f"robots {j + 1} and {k + 1} overlap: their contact points are "
                    f"{abs(x - points[j][0]):g} m apart, less than {2 * ROBOT_RADIUS:g} m",
                    field=f"{field}[{k}]",
                )
    return points


def parse_condition(value: Any, field: str = "") -> TrialCondition:
    """A condition from its JSON object; raises `InputError` with the field."""
    keys = ("plank", "goal", "contacts")
    entries = expect_object(value, field, keys, keys)
    return TrialCondition(
        _pose(entries["plank"], join(field, "plank")),
        _pose(entries["goal"], join(field, "goal")),
        _contacts(entries["contacts"], join(field, "contacts")),
        entries,
    )


def _triples(value: Any, field: str, names: str, limit: float) -> Float[np.ndarray, "rows 3"]:
    if not isinstance(value, list) or len(value) > MAX_ACTIONS:
        raise InputError(f"must be a list of {names}, at most {MAX_ACTIONS}", field=field)
    rows = []
    for k, item in enumerate(value):
        if not isinstance(item, list) or len(item) != 3:
            raise InputError(f"must be {names}; got {quoted(item)}", field=f"{field}[{k}]")
        rows.append(
            [expect_number(v, f"{field}[{k}][{j}]", -limit, limit, "") for j, v in enumerate(item)]
        )
    return np.array(rows, np.float64).reshape(-1, 3)


def parse_twists(value: Any, field: str) -> Float[np.ndarray, "actions 3"]:
    """A list of body twists [v_x, v_y, omega]; raises `InputError` with the field."""
    return _triples(value, field, "[v_x, v_y, omega]", MAX_SPEED)


def read_conditions(path: StrPath) -> list[TrialCondition]:
    """All conditions of a file, or `InputError` for the first that is wrong."""
    return read_lines(path, parse_condition, "bridge condition")


def _poses(
    value: Any, start: tuple[float, float, float], actions: int
) -> Float[np.ndarray, "poses 3"]:
    poses = _triples(value, "poses", "[x, y, theta]", _ANYWHERE)
    if len(poses) != actions + 1:
        raise InputError(
            f"must hold one pose more than there are twists, {actions + 1}; got {len(poses)}",
            field="poses",
        )
    if np.abs(poses[0] - start).max() > _EDGE:
        raise InputError("must be the condition's plank pose", field="poses[0]")
    return poses


def _policy(value: Any, field: str) -> PolicyRecord:
    keys = ("q_task", "bound", "q_safe", "draws", "accepted")
    entries = expect_object(value, field, (*keys, "speed", "generation"), keys)
    q_task, bound, q_safe = (
        expect_number(entries[key], join(field, key), -_ANY, _ANY, "") for key in keys[:3]
    )
    generation = entries.get("generation")
    return PolicyRecord(
        q_task,
        bound,
        q_safe,
        expect_integer(entries["draws"], join(field, "draws"), 1, MAX_DRAWS),
        expect_flag(entries["accepted"], join(field, "accepted")),
        expect_number(entries.get("speed", 0.0), join(field, "speed"), 0.0, _ANY, "m/s"),
        None if generation is None else parse_generation(generation, join(field, "generation")),
    )


def _certificate(value: Any, field: str) -> TrialCertificate:
    keys = ("satisfied", "min_margin", "violation", "draws", "reason", "policies")
    entries = expect_object(value, field, (*keys, "speed_limit"), keys)
    policies, limit = entries["policies"], entries.get("speed_limit")
    if not isinstance(policies, list) or len(policies) > MAX_ACTIONS:
        raise InputError(
            f"must be a list of at most {MAX_ACTIONS} policies", field=join(field, "policies")
        )
    return TrialCertificate(
        expect_flag(entries["satisfied"], join(field, "satisfied")),
        expect_number(entries["min_margin"], join(field, "min_margin"), -_ANY, _ANY, "m"),
        expect_number(entries["violation"], join(field, "violation"), 0.0, _ANY, ""),
        expect_integer(entries["draws"], join(field, "draws"), 1, MAX_DRAWS),
        expect_reason(entries["reason"], join(field, "reason")),
        tuple(_policy(item, f"{field}.policies[{k}]") for k, item in enumerate(policies)),
        None
        if limit is None
        else expect_number(limit, join(field, "speed_limit"), 0.0, _ANY, "m/s"),
    )


def parse_trial(value: Any) -> Trial:
    """A trial from its JSON object; raises `InputError` with the field."""
    keys = ("condition", "dt", "twists", "poses", "outcome", "certificate", "seed")
    entries = expect_object(value, "", keys, keys)
    condition = parse_condition(entries["condition"], "condition")
    if entries["dt"] != DT:
        raise InputError(
            f"must be {DT}, the seconds of an action; got {quoted(entries['dt'])}", field="dt"
        )
    twists = parse_twists(entries["twists"], "twists")
    poses = _poses(entries["poses"], condition.plank, len(twists))
    outcome = expect_object(
        entries["outcome"], "outcome", ("success", "reason"), ("success", "reason")
    )
    success = expect_flag(outcome["success"], "outcome.success")
    reason = expect_reason(outcome["reason"], "outcome.reason")
    if success != (reason is None) or reason == "":
        requirement = "be null, as the trial succeeded" if success else "say why the trial failed"
        raise InputError(f"must {requirement}", field="outcome.reason")
    certificate = _certificate(entries["certificate"], "certificate")
    seed = expect_integer(entries["seed"], "seed", 0, MAX_SEED)
    return Trial(condition, twists, poses, success, reason, certificate, seed)


def read_trials(path: StrPath) -> list[Trial]:
    """All trials of a JSON Lines file or a table, or `InputError` for the first that is wrong."""
    return read_results(path, parse_trial, "bridge trial", LINES)
