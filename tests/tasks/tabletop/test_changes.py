"""How conditions and changed requirements are drawn."""

import math
from collections import Counter
from dataclasses import replace

import numpy as np
import pytest

from deggflow.tasks.tabletop.changes import CHANGED, FAMILIES, change, random_conditions
from deggflow.tasks.tabletop.condition import Affordance, Balance, SceneCondition
from deggflow.tasks.tabletop.library import NAMES

JITTER = math.pi / 22.5  # rad, paper
OFFSETS, RADII = (0.98, 1.12), (1.04, 1.24)  # paper: s^o, s^r
NONE = (1.0, 1.0)


def turn(first, second=0.0):
    """Angle between two directions, in [0, pi]."""
    return abs((first - second + math.pi) % (2 * math.pi) - math.pi)


def drawn(family, count=40):
    """(object, requirement) of many draws with all twelve objects."""
    conditions = random_conditions(12, count, family, 5)
    return [(name, c.affordance(name)) for c in conditions for name in c.objects]


def near(direction, choices):
    """The allowed directions that a perturbed one can come from."""
    return [choice for choice in choices if turn(direction, choice) <= JITTER + 1e-12]


def fills(values, low, high):
    """Values lie in a range and come near both of its ends."""
    margin = 0.05 * (high - low)
    return low <= min(values) < low + margin and high - margin < max(values) <= high


def test_families_are_the_papers():
    assert tuple(FAMILIES) == ("default", "opposite", "side", "larger", "combined")
    assert CHANGED == ("opposite", "side", "larger", "combined")


def test_default_asks_for_nothing():
    for condition in random_conditions(6, 5, "default", 0):
        assert condition.requirements == {}
    changed = SceneCondition(("laptop",), {"laptop": Affordance(2.0)})
    assert change(changed, "default", np.random.default_rng(0)).requirements == {}


def test_opposite_is_the_farthest_allowed_direction(paper):
    for name, need in drawn("opposite"):
        farthest = max(turn(choice) for choice in paper[name][2])
        came_from = near(need.direction, paper[name][2])
        assert [turn(choice) for choice in came_from] == [pytest.approx(farthest)]
        assert (need.offset_scale, need.radius_scale) == NONE


def test_side_is_another_allowed_direction(paper):
    """Neither the default nor the one that "opposite" takes; every one of the rest is drawn."""
    taken = {name: near(need.direction, paper[name][2])[0] for name, need in drawn("opposite")}
    seen = {name: set() for name in paper}
    for name, need in drawn("side"):
        came_from = near(need.direction, paper[name][2])
        assert len(came_from) == 1
        assert turn(need.direction) > JITTER
        assert (need.offset_scale, need.radius_scale) == NONE
        seen[name].add(came_from[0])
    for name, choices in seen.items():
        assert choices == set(paper[name][2]) - {taken[name]}


def test_larger_scales_radii_alone():
    needs = [need for _, need in drawn("larger")]
    assert {(need.offset_scale, need.direction) for need in needs} == {(1.0, 0.0)}
    assert fills([need.radius_scale for need in needs], *RADII)


def test_combined_changes_everything(paper):
    seen = {name: set() for name in paper}
    for name, need in drawn("combined"):
        came_from = near(need.direction, paper[name][2])
        assert len(came_from) == 1
        seen[name].update(came_from)
    assert {name: len(choices) for name, choices in seen.items()} == {
        name: len(row[2]) for name, row in paper.items()
    }
    needs = [need for _, need in drawn("combined")]
    assert fills([need.offset_scale for need in needs], *OFFSETS)
    assert fills([need.radius_scale for need in needs], *RADII)


@pytest.mark.parametrize("family", ["opposite", "side", "combined"])
def test_perturbation_fills_its_range(paper, family):
    offsets = []
    for name, need in drawn(family):
        choice = near(need.direction, paper[name][2])[0]
        offsets.append(math.remainder(need.direction - choice, 2 * math.pi))
    assert fills(offsets, -JITTER - 1e-12, JITTER + 1e-12)


def test_balanced_is_changed_and_shares_a_circle():
    """The same objects under the same requirements, and one that all of them share."""
    changed, balanced = (random_conditions(6, 10, name, 2) for name in ("changed", "balanced"))
    for one, other in zip(changed, balanced, strict=True):
        assert one.balance is None
        assert other == replace(one, balance=Balance(x=0.0, y=0.0, radius=0.05))


def test_changed_draws_a_family_for_each_object(paper):
    """A quarter of the objects each, told by what is left at its default."""
    counts = Counter()
    for name, need in drawn("changed", 80):
        scaled = (need.offset_scale != 1.0, need.radius_scale != 1.0)
        if scaled == (False, False):
            came_from = near(need.direction, paper[name][2])
            assert len(came_from) == 1
            counts["direction"] += 1
        elif need.direction == 0.0:
            assert scaled == (False, True)
            counts["larger"] += 1
        else:
            assert scaled == (True, True)
            counts["combined"] += 1
    total = sum(counts.values())
    assert counts["direction"] / total == pytest.approx(0.5, abs=0.06)
    assert counts["larger"] / total == pytest.approx(0.25, abs=0.06)
    assert counts["combined"] / total == pytest.approx(0.25, abs=0.06)


@pytest.mark.parametrize("family", ["default", "changed", "combined", "balanced"])
def test_reproducible_and_independent_of_chunking(family):
    """Number k of a seed is the same whatever is drawn with it."""
    whole = random_conditions(5, 12, family, 3)
    assert random_conditions(5, 12, family, 3) == whole
    pieces = [
        c
        for first in (0, 5, 6)
        for c in random_conditions(5, {0: 5, 5: 1, 6: 6}[first], family, 3, first)
    ]
    assert pieces == whole
    assert random_conditions(5, 12, family, 4) != whole


def test_families_differ_in_requirements_alone():
    """The same seed and number give the same objects, so that families are compared on the same teams."""
    teams = {
        family: [c.objects for c in random_conditions(6, 20, family, 1)]
        for family in (*FAMILIES, "changed", "balanced")
    }
    assert all(team == teams["default"] for team in teams.values())


def test_objects_are_drawn_uniformly_without_replacement():
    conditions = random_conditions(4, 1500, "default", 0)
    assert all(len(set(c.objects)) == 4 for c in conditions)
    counts = Counter(name for c in conditions for name in c.objects)
    assert set(counts) == set(NAMES)
    # 500 expected of each, with a standard deviation of about 18.
    assert max(abs(count - 500) for count in counts.values()) < 90
    assert {
        len(c.objects) for size in (1, 12) for c in random_conditions(size, 2, "default", 0)
    } == {1, 12}
