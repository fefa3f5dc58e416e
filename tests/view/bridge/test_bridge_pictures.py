"""Pictures and videos of the bridge: bodies stand where they should, faults are red, sizes are right."""

import math
import os
import subprocess
import sys
from contextlib import closing
from pathlib import Path

import mujoco
import numpy as np
import pytest

import deggflow
from deggflow.tasks.bridge.process import Process
from deggflow.tasks.bridge.world import CENTRE_SIDE, ROBOT_RADIUS, X_MAX, X_MIN, Y_MAX, Y_MIN
from deggflow.view.bridge import compare, picture, snapshots, write_process_video
from deggflow.view.bridge.mjcf import bridge_mjcf
from deggflow.view.bridge.moment import PIT_DEPTH, THICKNESS, moment_of
from deggflow.view.bridge.pictures import telling_ticks
from deggflow.view.bridge.stage import BridgeModel, bridge_stage
from deggflow.view.stage import Shot, gl_problem

needs_gl = pytest.mark.skipif(gl_problem() is not None, reason="no OpenGL here")
RENDERER = "matplotlib" if gl_problem() else "mujoco"
SMALL = {"width": 192, "height": 108, "renderer": RENDERER}
GOALS = np.array([[4.0, -1.0], [5.0, 1.0], [6.0, 0.0]])
CONTACTS = np.array([[-2.0, CENTRE_SIDE], [-1.2, -CENTRE_SIDE], [-0.6, CENTRE_SIDE]])
WHY = "the plank leaves the workspace"

# In a process of its own, as imageio's reader forks, against which JAX warns.
READ = """
import sys
import imageio.v3 as iio
print(*iio.imread(sys.argv[1], plugin="FFMPEG").shape)
"""


def at_contacts(pose):
    cos, sin = np.cos(pose[2]), np.sin(pose[2])
    return CONTACTS @ np.array([[cos, sin], [-sin, cos]]) + pose[:2]


@pytest.fixture
def process():
    """Two ticks of each stage; in the last, one robot on either ground and one on the bridge."""
    start, end = np.array([-3.2, 0.3, 0.4]), np.array([-0.1, 0.0, 0.0])
    plank = np.array([start, start, start, end, end, end])
    away = at_contacts(start) + [0.0, -1.5]
    across = np.array([[-4.0, 0.0], [1.0, 0.0], [4.0, 1.0]])
    robots = [away, at_contacts(start), at_contacts(start), at_contacts(end), across, across]
    stages = ("approach", "approach", "build", "build", "cross", "cross")
    return Process(plank, np.array(robots), stages, GOALS, end, None)


@pytest.fixture
def failed(process):
    """It ends in the third tick with the plank over the border."""
    pose = np.array([-2.0, 1.5, 1.2])
    plank = np.concatenate([process.plank[:2], pose[None]])
    robots = np.concatenate([process.robots[:2], at_contacts(pose)[None]])
    return Process(plank, robots, process.stage[:3], GOALS, process.plank_goal, WHY)


def red(image):
    """Number of clearly red pixels."""
    r, g, b = np.moveaxis(image.astype(int), -1, 0)
    return int(np.sum((r > 140) & (g < 80) & (b < 80)))


def with_robot(process, x, y):
    robots = process.robots.copy()
    robots[-1, 0] = x, y
    return process._replace(robots=robots)


def test_the_scene_loads_and_both_cameras_see_the_whole_workspace():
    model = mujoco.MjModel.from_xml_string(bridge_mjcf(GOALS, np.array([0.0, 0.0, 0.1])))
    data = mujoco.MjData(model)
    mujoco.mj_forward(model, data)
    assert model.nmocap == 1 + len(GOALS)
    for name in ("studio", "top"):
        camera = model.camera(name).id
        half = math.tan(math.radians(model.cam_fovy[camera]) / 2)
        seen = []
        for x in (X_MIN, X_MAX):
            for y in (Y_MIN, Y_MAX):
                offset = np.array([x, y, 0.0]) - data.cam_xpos[camera]
                right, up, back = data.cam_xmat[camera].reshape(3, 3).T @ offset
                seen.append([right / (-back * half * 16 / 9), up / (-back * half)])
        assert np.abs(seen).max() < 1.0, name
        assert np.ptp(seen, axis=0)[0] > 1.75, name  # of a width of 2


def test_robots_rise_onto_the_plank_and_fall_into_the_pit(process):
    height = moment_of(process, -1).robots[:, 2]
    np.testing.assert_allclose(height, [0.0, THICKNESS, 0.0], atol=1e-12)
    ends = [moment_of(with_robot(process, x, 0.0), -1).robots[0, 2] for x in (-3.07, -3.03, -2.99)]
    assert 0.0 < ends[0] < ends[1] < ends[2] == pytest.approx(THICKNESS)
    fallen = moment_of(with_robot(process, 0.02, -1.0), -1)
    assert fallen.robots[0, 2] == -PIT_DEPTH
    assert fallen.robots[0, 0] >= ROBOT_RADIUS  # clear of the wall
    assert fallen.red_robots.tolist() == [True, False, False]
    assert not fallen.red_plank


def test_robots_that_push_stay_on_the_ground(process):
    assert not moment_of(process, 3).robots[:, 2].any()


def test_the_models_bodies_follow_the_moment(process):
    scene = BridgeModel(process, 16 / 9)
    scene.place(moment_of(process, -1))
    mujoco.mj_kinematics(scene.model, scene.data)
    ground, bridge, _ = (scene.data.body(f"robot_{i + 1}").xpos[2] for i in range(3))
    np.testing.assert_allclose(scene.data.body("plank").xpos, [-0.1, 0.0, 0.0])
    assert bridge == pytest.approx(ground + THICKNESS)


def test_only_the_last_tick_of_a_failure_is_red(failed):
    assert moment_of(failed, -1).red_plank
    assert not moment_of(failed, -2).red_plank
    assert not moment_of(failed._replace(failure=None), -1).red_plank
    beyond = moment_of(with_robot(failed, -5.0, Y_MAX), -1)
    assert beyond.red_robots.tolist() == [True, False, False]


def test_a_robot_that_was_lost_is_pale(process):
    lossy = process._replace(lost={1: 3})
    assert not moment_of(lossy, 2).lost_robots.any()
    assert moment_of(lossy, 3).lost_robots.tolist() == [False, True, False]
    scene = BridgeModel(lossy, 16 / 9)
    body = scene.model.geom_bodyid == scene.model.body("robot_2").id
    colours = []
    for tick in (2, 3):
        scene.place(moment_of(lossy, tick))
        colours.append(scene.model.geom_rgba[body, :3].copy())
    spread = [np.ptp(colour, axis=1).max() for colour in colours]  # of a grey it is 0
    assert spread[1] < 0.4 * spread[0]


@pytest.mark.parametrize("renderer", ["mujoco", "matplotlib"])
def test_pictures_have_their_size_and_show_something_and_failures_in_red(process, failed, renderer):
    if renderer == "mujoco" and gl_problem():
        pytest.skip("no OpenGL here")
    size = {"width": 320, "height": 180, "renderer": renderer}
    good, bad = picture(process, 3, **size), picture(failed, -1, **size)
    assert good.shape == bad.shape == (180, 320, 3)
    assert good.std() > 20
    assert red(bad) > 300
    assert red(good) < 10


@needs_gl
@pytest.mark.parametrize("camera", ["studio", "top"])
def test_the_same_moment_gives_the_same_pixels(process, camera):
    one, other = (picture(process, 4, camera=camera, **SMALL) for _ in range(2))
    np.testing.assert_array_equal(one, other)
    assert (one != picture(process, 0, camera=camera, **SMALL)).any()


@needs_gl
def test_a_stage_forgets_the_red_of_an_earlier_picture(failed):
    stage = bridge_stage(failed, Shot(64, 36, "top", "mujoco", oversampling=1))
    with closing(stage):
        before = stage.picture(moment_of(failed, 0))
        assert red(stage.picture(moment_of(failed, -1))) > red(before)
        np.testing.assert_array_equal(stage.picture(moment_of(failed, 0)), before)


def test_snapshots_show_the_stages_there_are(process, failed):
    assert telling_ticks(process) == [0, 3, 4]
    assert telling_ticks(failed) == [0, 2]
    assert telling_ticks(process._replace(failure="robot 1 enters the gap")) == [0, 3, 5]
    whole, part = snapshots(process, **SMALL), snapshots(failed, **SMALL)
    assert whole.shape[1] == part.shape[1] == 192
    assert 3 * 108 <= whole.shape[0] < 3.2 * 108
    assert 2 * 108 <= part.shape[0] < 2.2 * 108
    assert snapshots(process, [5], **SMALL).shape == (108, 192, 3)
    with pytest.raises(ValueError, match="ticks"):
        snapshots(process, [], **SMALL)


def test_comparison_tells_why_the_nominal_one_failed_in_red(process, failed):
    pair = compare(failed, process, **SMALL)
    assert pair.shape[0] > 108
    assert pair.shape[1] > 2 * 192
    middle = pair.shape[1] // 2
    caption = pair[-16:].astype(int)
    reddish = caption[..., 0] - caption[..., 1] > 60
    assert reddish[:, :middle].any()
    assert not reddish[:, middle:].any()


def frames_of(path):
    done = subprocess.run(
        [sys.executable, "-c", READ, str(path)], check=True, capture_output=True, text=True
    )
    return tuple(int(n) for n in done.stdout.split())


def test_a_video_has_a_frame_per_tick_and_a_second_more(process, tmp_path):
    path, told = tmp_path / "new" / "bridge.mp4", []
    size = {**SMALL, "width": 193, "height": 107}
    write_process_video(path, process, fps=5, on_frame=lambda *n: told.append(n), **size)
    count, height, width, _ = frames_of(path)
    assert (count, width) == (6 + 5, 194)
    assert height > 107
    assert height % 2 == 0
    assert told == [(k + 1, 6) for k in range(6)]
    assert os.listdir(path.parent) == ["bridge.mp4"]


def test_beside_a_longer_process_the_failed_one_holds_its_last_frame(process, failed, tmp_path):
    path = tmp_path / "pair.mp4"
    write_process_video(path, process, left=failed, fps=2, **SMALL)
    count, _, width, _ = frames_of(path)
    assert count == 6 + 2
    assert width > 2 * 192


def test_what_cannot_be_drawn_is_refused_and_leaves_the_old_file(process, tmp_path):
    path = tmp_path / "bridge.mp4"
    path.write_bytes(b"old")
    nowhere = process._replace(plank=np.full((6, 3), np.nan))
    with pytest.raises(ValueError, match="finite"):
        write_process_video(path, nowhere, **SMALL)
    with pytest.raises(ValueError, match="one per tick"):
        write_process_video(path, process._replace(stage=process.stage[:4]), **SMALL)
    assert path.read_bytes() == b"old"
    assert os.listdir(tmp_path) == ["bridge.mp4"]
    with pytest.raises(IndexError, match="6"):
        picture(process, 6, **SMALL)


FALLBACK = """
import sys
import numpy as np
import deggflow.view.bridge as view
from deggflow.tasks.bridge.process import Process
heavy = {"mujoco", "matplotlib", "imageio_ffmpeg"} & set(sys.modules)
assert not heavy, heavy
process = Process(np.zeros((1, 3)), np.zeros((1, 1, 2)), ("build",), np.ones((1, 2)), np.zeros(3), None)
for _ in range(2):
    print(view.picture(process, 0, width=96, height=54).shape)
"""


def test_the_room_is_light_and_without_opengl_announces_a_top_view_once():
    source = str(Path(deggflow.__path__[0]).parent)
    paths = os.pathsep.join([source, os.environ.get("PYTHONPATH", "")])
    environment = {**os.environ, "PYTHONPATH": paths, "MUJOCO_GL": "unusable"}
    done = subprocess.run(
        [sys.executable, "-c", FALLBACK], env=environment, capture_output=True, text=True
    )
    assert done.returncode == 0, done.stderr
    assert done.stdout.split("\n")[:2] == ["(54, 96, 3)"] * 2
    assert len(done.stderr.strip().splitlines()) == 1, done.stderr
    assert "top view" in done.stderr
