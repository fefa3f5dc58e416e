"""Compares the statements of a scene's line with its poses and with each other."""

import math
from collections.abc import Iterator, Mapping
from typing import Any

import numpy as np

from deggflow import consistency
from deggflow.consistency import Line, Unverified, Wrong

from .condition import SceneCondition
from .formats import parse_scene
from .library import object_type
from .oracle import refutes
from .recorded import recorded_violation
from .scene import Scene
from .verdict import Verdict

TOLERANCE = 1e-6  # m, tolerance for rounding of margins, and of sqrt(2 V), which is a length, too
SINGLE = 1e-5  # m, tolerance for values that a generation computed in float32
DIVERGED = "the generation diverged to numbers that are not finite"
UNVERIFIED: Unverified = {
    "condition": "except with --conditions",
    "objects[].x": "where another one leaves all that is said true",
    "objects[].y": "likewise",
    "objects[].theta": "likewise",
    **consistency.RESULT,
}


def holds(scene: Scene, verdict: Verdict) -> bool:
    """Whether the scene satisfies its requirements, by exact geometry and by Shapely."""
    return verdict.satisfied and not refutes(scene.condition, scene.poses)


def contradictions(line: Line) -> list[Wrong]:
    """All contradictions in a line that `parse_scene` accepts.

    Args:
        line: A scene as it stands in a file.
    """
    scene = parse_scene(line)
    verdict = scene.verdict()
    return list(_contradictions(line["certificate"], scene, verdict))


def _contradictions(certificate: Line, scene: Scene, verdict: Verdict) -> Iterator[Wrong]:
    generation = certificate.get("generation")
    yield from consistency.check_result(
        certificate, "certificate",
        holds=holds(scene, verdict), reasons=_reasons(scene, verdict, generation),
        margin=verdict.min_margin, tolerance=TOLERANCE, unit="m",
    )  # fmt: skip
    away = abs(_length(certificate["violation"]) - _length(verdict.violation))
    if not away <= TOLERANCE or certificate["violation"] < 0:
        yield Wrong("certificate.violation", f"is not V of the scene, {verdict.violation:.6g} m^2")
    if generation is not None:
        names = ["affordance", *(["balance"] if scene.condition.balance is not None else [])]
        field = "certificate.generation"
        yield from consistency.check_generation(generation, field, names, scene.condition.objects)
        if certificate["reason"] != DIVERGED:
            yield from _values(generation, field, scene)


def _reasons(scene: Scene, verdict: Verdict, generation: Line | None) -> list[str]:
    """Possible reasons: the finding of exact geometry, and the first failure along the generation."""
    found = verdict.reason(scene.condition.objects) or "Shapely finds a requirement missed"
    reason = consistency.found_reason(found, generation)
    beyond = [scene.condition.width, scene.condition.depth, 0.0]
    return [reason, *([DIVERGED] if (scene.poses == beyond).all() else [])]


def _values(generation: Line, field: str, scene: Scene) -> Iterator[Wrong]:
    """The values at z(1) against those of the poses."""
    for k, row in enumerate(generation["requirements"]):
        place, value = f"{field}.requirements[{k}].value", row["value"]
        if row["name"] == "affordance":
            violation = recorded_violation(scene.condition, scene.poses)
            exact = _length(violation)
            if not abs(_length(value) - exact) <= SINGLE * (1 + exact) or value < 0:
                yield Wrong(place, f"is not V of the scene, {violation:.6g} m^2")
        if row["name"] == "balance" and scene.condition.balance is not None:
            circle, away = scene.condition.balance, _off_balance(scene)
            if not abs(circle.radius * math.sqrt(max(2 * value + 1, 0.0)) - away) <= SINGLE * (
                1 + away
            ):
                exact = ((away / circle.radius) ** 2 - 1) / 2
                yield Wrong(place, f"is not q of the scene, {exact:.6g}")


def _length(violation: int | float) -> float:
    """The norm in m of all shortfalls from the buffers; V is half its square."""
    return math.sqrt(2 * max(violation, 0.0))


def _off_balance(scene: Scene) -> float:
    """Distance of the centre of mass from the centre of its circle, m."""
    circle = scene.condition.balance
    assert circle is not None
    mass = np.array([object_type(name).mass for name in scene.condition.objects])
    x, y = np.average(scene.poses[:, :2], axis=0, weights=mass)
    return math.hypot(x - circle.x, y - circle.y)


def plain(condition: SceneCondition) -> Mapping[str, Any]:
    """The condition with every default written out."""
    needs = {name: vars(condition.affordance(name)) for name in condition.objects}
    circle = None if condition.balance is None else vars(condition.balance)
    return {
        "objects": list(condition.objects),
        "requirements": needs,
        "table": {"width": condition.width, "depth": condition.depth},
        "balance": circle,
    }
