"""What a scene's line says against what its poses show, and a line's condition against what was asked for."""

import copy

import jax
import jax.numpy as jnp
import numpy as np
import pytest

from deggflow.tasks.tabletop.condition import Affordance, Balance, SceneCondition, take, to_arrays
from deggflow.tasks.tabletop.consistency import contradictions
from deggflow.tasks.tabletop.formats import parse_scene
from deggflow.tasks.tabletop.library import object_type
from deggflow.tasks.tabletop.margins import TABLETOP
from deggflow.tasks.tabletop.task import TabletopTask
from deggflow.tasks.tabletop.verdict import BUFFER, judge

OBJECTS = ("laptop", "pen_cup", "teacup")
POSES = np.array([[-0.25, 0.1, 0.0], [0.35, 0.15, 0.3], [0.1, -0.25, 1.0]])
CIRCLE = {"x": -0.1, "y": 0.05, "radius": 0.3}


def record(violation, balance=None):
    """Of a generation that ends where it was above its limits most, if it was."""
    rows = [("affordance", float(np.float32(violation)), 2e-4)]
    rows += [] if balance is None else [("balance", float(np.float32(balance)), 0.0)]
    shown = [
        {"name": name, "value": value, "limit": limit, "excess": max(value - limit, 0.0)}
        for name, value, limit in rows
    ]
    above = shown[0]["excess"] > 0
    told = f"affordance was above its limit by {shown[0]['excess']:.3g}"
    return {
        "hypotheses_hold": not above,
        "first_failure": told if above else None,
        "requirements": [{**row, "active_points": 3, "smallest_ell_norm": 0.1} for row in shown],
        "steps": 100,
        "refused_steps": 0,
        "forced_steps": 0,
        "least_opposed_sine": None,
        "largest_input_norm": 2.0,
        "largest_step": 2.0,
    }


def scene(poses=POSES, balance=None, made=True):
    """An honest line; the value of the balance by its definition."""
    condition = {"objects": list(OBJECTS), **({} if balance is None else {"balance": balance})}
    circle = None if balance is None else Balance(**balance)
    wanted = SceneCondition(OBJECTS, balance=circle)
    verdict = judge([wanted], [poses])[0]
    line = {
        "condition": condition,
        "objects": [
            {"name": name, **dict(zip(("x", "y", "theta"), pose, strict=True))}
            for name, pose in zip(OBJECTS, poses.tolist(), strict=True)
        ],
        "certificate": {
            "satisfied": verdict.satisfied,
            "min_margin": verdict.min_margin,
            "violation": verdict.violation,
            "draws": 1,
            "reason": verdict.reason(OBJECTS),
        },
        "seed": 0,
    }
    if made:
        q = None
        if circle is not None:
            mass = np.array([object_type(name).mass for name in OBJECTS])
            away = mass @ poses[:, :2] / mass.sum() - [circle.x, circle.y]
            q = (away @ away / circle.radius**2 - 1) / 2
        line["certificate"]["generation"] = record(guidance_violation(poses), q)
        failure = line["certificate"]["generation"]["first_failure"]
        if failure is not None:
            line["certificate"]["reason"] += f"; on the way {failure}"
    return line


def guidance_violation(poses):
    """V as a generation records it."""
    arrays = take(to_arrays([SceneCondition(OBJECTS)]), 0)
    z = np.zeros((len(arrays.mask), 3), np.float32)
    z[: len(poses)] = poses / [0.70, 0.47, 1.35]
    return float(
        jnp.sum(TABLETOP.violation(jnp.asarray(z), jax.tree.map(jnp.asarray, arrays), BUFFER))
    )


def said(line):
    parse_scene(line)
    return [wrong.field for wrong in contradictions(line)]


def edited(line, path, new):
    out = copy.deepcopy(line)
    *way, last = path
    place = out
    for key in way:
        place = place[key]
    place[last] = new
    return out


APART = POSES + np.array([0.0, 0.0, 0.1])
TOUCHING = np.array([[-0.25, 0.1, 0.0], [-0.15, 0.15, 0.3], [0.1, -0.25, 1.0]])


@pytest.mark.parametrize("poses", [POSES, APART, TOUCHING])
@pytest.mark.parametrize("balance", [None, CIRCLE])
@pytest.mark.parametrize("made", [True, False])
def test_nothing_is_wrong_with_an_honest_line(poses, balance, made):
    line = scene(poses, balance, made)
    assert said(line) == []
    assert line["certificate"]["satisfied"] == (poses is not TOUCHING)


CERTIFICATE, FIRST = ("certificate",), ("certificate", "generation", "requirements", 0)
SECOND = ("certificate", "generation", "requirements", 1)
WRONG = {
    "satisfied with a reason": (POSES, (*CERTIFICATE, "reason"), "because", ["certificate.reason"]),
    "not satisfied, without one": (
        POSES,
        (*CERTIFICATE, "satisfied"),
        False,
        ["certificate.satisfied", "certificate.reason"],
    ),
    "another reason": (TOUCHING, (*CERTIFICATE, "reason"), "because", ["certificate.reason"]),
    "a violation": (POSES, (*CERTIFICATE, "violation"), 5.0, ["certificate.violation"]),
    "a violation below zero": (POSES, (*CERTIFICATE, "violation"), -1e-9, ["certificate.violation"]),
    "a margin": (POSES, (*CERTIFICATE, "min_margin"), 0.5, ["certificate.min_margin"]),
    "V of the record": (
        TOUCHING,
        (*FIRST, "value"),
        1e-4,
        ["certificate.generation.requirements[0].value"],
    ),
    "q of the record": (
        POSES,
        (*SECOND, "value"),
        -0.4,
        ["certificate.generation.requirements[1].value"],
    ),
    "a record of less": (
        POSES,
        ("certificate", "generation", "requirements"),
        record(0.0)["requirements"],
        ["certificate.generation.requirements"],
    ),
}  # fmt: skip


@pytest.mark.parametrize("what", WRONG)
def test_a_contradiction_is_told_with_its_field(what):
    poses, path, new, expected = WRONG[what]
    assert said(edited(scene(poses, CIRCLE), path, new)) == expected


def test_a_diverged_draw_lies_beyond_the_table():
    """It says so; of another scene that is not so."""
    beyond = np.tile([1.4, 0.9, 0.0], (3, 1))
    line = scene(beyond, made=False)
    table = {"width": 1.4, "depth": 0.9}
    line["condition"]["table"] = table
    verdict = parse_scene(line).verdict()
    line["certificate"]["min_margin"] = verdict.min_margin
    line["certificate"]["violation"] = verdict.violation
    line["certificate"]["reason"] = "the generation diverged to numbers that are not finite"
    assert said(line) == []
    other = scene(TOUCHING, made=False)
    assert said(edited(other, (*CERTIFICATE, "reason"), line["certificate"]["reason"])) == [
        "certificate.reason"
    ]


def test_another_condition_than_was_asked_for_is_told():
    given = SceneCondition(OBJECTS, {"laptop": Affordance(direction=1.0)})
    assert TabletopTask.formats.difference(given, given) is None
    explicit = {**given.requirements, "teacup": Affordance()}
    assert (
        TabletopTask.formats.difference(given.with_requirements(explicit), given) is None
    )  # defaults written out
    for asked, field in (
        (SceneCondition(OBJECTS[:2], given.requirements), "objects"),
        (SceneCondition(OBJECTS), "requirements.laptop.direction"),
        (SceneCondition(OBJECTS, given.requirements, width=1.0), "table.width"),
        (SceneCondition(OBJECTS, given.requirements, balance=Balance()), "balance"),
    ):
        assert TabletopTask.formats.difference(asked, given).field == f"condition.{field}"
