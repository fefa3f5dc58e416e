"""The verdict against margins from the paper's table and Minkowski differences, and on scenes made by hand."""

import math

import numpy as np
import pytest

from deggflow.tasks.tabletop.condition import Affordance, SceneCondition
from deggflow.tasks.tabletop.verdict import BUFFER, Kind, all_margins, judge

EXACT = 1e-9  # m
CUP_AND_LAMP = ("pen_cup", "desk_lamp")  # disks of 0.034 and 0.06 m
FAMILIES = ("default", "opposite", "side", "larger", "combined", "balanced")


def verdict(condition, *poses):
    return judge([condition], [np.array(poses, float)])[0]


@pytest.fixture(scope="module")
def many(random_scenes):
    """Scenes of all sizes under all families, crowded and loose, on the paper's table."""
    conditions, poses = [], []
    for size in range(1, 13):
        for k, family in enumerate(FAMILIES):
            some = random_scenes(k, 6, size, family, crowding=(0.4, 1.0)[k % 2])
            conditions, poses = conditions + some[0], poses + some[1]
    return conditions, poses


def test_least_margin_and_violation(many, reference):
    for condition, pose, found in zip(*many, judge(*many), strict=True):
        margins = reference(condition, pose)
        separation = margins["separation"]
        once = np.concatenate(
            [margins[kind] for kind in ("unobstructed", "object on table", "region on table")]
        )
        private = np.concatenate([separation, once])
        least = np.concatenate([private, margins["balance"]]).min()
        assert found.min_margin == pytest.approx(least, abs=EXACT)
        assert found.satisfied == (least >= 0)
        hinge = np.maximum(BUFFER - private, 0.0) ** 2 / 2
        shared = hinge[: len(separation)].sum()  # belongs to both objects
        assert found.violation == pytest.approx(hinge.sum() + shared, abs=EXACT)


def test_breaches_are_the_negative_margins(many, reference):
    for condition, pose, found in zip(*many, judge(*many), strict=True):
        margins = reference(condition, pose)
        for kind in Kind:
            expected = np.sort(margins[kind.value][margins[kind.value] < 0])
            told = np.sort([b.margin for b in found.breaches if b.kind is kind])
            np.testing.assert_allclose(told, expected, atol=EXACT)
        order = [b.margin for b in found.breaches]
        assert order == sorted(order)  # the worst first
        assert (found.reason(condition.objects) is None) == found.satisfied


def test_every_margin_is_listed_once(many, reference):
    """Of each kind the least is the least of all, and none is one that does not exist."""
    for condition, pose in list(zip(*many, strict=True))[::5]:
        margins, rows = reference(condition, pose), all_margins(condition, pose)
        assert [row.margin for row in rows] == sorted(row.margin for row in rows)
        assert len({row[:-1] for row in rows}) == len(rows)
        for kind in Kind:
            expected = margins[kind.value]
            told = np.array([row.margin for row in rows if row.kind is kind])
            if len(expected) == 0:
                assert len(told) == 0
                continue
            assert told.min() == pytest.approx(expected.min(), abs=EXACT)
            assert np.abs(told[:, None] - expected).min(axis=1).max() < EXACT


def test_together_or_one_by_one(many):
    """A verdict does not depend on the scenes it is made with."""
    conditions, poses = many
    together = judge(conditions, poses)
    for k in range(0, len(conditions), 17):
        assert judge([conditions[k]], [poses[k]]) == [together[k]]
    assert judge(conditions * 2, poses * 2) == together * 2
    assert judge([], []) == []


def test_all_holds():
    found = verdict(SceneCondition(CUP_AND_LAMP), (-0.3, 0, 0), (0.3, 0, 0))
    # The nearest thing is an edge: 0.47 m less the lamp's region at 0.147 m and its radius of 0.079 m.
    assert found.min_margin == pytest.approx(0.47 - 0.147 - 0.079, abs=EXACT)
    assert found.satisfied
    assert found.violation == 0
    assert found.reason(CUP_AND_LAMP) is None


ROTATED_LAPTOP = (0.079 + 0.059) * math.sqrt(0.5) + 0.006  # m, reach of its body at 45 degrees

BREACHES = [
    # the cup looks away from the lamp; 0.034 + 0.06 - 0.08
    (CUP_AND_LAMP, [(0, 0, math.pi), (0.08, 0, 0)], "pen_cup and desk_lamp overlap by 0.0140 m"),
    # one inside the other, where distances say nothing of centres
    (
        ("laptop", "pen_cup"),
        [(0, 0, math.pi), (0.044, 0, 0)],
        # 0.079 - 0.044 to the core's edge, and 0.006 + 0.034 of radii
        "laptop and pen_cup overlap by 0.0750 m",
    ),
    (
        CUP_AND_LAMP,
        [(0, 0, 0), (0.083 + 0.039 + 0.06 - 0.02, 0, 0)],
        "desk_lamp obstructs affordance region 1 of pen_cup by 0.0200 m",
    ),
    # the cup's handle, 0.061 m to the side, reaches into the lamp's region
    (
        ("desk_lamp", "teacup"),
        [(0, 0, 0), (0.079 + 0.061 + 0.019 - 0.01, -0.147, math.pi)],
        "teacup obstructs affordance region 1 of desk_lamp by 0.0100 m",
    ),
    (
        ("drawer_organizer", "pen_cup"),
        [(0, 0.2, 0), (0.1 + 0.108 + 0.034 - 0.03, -0.005, 0)],
        "pen_cup obstructs affordance region 3 of drawer_organizer by 0.0300 m",
    ),
    (
        ("pen_cup",),
        [(0.7 - 0.034 + 0.01, 0, math.pi)],
        "pen_cup reaches 0.0100 m over the table's edge",
    ),
    (
        ("pen_cup",),
        [(0, -0.47 + 0.034 - 0.02, math.pi / 2)],
        "pen_cup reaches 0.0200 m over the table's edge",
    ),
    (
        ("laptop",),
        [(0.4, 0.47 - ROTATED_LAPTOP + 0.005, -math.pi / 4)],
        "laptop reaches 0.0050 m over the table's edge",
    ),
    (
        ("pen_cup",),
        [(0.7 - 0.083 - 0.039 + 0.01, 0, 0)],
        "affordance region 1 of pen_cup reaches 0.0100 m over the table's edge",
    ),
    (
        ("drawing_board",),
        [(-0.2, -0.47 + 0.05 + 0.108 - 0.01, 0)],
        "affordance region 1 of drawing_board reaches 0.0100 m over the table's edge (and 1 more)",
    ),
]


@pytest.mark.parametrize(("objects", "poses", "words"), BREACHES)
def test_each_kind_of_breach_in_words(objects, poses, words):
    found = verdict(SceneCondition(objects), *poses)
    assert not found.satisfied
    assert found.reason(objects) == words


def test_the_number_of_other_breaches():
    """All at one place: the worst in words, the rest counted."""
    objects = ("pen_cup", "desk_lamp", "teacup")
    found = verdict(SceneCondition(objects), *[(0, 0, 0)] * 3)
    assert found.reason(objects).endswith(f" (and {len(found.breaches) - 1} more)")
    assert {b.kind for b in found.breaches} == {Kind.SEPARATION, Kind.UNOBSTRUCTED}


def test_changed_distance_of_a_region():
    """The region's centre at s^o 0.083 m, its radius as it was."""
    for scale in (0.5, 1.0, 2.0):
        condition = SceneCondition(CUP_AND_LAMP, {"pen_cup": Affordance(offset_scale=scale)})
        found = verdict(
            condition, (-0.3, 0.3, 0), (-0.3 + 0.083 * scale + 0.039 + 0.06 - 0.01, 0.3, math.pi)
        )
        worst = [b for b in found.breaches if b.kind is Kind.UNOBSTRUCTED]
        assert [b.margin for b in worst] == [pytest.approx(-0.01, abs=EXACT)]


def test_changed_radius_of_a_region():
    for scale in (0.5, 1.0, 3.0):
        condition = SceneCondition(("pen_cup",), {"pen_cup": Affordance(radius_scale=scale)})
        x = 0.7 - 0.083 - 0.039 * scale + 0.004
        found = verdict(condition, (x, 0, 0))
        assert found.min_margin == pytest.approx(-0.004, abs=EXACT)
        assert found.breaches[0].kind is Kind.REGION_ON_TABLE


@pytest.mark.parametrize("direction", [-math.pi, -math.pi / 2, 0.0, 1.0, math.pi])
def test_changed_direction_of_a_region(direction):
    """It turns counterclockwise about the object's centre, on top of the heading."""
    condition = SceneCondition(CUP_AND_LAMP, {"pen_cup": Affordance(direction=direction)})
    heading = 0.4
    aim = heading + direction
    reach = 0.083 + 0.039 + 0.06 - 0.003
    lamp = (
        reach * math.cos(aim),
        reach * math.sin(aim),
        aim + math.pi / 2,
    )  # its own region further out
    found = verdict(condition, (0, 0, heading), lamp)
    assert (
        found.reason(CUP_AND_LAMP)
        == "desk_lamp obstructs affordance region 1 of pen_cup by 0.0030 m"
    )
    away = SceneCondition(CUP_AND_LAMP, {"pen_cup": Affordance(direction=direction + math.pi)})
    assert verdict(away, (0, 0, heading), lamp).satisfied


def test_a_requirement_moves_no_body():
    """Changed regions of one object leave the margins of bodies as they are."""
    poses = ((0, 0, math.pi), (0.08, 0, 0))
    changed = SceneCondition(CUP_AND_LAMP, {"desk_lamp": Affordance(0.5, 0.5, math.pi)})
    for condition in (SceneCondition(CUP_AND_LAMP), changed):
        found = [b.margin for b in verdict(condition, *poses).breaches if b.kind is Kind.SEPARATION]
        assert found == [pytest.approx(-0.014, abs=EXACT)]


@pytest.mark.parametrize(("width", "depth"), [(1.40, 0.94), (0.3, 2.0), (2.0, 0.3), (50.0, 40.0)])
def test_other_tables(width, depth):
    """Room at the edges is that of the table asked for."""
    condition = SceneCondition(("desk_lamp",), width=width, depth=depth)
    found = verdict(condition, (0, 0, 0))
    room = (width / 2 - 0.079, depth / 2 - 0.147 - 0.079)
    assert found.min_margin == pytest.approx(min(room), abs=EXACT)


def test_margins_between_objects_do_not_depend_on_the_frame(random_scenes):
    """A rigid motion of the whole scene, on a table too large to matter."""
    conditions, poses = random_scenes(9, 30, 6, "combined")
    large = [SceneCondition(c.objects, c.requirements, 100.0, 100.0) for c in conditions]
    turn, shift = 1.1, np.array([[3.0, -2.0]])
    matrix = np.array([[math.cos(turn), math.sin(turn)], [-math.sin(turn), math.cos(turn)]])
    moved = [np.concatenate([p[:, :2] @ matrix + shift, p[:, 2:] + turn], axis=1) for p in poses]
    for here, there in zip(judge(large, poses), judge(large, moved), strict=True):
        assert here.min_margin == pytest.approx(there.min_margin, abs=EXACT)
        assert here.violation == pytest.approx(there.violation, abs=EXACT)


@pytest.mark.parametrize("column", range(3))
@pytest.mark.parametrize("objects", [("pen_cup",), ("drawer_organizer", "pen_cup")])
def test_a_pose_that_is_not_a_number_satisfies_nothing(objects, column):
    poses = np.array([(-0.4, 0.2, 0.0), (0.4, 0.0, 0.0)])[: len(objects)]
    condition = SceneCondition(objects)
    assert judge([condition], [poses])[0].satisfied
    for agent in range(len(objects)):
        broken = poses.copy()
        broken[agent, column] = np.nan
        found = judge([condition], [broken])[0]
        assert not found.satisfied
        assert found.reason(objects) is not None
