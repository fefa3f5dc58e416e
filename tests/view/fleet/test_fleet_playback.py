"""Robots that follow plans in MuJoCo: models, motions and what is said of them, measured without the code that drives them."""

import os
import re
import subprocess
import sys

import mujoco
import numpy as np
import pytest
import shapely
from shapely.geometry import MultiPoint, Point, Polygon, box

from deggflow.certificate import Certificate
from deggflow.jsonl import InputError
from deggflow.task import PictureRequest
from deggflow.tasks.fleet.condition import FleetCondition, Robot
from deggflow.tasks.fleet.maps import FloorMap
from deggflow.tasks.fleet.options import FleetRender
from deggflow.tasks.fleet.paths import exact_path
from deggflow.tasks.fleet.plan import Plan
from deggflow.view.fleet import video
from deggflow.view.fleet.mjcf import Scale, fleet_mjcf
from deggflow.view.fleet.playback import play
from deggflow.view.fleet.results import FleetPictures
from deggflow.view.fleet.robots import wheel_speeds
from deggflow.view.fleet.stage import moment_of, playback_stage
from deggflow.view.stage import Shot, gl_problem

DRIVES = ("omni", "differential")
NOTCHED = ((-0.6, -0.7), (-0.1, -0.7), (-0.1, -0.2), (-0.3, -0.5), (-0.6, -0.2))
FLOOR = FloorMap(boxes=((0.5, 0.5, 0.3, 0.2),), discs=((-0.5, 0.5, 0.2),), polygons=(NOTCHED,))
SCALE = Scale(metres=3.0, seconds=0.5)
RADIUS = 0.05 * SCALE.metres  # m
TICK = 0.01  # s


def plan_of(ends, modes=None, floor=FLOOR):
    robots = tuple(Robot(start, goal) for start, goal in ends)
    condition = FleetCondition(floor, robots)
    z = np.zeros((len(robots), 124)) if modes is None else modes
    paths = exact_path(z, condition.starts, condition.goals)
    return Plan(condition, paths, Certificate(True, 0.0, 0.0, 1, None), 0)


def curved():
    """Three robots on winding ways between the obstacles, one of which comes back to where it was."""
    modes = np.zeros((3, 124))
    modes[:, :6] = [[0, 0.6, 0, 0.5, 0, 0], [0.3, 0.6, 0, 0, 0.8, 0], [2.0, 0, 0, -1.2, 0, 0]]
    ends = [((-0.8, 0.0), (0.8, 0.1)), ((0.7, -0.8), (-0.2, 0.8)), ((0.2, -0.5), (0.2, -0.4))]
    return plan_of(ends, modes)


@pytest.fixture(scope="module", params=DRIVES)
def playback(request):
    """A motion that follows these ways."""
    return play(curved(), request.param, SCALE)


def outlines(model, data, kind):
    """Shapes from above of the geoms with a contact bit that belong to no body, in m."""
    for geom in np.flatnonzero((model.geom_bodyid == 0) & (model.geom_contype == kind)):
        size, at = model.geom_size[geom], data.geom_xpos[geom]
        turn = data.geom_xmat[geom].reshape(3, 3)
        match mujoco.mjtGeom(model.geom_type[geom]):
            case mujoco.mjtGeom.mjGEOM_BOX:
                local = np.array([(a, b, 0) for a in (-1, 1) for b in (-1, 1)]) * size
            case mujoco.mjtGeom.mjGEOM_CYLINDER:
                yield Point(at[:2]).buffer(size[0], quad_segs=64)
                continue
            case mujoco.mjtGeom.mjGEOM_MESH:
                mesh = model.geom_dataid[geom]
                first = model.mesh_vertadr[mesh]
                local = model.mesh_vert[first : first + model.mesh_vertnum[mesh]]
        yield MultiPoint((local @ turn.T + at)[:, :2]).convex_hull


@pytest.mark.parametrize("drive", DRIVES)
def test_the_model_has_the_floor_and_the_robots_at_their_starts(drive):
    plan = curved()
    model = mujoco.MjModel.from_xml_string(fleet_mjcf(plan, drive, SCALE))
    data = mujoco.MjData(model)
    mujoco.mj_forward(model, data)
    x, y, r = FLOOR.discs[0]
    shapes = [box(0.35, 0.4, 0.65, 0.6), Polygon(NOTCHED), Point(x, y).buffer(r, quad_segs=64)]
    frame = box(-2, -2, 2, 2).difference(box(-1, -1, 1, 1))
    expected = shapely.affinity.scale(shapely.union_all([*shapes, frame]), 3, 3, origin=(0, 0))
    solid = shapely.union_all(list(outlines(model, data, 2)))
    within = box(-3, -3, 3, 3)
    assert (
        solid.intersection(within).symmetric_difference(expected.intersection(within)).area < 1e-3
    )
    assert solid.covers(box(-3.05, -3.05, 3.05, 3.05).difference(within))
    for k, path in enumerate(plan.paths):
        body, hull = data.body(f"robot_{k + 1}"), f"robot_{k + 1}_hull"
        np.testing.assert_allclose(body.xpos[:2], SCALE.metres * path[0], atol=1e-12)
        np.testing.assert_allclose(data.geom(hull).xpos[:2], SCALE.metres * path[0], atol=1e-9)
        assert model.geom(hull).size[0] == pytest.approx(RADIUS, abs=1e-5)
        mass = model.body_subtreemass[model.body(f"robot_{k + 1}").id]
        assert mass == pytest.approx(1250 * RADIUS**3, rel=1e-6)
    hulls = [g for g in range(model.ngeom) if model.geom_contype[g] == 2]
    assert not any(set(contact.geom) & set(hulls) for contact in data.contact)


def test_the_motion_is_what_mujoco_makes_of_the_commands(playback, tmp_path):
    (tmp_path / "plan.xml").write_text(fleet_mjcf(playback.plan, playback.drive, SCALE))
    model = mujoco.MjModel.from_xml_path(str(tmp_path / "plan.xml"))
    data = mujoco.MjData(model)
    places = []
    for command in playback.commands:
        mujoco.mj_forward(model, data)
        places.append([data.body(f"robot_{k + 1}").xpos[:2].copy() for k in range(3)])
        data.ctrl[:] = command
        for _ in range(round(TICK / model.opt.timestep)):
            mujoco.mj_step(model, data)
    np.testing.assert_allclose(places, playback.positions[:-1], atol=1e-9)
    assert len(places) == round((63 * SCALE.seconds + 1) / TICK)


def test_what_is_said_of_the_motion_is_so(playback):
    time, moved, plan = TICK * np.arange(len(playback.positions)), playback.positions, playback.plan
    waypoints = SCALE.seconds * np.arange(64)
    where = np.stack(
        [[np.interp(time, waypoints, path[:, k]) for k in (0, 1)] for path in plan.paths]
    )
    away = np.linalg.norm(moved - SCALE.metres * where.transpose(2, 0, 1), axis=-1).max()
    gap = min(
        float(shapely.distance(shapely.points(moved[:, a]), shapely.points(moved[:, b])).min())
        for a, b in ((0, 1), (0, 2), (1, 2))
    )
    x, y, r = FLOOR.discs[0]
    places = shapely.points(moved / SCALE.metres)
    shapes = [box(0.35, 0.4, 0.65, 0.6), Polygon(NOTCHED), box(-1, -1, 1, 1).exterior]
    near = min(float(shapely.distance(places, shape).min()) for shape in shapes)
    near = min(near, float(shapely.distance(places, Point(x, y)).min()) - r)
    gap, near = gap - 2 * RADIUS, near * SCALE.metres - RADIUS
    assert playback.deviations().max() == pytest.approx(away, rel=1e-9)
    assert playback.gaps().min() == pytest.approx(gap, rel=1e-9)
    assert playback.clearances().min() == pytest.approx(near, rel=1e-9)
    said = [float(v) for v in re.findall(r"([-\d.]+) mm", playback.text())]
    np.testing.assert_allclose(said, 1e3 * np.array([away, gap, near]), atol=0.051)
    units = [float(v) for v in re.findall(r"\(([-\d.]+) map units", playback.text())]
    np.testing.assert_allclose(units, np.array([away, gap, near]) / SCALE.metres, rtol=0.05)
    assert away < 0.1 * RADIUS


def test_wheels_roll_and_do_not_slip_sideways(playback):
    if playback.drive == "omni":
        assert playback.states.shape[1] == 6
        return
    states = playback.states.reshape(-1, 3, 9)
    w, z = states[..., 3], states[..., 6]
    heading = np.stack([w**2 - z**2, 2 * w * z], axis=-1)
    axle = states[..., :2] - 0.4 * RADIUS * heading
    move, ahead = np.diff(axle, axis=0), (heading[1:] + heading[:-1]) / 2
    along = np.sum(move * ahead, axis=-1)
    across = move[..., 1] * ahead[..., 0] - move[..., 0] * ahead[..., 1]
    assert np.abs(across).sum() < 0.02 * np.abs(along).sum()
    rolled = 0.22 * RADIUS * np.diff(states[..., 7:], axis=0).mean(-1)
    np.testing.assert_allclose(rolled.sum(0), along.sum(0), rtol=0.02)
    assert np.abs(states[..., 4:6]).max() < 0.02  # stands upright
    assert np.abs(np.diff(np.unwrap(2 * np.arctan2(z, w), axis=0), axis=0)).sum() > 1  # and turns


def test_wheel_speeds_move_the_centre_as_rigid_bodies_do():
    rng = np.random.default_rng(0)
    velocity, heading = rng.normal(size=(50, 2)), rng.uniform(-np.pi, np.pi, 50)
    left, right = wheel_speeds(velocity, heading, 0.2).T * 0.22 * 0.2
    turn, drive = (right - left) / (2 * 0.65 * 0.2), (left + right) / 2
    front = np.exp(1j * heading)
    moved = (drive + 1j * turn * 0.4 * 0.2) * front
    np.testing.assert_allclose(moved, velocity[:, 0] + 1j * velocity[:, 1], rtol=1e-9)


@pytest.mark.parametrize("drive", DRIVES)
def test_robots_that_a_plan_drives_into_each_other_collide(drive):
    plan = plan_of([((-0.5, 0.0), (0.5, 0.0)), ((0.5, 0.01), (-0.5, 0.01))], floor=FloorMap())
    playback = play(plan, drive, SCALE)
    assert playback.gaps().min() > -0.02 * RADIUS
    assert playback.deviations().max() > RADIUS


def test_slower_robots_follow_more_closely():
    plan = curved()
    errors = [play(plan, "omni", Scale(3.0, s)).deviations().max() for s in (0.25, 0.5, 1.0)]
    assert errors[0] > 1.5 * errors[1] > 2.25 * errors[2]


def test_robots_beyond_the_sizes_of_the_drives_are_refused():
    with pytest.raises(InputError, match=r"have 0\.005 m .* change --metres"):
        fleet_mjcf(curved(), "omni", Scale(metres=0.1))


def covered(one, other):
    """Middle of the pixels that are floor in the other picture and dark in the one, x to the right and y up."""
    rows, columns = np.nonzero((other.min(-1) > 200) & (one.min(-1) < 150))
    assert len(rows) > 20
    return np.array([columns.mean(), -rows.mean()])


@pytest.mark.parametrize("renderer", ["mujoco", "matplotlib"])
def test_pictures_show_robots_where_they_are(renderer):
    if renderer == "mujoco" and gl_problem():
        pytest.skip(gl_problem())
    plan = plan_of([((-0.5, -0.4), (0.4, 0.5))], floor=FloorMap())
    playback = play(plan, "omni", Scale(4.0, 0.2))
    stage = playback_stage(playback, Shot(600, 480, "top", renderer, 1))
    first, last = (stage.picture(moment_of(playback, tick)) for tick in (0, -1))
    stage.close()
    across, up = covered(last, first) - covered(first, last)
    assert across == pytest.approx(up, rel=0.05)
    assert across == pytest.approx(0.45 * 480, rel=0.15)


def test_a_model_a_line_and_a_video_are_written(tmp_path, monkeypatch):
    monkeypatch.setattr(video, "PLAYED_BETWEEN", 1 / 20)
    options = FleetRender(out=tmp_path, video=True, playback="omni", seconds=0.1)
    said = []
    request = PictureRequest(curved(), 3, options, lambda: None, said.append)
    written = [path.name for path in FleetPictures().write(request)]
    assert written == ["plan_0003.png", "plan_0003.xml", "plan_0003.mp4"]
    assert all((tmp_path / name).stat().st_size > 1000 for name in written)
    mujoco.MjModel.from_xml_path(str(tmp_path / "plan_0003.xml"))
    assert said[0].startswith("Plan 3: omnidirectional robots in MuJoCo are never more than ")


@pytest.mark.parametrize("choice", ["disable", "osmesa", "glfw"])
def test_dynamics_need_no_opengl(choice):
    """Of these, MuJoCo cannot even be imported with some, where their libraries are missing."""
    code = (
        "from deggflow.view.stage import import_physics; m = import_physics(); "
        "m.mj_step(model := m.MjModel.from_xml_string('<mujoco/>'), m.MjData(model))"
    )
    environment = {**os.environ, "MUJOCO_GL": choice}
    environment.pop("DISPLAY", None)
    subprocess.run([sys.executable, "-c", code], check=True, env=environment)
