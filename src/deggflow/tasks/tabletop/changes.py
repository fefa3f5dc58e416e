"""How random scenes and changed affordance requirements are drawn (paper: Appendix on Task 2)."""

import math
from collections.abc import Callable, Sequence
from dataclasses import replace
from typing import TypeVar

import numpy as np

from .condition import Affordance, Balance, SceneCondition
from .library import (
    MAX_OBJECTS,
    NAMES,
    TABLE_DEPTH,
    TABLE_WIDTH,
    numbered,
    object_type,
)

OFFSET_RANGE = (0.98, 1.12)
RADIUS_RANGE = (1.04, 1.24)
DIRECTION_JITTER = math.pi / 22.5  # rad
LARGE_WINDOW = 8  # objects of a large scene per area of the paper's table

T = TypeVar("T")
Change = Callable[[np.random.Generator, str], Affordance]
_TYPES = np.array(NAMES)


def _angle(value: float) -> float:
    return abs(math.remainder(value, 2 * math.pi))


def _opposite(name: str) -> float:
    """The allowed direction farthest from the default one; the first listed if there are several."""
    return max(object_type(name).directions, key=_angle)


def _direction(rng: np.random.Generator, choices: tuple[float, ...]) -> float:
    return _one_of(rng, choices) + rng.uniform(-DIRECTION_JITTER, DIRECTION_JITTER)


def _one_of(rng: np.random.Generator, choices: Sequence[T]) -> T:
    """What `rng.choice` draws, without an array of the choices."""
    return choices[int(rng.integers(len(choices)))]


def _default(rng: np.random.Generator, name: str) -> Affordance:
    return Affordance()


def _opposite_side(rng: np.random.Generator, name: str) -> Affordance:
    return Affordance(direction=_direction(rng, (_opposite(name),)))


def _side_direction(rng: np.random.Generator, name: str) -> Affordance:
    others = tuple(d for d in object_type(name).directions if d != _opposite(name))
    return Affordance(direction=_direction(rng, others))


def _larger(rng: np.random.Generator, name: str) -> Affordance:
    return Affordance(radius_scale=rng.uniform(*RADIUS_RANGE))


def _combined(rng: np.random.Generator, name: str) -> Affordance:
    return Affordance(
        rng.uniform(*OFFSET_RANGE),
        rng.uniform(*RADIUS_RANGE),
        _direction(rng, object_type(name).directions),
    )


FAMILIES: dict[str, Change] = {
    "default": _default,
    "opposite": _opposite_side,
    "side": _side_direction,
    "larger": _larger,
    "combined": _combined,
}
CHANGED = tuple(family for family in FAMILIES if family != "default")
BALANCED = (
    Balance()
)  # of the family "balanced": as "changed", and the centre of mass near the table's


def change(condition: SceneCondition, family: str, rng: np.random.Generator) -> SceneCondition:
    """The same objects with every object's requirement drawn from a family.

    Args:
        condition: Objects and table.
        family: A key of `FAMILIES`; or "changed", where each object draws its family from the four changes; or
            "balanced", which adds a requirement on the centre of mass that all objects share.
        rng: Source of randomness.
    """
    if family == "default":
        return condition.with_requirements({})
    if family == "balanced":
        condition, family = replace(condition, balance=BALANCED), "changed"
    requirements = {}
    for name in condition.objects:
        kind = _one_of(rng, CHANGED) if family == "changed" else family
        requirements[name] = FAMILIES[kind](rng, name)
    return condition.with_requirements(requirements)


def random_objects(rng: np.random.Generator, size: int) -> tuple[str, ...]:
    """Object types, uniformly without replacement; for a large scene, in groups of eight, each drawn without replacement."""
    if size <= MAX_OBJECTS:
        return tuple(str(name) for name in rng.choice(_TYPES, size, replace=False))
    groups = (
        rng.choice(_TYPES, LARGE_WINDOW, replace=False) for _ in range(-(-size // LARGE_WINDOW))
    )
    return numbered([str(name) for part in groups for name in part][:size])


def random_table(size: int) -> tuple[float, float]:
    """Width and depth in m of a table for a number of objects: the paper's, or a proportionally larger one for a large scene.

    Up to `MAX_OBJECTS` objects share the paper's table; a large scene has a table's area for every eight, and is about square.
    """
    if size <= MAX_OBJECTS:
        return TABLE_WIDTH, TABLE_DEPTH
    tables = size / LARGE_WINDOW
    columns = max(1, round(math.sqrt(tables * TABLE_DEPTH / TABLE_WIDTH)))
    return round(columns * TABLE_WIDTH, 6), round(tables / columns * TABLE_DEPTH, 6)


def random_conditions(
    size: int, count: int, family: str, seed: int, first: int = 0
) -> list[SceneCondition]:
    """Conditions number `first` to `first + count - 1` of a seed; each depends on its own number alone."""
    out = []
    for number in range(first, first + count):
        rng = np.random.default_rng([seed, size, number])
        width, depth = random_table(size)
        condition = SceneCondition(random_objects(rng, size), width=width, depth=depth)
        out.append(change(condition, family, rng))
    return out
