"""The library is the paper's table."""

import math

import numpy as np

from deggflow.tasks.tabletop.library import (
    LIBRARY,
    MAX_OBJECTS,
    NAMES,
    TABLE_DEPTH,
    TABLE_WIDTH,
    is_object_name,
    numbered,
    object_type,
    type_name,
)


def test_names(paper):
    assert tuple(paper) == NAMES
    assert MAX_OBJECTS == 12
    assert {name: object_type(name).name for name in NAMES} == {name: name for name in paper}


def test_objects_of_one_type_are_told_apart_by_number():
    names = numbered(["teacup", "laptop", "teacup", "teacup"])
    assert names == ("teacup", "laptop", "teacup#2", "teacup#3")
    assert [type_name(name) for name in names] == ["teacup", "laptop", "teacup", "teacup"]
    assert object_type("teacup#3") is object_type("teacup")
    assert all(map(is_object_name, names))


def test_other_names_are_none():
    for name in (
        "cup",
        "teacup#",
        "teacup#1",
        "teacup#02",
        "teacup#x",
        "#2",
        "teacup#2#3",
        "teacup#²",
    ):
        assert not is_object_name(name)


def test_table():
    assert (TABLE_WIDTH, TABLE_DEPTH) == (1.40, 0.94)


def test_primitives(paper):
    for kind in LIBRARY:
        got = [(p.half_x, p.half_y, p.corner, p.x, p.y) for p in kind.primitives]
        assert got == paper[kind.name][0]


def test_masses(masses):
    assert {kind.name: kind.mass for kind in LIBRARY} == masses


def test_a_corner_fits_into_its_primitive():
    for kind in LIBRARY:
        for primitive in kind.primitives:
            assert 0 < primitive.corner <= min(primitive.half_x, primitive.half_y)


def test_regions(paper):
    for kind in LIBRARY:
        assert [(r.x, r.y, r.radius) for r in kind.regions] == paper[kind.name][1]


def test_directions(paper):
    for kind in LIBRARY:
        assert sorted(kind.directions) == sorted(paper[kind.name][2])


def test_no_alternative_is_the_default_direction():
    for kind in LIBRARY:
        turns = np.array(kind.directions) / (2 * math.pi)
        assert np.all(np.abs(turns - np.round(turns)) > 0.05)
