"""The exported scene loads, bodies keep within the library's shapes, colours follow the verdict."""

import math
import xml.etree.ElementTree as ElementTree

import mujoco
import numpy as np
import pytest
from shapely import MultiPoint, Point, box, union_all
from shapely.affinity import rotate, translate

from deggflow.tasks.tabletop.condition import Affordance, SceneCondition
from deggflow.tasks.tabletop.library import object_type
from deggflow.tasks.tabletop.verdict import Kind, judge
from deggflow.view.tabletop import scene_mjcf

TOLERANCE = 1e-3  # m
MARK_GROUP = 1  # of regions and outlines

CIRCLE = np.array(
    [[math.cos(a), math.sin(a), 0.0] for a in np.linspace(0, math.tau, 48, endpoint=False)]
)
SPHERE = np.concatenate(
    [
        math.cos(t) * CIRCLE + [0.0, 0.0, math.sin(t)]
        for t in np.linspace(-math.pi / 2, math.pi / 2, 13)
    ]
)


def load(text):
    model = mujoco.MjModel.from_xml_string(text)
    data = mujoco.MjData(model)
    mujoco.mj_forward(model, data)
    return model, data


def surface(model, data, geom):
    """Points on a geom's surface in the world, as MuJoCo compiled it."""
    size, up = model.geom_size[geom], np.array([0.0, 0.0, 1.0])
    match mujoco.mjtGeom(model.geom_type[geom]):
        case mujoco.mjtGeom.mjGEOM_BOX:
            local = np.array(np.meshgrid([-1, 1], [-1, 1], [-1, 1])).reshape(3, -1).T * size
        case mujoco.mjtGeom.mjGEOM_CYLINDER:
            local = np.concatenate([size[0] * CIRCLE + s * size[1] * up for s in (-1, 1)])
        case mujoco.mjtGeom.mjGEOM_CAPSULE:
            local = np.concatenate([size[0] * SPHERE + s * size[1] * up for s in (-1, 1)])
        case mujoco.mjtGeom.mjGEOM_ELLIPSOID:
            local = SPHERE * size
        case mujoco.mjtGeom.mjGEOM_MESH:
            mesh = model.geom_dataid[geom]
            start = model.mesh_vertadr[mesh]
            local = model.mesh_vert[start : start + model.mesh_vertnum[mesh]]
        case other:
            raise AssertionError(f"no surface known for {other}")
    return local @ data.geom_xmat[geom].reshape(3, 3).T + data.geom_xpos[geom]


def geoms_of(model, name, *, marks):
    body = model.body(name).id
    return [
        g
        for g in range(model.ngeom)
        if model.geom_bodyid[g] == body and (model.geom_group[g] == MARK_GROUP) == marks
    ]


def footprint(name, pose):
    parts = []
    for p in object_type(name).primitives:
        hx, hy = p.half_x - p.corner, p.half_y - p.corner
        core = box(p.x - hx, p.y - hy, p.x + hx, p.y + hy) if hx or hy else Point(p.x, p.y)
        parts.append(core.buffer(p.corner, quad_segs=64))
    turned = rotate(union_all(parts), pose[2], origin=(0, 0), use_radians=True)
    return translate(turned, pose[0], pose[1])


def test_every_object_is_a_body_within_its_footprint(everything):
    condition, poses = everything
    model, data = load(scene_mjcf(condition, poses))
    for name, pose in zip(condition.objects, poses, strict=True):
        shape = footprint(name, pose).buffer(TOLERANCE)
        geoms = geoms_of(model, name, marks=False)
        assert len(geoms) > 10, name
        for geom in geoms:
            points = surface(model, data, geom)
            assert shape.covers(MultiPoint(points[:, :2])), (name, geom)
            assert points[:, 2].min() > -TOLERANCE, (name, geom)


def test_every_object_fills_most_of_its_footprint_and_stands_up(everything):
    condition, poses = everything
    model, data = load(scene_mjcf(condition, poses))
    for name, pose in zip(condition.objects, poses, strict=True):
        points = np.concatenate(
            [surface(model, data, geom) for geom in geoms_of(model, name, marks=False)]
        )
        assert MultiPoint(points[:, :2]).convex_hull.area > 0.9 * footprint(name, pose).area, name
        assert points[:, 2].max() > 0.008, name


def test_regions_lie_where_the_requirement_puts_them():
    need = Affordance(offset_scale=1.2, radius_scale=1.1, direction=math.pi / 2)
    condition, pose = SceneCondition(("laptop",), {"laptop": need}), np.array([[0.1, -0.05, 0.3]])
    model, data = load(scene_mjcf(condition, pose))
    geom = model.geom("laptop_region_1").id
    angle = 0.3 + math.pi / 2  # the laptop's region is at +x of the body
    expected = np.array([0.1, -0.05]) + 1.2 * 0.155 * np.array([math.cos(angle), math.sin(angle)])
    np.testing.assert_allclose(data.geom_xpos[geom][:2], expected, atol=2e-5)
    assert model.geom_size[geom][0] == pytest.approx(1.1 * 0.07, abs=1e-5)
    assert 0.0 < data.geom_xpos[geom][2] + model.geom_size[geom][1] < 0.003


def classes(text):
    """Class of every named geom."""
    return {
        geom.get("name"): geom.get("class")
        for geom in ElementTree.fromstring(text).iter("geom")
        if geom.get("name")
    }


def test_colours_follow_the_breaches(trio_blocked):
    condition, poses = trio_blocked
    kinds = classes(scene_mjcf(condition, poses))
    breaches = {(b.kind, b.owner, b.other) for b in judge([condition], [poses])[0].breaches}
    assert (Kind.UNOBSTRUCTED, 0, 1) in breaches
    assert (Kind.SEPARATION, 1, 2) in breaches
    assert kinds["laptop_region_1"] == "blocked"
    assert kinds["handled_mug_region_1"] == "free"
    outlined = {name.split("_outline")[0] for name, kind in kinds.items() if kind == "outline"}
    assert outlined == {"handled_mug", "pen_cup"}


def test_reaching_over_the_edge_is_red(trio):
    condition, poses = trio
    poses = poses.copy()
    poses[2] = 0.69, -0.2, 0.0
    kinds = classes(scene_mjcf(condition, poses))
    assert kinds["pen_cup_region_1"] == "blocked"
    assert "pen_cup_outline_1" in kinds
    assert kinds["laptop_region_1"] == "free"


def test_nothing_is_red_where_all_holds(trio):
    kinds = classes(scene_mjcf(*trio))
    assert set(kinds.values()) == {"free"}


def test_a_verdict_given_is_the_one_shown(trio, trio_blocked):
    condition, poses = trio
    verdict = judge([trio_blocked[0]], [trio_blocked[1]])[0]
    assert classes(scene_mjcf(condition, poses, verdict))["laptop_region_1"] == "blocked"


def test_outlines_reach_beyond_the_object(trio_blocked):
    condition, poses = trio_blocked
    model, data = load(scene_mjcf(condition, poses))
    for name in ("handled_mug", "pen_cup"):
        rims = [g for g in geoms_of(model, name, marks=True) if "outline" in model.geom(g).name]
        points = np.concatenate([surface(model, data, g) for g in rims])
        rim = MultiPoint(points[:, :2]).convex_hull
        assert rim.covers(footprint(name, poses[condition.objects.index(name)]).buffer(0.005))


def test_the_table_has_the_conditions_size_and_the_cameras_see_it():
    condition = SceneCondition(("teacup",), width=2.0, depth=0.8)
    model, data = load(scene_mjcf(condition, np.zeros((1, 3))))
    tops = [g for g in range(model.ngeom) if model.geom_bodyid[g] == model.body("table").id]
    assert max(model.geom_size[g][0] for g in tops) == pytest.approx(1.0)
    assert max(model.geom_size[g][1] for g in tops) == pytest.approx(0.4)
    for name in ("studio", "top"):
        camera = model.camera(name).id
        axes, pos = data.cam_xmat[camera].reshape(3, 3), data.cam_xpos[camera]
        half = math.tan(math.radians(model.cam_fovy[camera]) / 2)
        for x in (-1.0, 1.0):
            for y in (-0.4, 0.4):
                right, up, back = axes.T @ (np.array([x, y, 0.0]) - pos)
                assert abs(up) < -back * half
                assert abs(right) < -back * half * 4 / 3


def test_the_text_is_the_same_each_time(everything):
    assert scene_mjcf(*everything) == scene_mjcf(*everything)


def test_moving_a_mocap_body_moves_the_object(trio):
    model, data = load(scene_mjcf(*trio))
    data.mocap_pos[model.body("laptop").mocapid[0]] = 0.4, 0.1, 0.0
    mujoco.mj_forward(model, data)
    np.testing.assert_allclose(data.body("laptop").xpos, [0.4, 0.1, 0.0])


@pytest.mark.parametrize("bad", [np.zeros((2, 3)), np.array([[0.0, np.nan, 0.0]])])
def test_poses_that_cannot_be_drawn_are_refused(bad):
    with pytest.raises(ValueError, match="poses"):
        scene_mjcf(SceneCondition(("teacup",)), bad)
