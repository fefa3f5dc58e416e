"""Compares the statements of a plan's line with its paths and with each other."""

from collections.abc import Iterator, Mapping
from typing import Any

from deggflow import consistency
from deggflow.consistency import Line, Unverified, Wrong

from .condition import FleetCondition
from .formats import parse_plan
from .oracle import refutes
from .plan import Plan, robot_names
from .verdict import Verdict

TOLERANCE = 1e-9  # map units, of margins; relative, of the violation
DIVERGED = "the generation diverged to numbers that are not finite"
ROW = "apart + inside + speed"  # with which the name of the guidance's requirement begins
UNVERIFIED: Unverified = {
    "condition": "except with --conditions",
    "paths": "where other ones leave all that is said true",
    **consistency.RESULT,
    "certificate.generation.requirements[].value": "",
}


def holds(plan: Plan, verdict: Verdict) -> bool:
    """Whether the plan satisfies its requirements, in closed form and by the oracle."""
    return verdict.satisfied and not refutes(plan.condition, plan.paths)


def contradictions(line: Line) -> list[Wrong]:
    """All contradictions in a line that `parse_plan` accepts.

    Args:
        line: A plan as it stands in a file.
    """
    plan = parse_plan(line)
    return list(_contradictions(line["certificate"], plan, plan.verdict()))


def _contradictions(certificate: Line, plan: Plan, verdict: Verdict) -> Iterator[Wrong]:
    generation = certificate.get("generation")
    found = verdict.reason() or "the oracle finds a requirement missed"
    yield from consistency.check_result(
        certificate, "certificate",
        holds=None if certificate["reason"] == DIVERGED else holds(plan, verdict),
        reasons=[consistency.found_reason(found, generation)],
        margin=verdict.min_margin, tolerance=TOLERANCE, unit="map units",
    )  # fmt: skip
    away = abs(certificate["violation"] - verdict.violation)
    if not away <= TOLERANCE * (1 + verdict.violation) or certificate["violation"] < 0:
        text = f"is not the violation of the paths, {verdict.violation:.6g}"
        yield Wrong("certificate.violation", text)
    if generation is not None:
        yield from _generation(generation, plan)


def _generation(generation: Line, plan: Plan) -> Iterator[Wrong]:
    floor, field = plan.condition.floor, "certificate.generation"
    name = ROW
    if floor.boxes or floor.discs:
        name += " + outside"
    if floor.polygons:
        name += " + outside polygons"
    given = [row["name"] for row in generation["requirements"]]
    # Plans that were generated together share a program, and its requirement is named for all of their obstacles.
    names = given if len(given) == 1 and _is_name(given[0], name) else [name]
    robots = robot_names(len(plan.condition.robots))
    yield from consistency.check_generation(generation, field, names, robots)


def _is_name(given: str, least: str) -> bool:
    parts = [ROW, "outside", "outside polygons"]
    whole = " + ".join(parts)
    return given in (least, whole, " + ".join(parts[:2]), " + ".join(parts[::2])) and all(
        part in given.split(" + ") for part in least.split(" + ")
    )


def plain(condition: FleetCondition) -> Mapping[str, Any]:
    """The condition with every default written out."""
    floor = condition.floor
    return {
        "map": {name: list(getattr(floor, name)) for name in vars(floor)},
        "robots": [vars(robot) for robot in condition.robots],
        "radius": condition.radius,
        "speed_limit": condition.speed_limit,
    }
