"""Pictures: the right shape, red where something is wrong, a drawn view where OpenGL is missing."""

import os
import subprocess
import sys
from pathlib import Path

import imageio.v3 as iio
import numpy as np
import pytest

import deggflow
from deggflow.view.picture import map_blocks, panels, render, save_png
from deggflow.view.stage import gl_problem

needs_gl = pytest.mark.skipif(gl_problem() is not None, reason="no OpenGL here")
SIZE = {"width": 320, "height": 240}

TWO_PICTURES = """
import sys
import numpy as np
from deggflow.tasks.tabletop.condition import SceneCondition
from deggflow.view.picture import render
scene = SceneCondition(("teacup",)), np.zeros((1, 3))
for _ in range(2):
    print(render(*scene, width=160, height=120, renderer=sys.argv[1]).shape)
"""


def red(image):
    """Number of clearly red pixels."""
    r, g, b = np.moveaxis(image.astype(int), -1, 0)
    return int(np.sum((r > 150) & (g < 110) & (b < 110)))


def run(code, *arguments, **environment):
    source = str(Path(deggflow.__path__[0]).parent)
    paths = os.pathsep.join([source, os.environ.get("PYTHONPATH", "")])
    environment = {**os.environ, "PYTHONPATH": paths, **environment}
    return subprocess.run(
        [sys.executable, "-c", code, *arguments], env=environment, capture_output=True, text=True
    )


@needs_gl
@pytest.mark.parametrize("camera", ["studio", "top"])
def test_a_blocked_scene_has_red_pixels_and_a_free_one_has_none(trio, trio_blocked, camera):
    free = render(*trio, **SIZE, camera=camera, renderer="mujoco")
    blocked = render(*trio_blocked, **SIZE, camera=camera, renderer="mujoco")
    assert free.shape == blocked.shape == (240, 320, 3)
    assert free.dtype == np.uint8
    assert red(blocked) > 300
    assert red(free) < 10


@needs_gl
def test_the_same_scene_gives_the_same_picture(trio):
    np.testing.assert_array_equal(render(*trio, **SIZE), render(*trio, **SIZE))


@needs_gl
@pytest.mark.parametrize("size", [(200, 300), (301, 201)])
def test_any_shape_of_picture_holds_the_table(trio, size):
    image = render(*trio, width=size[0], height=size[1])
    assert image.shape == (size[1], size[0], 3)
    background = np.all(image[: size[1] // 2] > 250, axis=-1)
    assert background[:, 0].all()
    assert background[:, -1].all()


def test_the_drawn_view_is_red_where_something_is_wrong(trio, trio_blocked):
    free = render(*trio, **SIZE, renderer="matplotlib")
    blocked = render(*trio_blocked, **SIZE, renderer="matplotlib")
    assert free.shape == blocked.shape == (240, 320, 3)
    assert red(blocked) > red(free) + 100


def test_without_opengl_a_top_view_is_drawn_and_announced_in_one_line():
    done = run(TWO_PICTURES, "auto", MUJOCO_GL="unusable")
    assert done.returncode == 0, done.stderr
    assert done.stdout.split("\n")[:2] == ["(120, 160, 3)"] * 2
    lines = done.stderr.strip().splitlines()
    assert len(lines) == 1, done.stderr
    assert "top view" in lines[0]
    assert "unusable" in lines[0]


def test_asking_for_mujoco_without_opengl_is_an_error():
    done = run(TWO_PICTURES, "mujoco", MUJOCO_GL="disable")
    assert done.returncode == 1
    assert "RuntimeError: MuJoCo cannot render here: MUJOCO_GL=disable" in done.stderr


def test_importing_the_room_imports_neither_mujoco_nor_matplotlib():
    code = (
        "import sys, deggflow.view; assert 'jax' not in sys.modules\n"
        "import deggflow.view.mjcf, deggflow.view.picture, deggflow.view.video\n"
        "heavy = {'mujoco', 'matplotlib', 'imageio_ffmpeg'} & set(sys.modules)\n"
        "assert not heavy, heavy"
    )
    done = run(code)
    assert done.returncode == 0, done.stderr


def test_side_by_side_holds_both_pictures_titles_and_captions():
    left, right = np.full((240, 320, 3), 40, np.uint8), np.full((240, 320, 3), 200, np.uint8)
    long = "affordance region 1 of drawer_organizer reaches 0.0537 m over the edge (and 7 more)"
    plain = map_blocks(left, right)
    told = map_blocks(left, right, captions=(long, "every requirement holds"))
    assert np.sum(np.all(plain == 40, axis=-1)) > 0.9 * 240 * 320
    assert np.sum(np.all(plain == 200, axis=-1)) > 0.9 * 240 * 320
    assert told.shape[0] > plain.shape[0]
    assert plain[:20].min() < 100  # titles
    below = np.any(told[-15:] < 150, axis=(0, 2)).nonzero()[0]  # columns with letters in them
    assert below.min() >= 4  # even a long caption stays below its picture
    gap = told.shape[1] // 2
    assert not np.any((below > gap - 3) & (below < gap + 3))


def test_pictures_of_different_heights_do_not_stand_in_a_row():
    with pytest.raises(ValueError, match="height"):
        panels([np.zeros((8, 8, 3), np.uint8), np.zeros((9, 8, 3), np.uint8)], titles=("a", "b"))


def test_a_saved_picture_can_be_read(tmp_path):
    image = np.random.default_rng(0).integers(0, 255, (30, 40, 3), np.uint8)
    save_png(tmp_path / "new" / "scene.png", image)
    np.testing.assert_array_equal(iio.imread(tmp_path / "new" / "scene.png"), image)
    assert [p.name for p in (tmp_path / "new").iterdir()] == ["scene.png"]
