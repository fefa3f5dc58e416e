"""Pictures: the right shape, red where something is wrong, a drawn view where OpenGL is missing."""

import os
import subprocess
import sys
from pathlib import Path

import numpy as np
import pytest

import deggflow
from deggflow.view.stage import gl_problem
from deggflow.view.tabletop import render

needs_gl = pytest.mark.skipif(gl_problem() is not None, reason="no OpenGL here")
SIZE = {"width": 320, "height": 240}

TWO_PICTURES = """
import sys
import numpy as np
from deggflow.tasks.tabletop.condition import SceneCondition
from deggflow.view.tabletop import render
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


def test_importing_the_pictures_imports_neither_mujoco_nor_matplotlib():
    code = (
        "import sys, deggflow.view; assert 'jax' not in sys.modules\n"
        "import deggflow.view.tabletop\n"
        "heavy = {'mujoco', 'matplotlib', 'imageio_ffmpeg'} & set(sys.modules)\n"
        "assert not heavy, heavy"
    )
    done = run(code)
    assert done.returncode == 0, done.stderr
