"""Videos: they open, have the frames they should, and a failure leaves the old file."""

import os
import subprocess
import sys

import numpy as np
import pytest

from deggflow.view.stage import gl_problem
from deggflow.view.tabletop import write_video

RENDERER = "matplotlib" if gl_problem() else "mujoco"
SMALL = {"width": 160, "height": 120, "renderer": RENDERER}

# In a process of its own, as imageio's reader forks, against which JAX warns.
READ = """
import sys
import imageio.v3 as iio
frames = iio.imread(sys.argv[1], plugin="FFMPEG")
print(*frames.shape)
for frame in (frames[0], frames[-1]):
    r, g, b = (frame[..., i].astype(int) for i in range(3))
    print(((r > 150) & (g < 110) & (b < 110)).sum())
"""


def read(path):
    """Shape of all frames, and red pixels of the first and the last frame."""
    done = subprocess.run(
        [sys.executable, "-c", READ, str(path)], check=True, capture_output=True, text=True
    )
    shape, first, last = done.stdout.strip().splitlines()
    return tuple(int(n) for n in shape.split()), int(first), int(last)


def between(start, end, count):
    return [start + (end - start) * k / (count - 1) for k in range(count)]


def test_a_video_has_its_frames_a_second_more_and_turns_from_red_to_green(
    trio, trio_blocked, tmp_path
):
    path = tmp_path / "new" / "scene.mp4"
    frames = between(trio_blocked[1], trio[1], 7)
    write_video(path, trio[0], frames, fps=5, **SMALL)
    (count, height, width, _), first, last = read(path)
    assert (count, width) == (7 + 5, 160)
    assert height >= 120
    assert first > 50
    assert last < first / 10
    assert os.listdir(path.parent) == ["scene.mp4"]


def test_two_generations_stand_beside_each_other_in_even_size(trio, trio_blocked, tmp_path):
    path = tmp_path / "pair.mp4"
    frames = between(trio_blocked[1], trio[1], 3)
    left = [trio_blocked[1]] * 3
    size = {**SMALL, "width": 161, "height": 121}
    write_video(path, trio[0], frames, left_poses=left, taus=[0.0, 0.75, 1.0], fps=4, **size)
    (count, height, width, _), _, last = read(path)
    assert count == 3 + 4
    assert width >= 2 * 161
    assert width % 2 == height % 2 == 0
    assert last > 50  # the left one is still blocked


def test_a_failure_leaves_the_old_file_alone(trio, tmp_path):
    path = tmp_path / "scene.mp4"
    path.write_bytes(b"old")
    with pytest.raises(ValueError, match="finite"):
        write_video(path, trio[0], [trio[1], np.full((3, 3), np.nan)], **SMALL)
    assert path.read_bytes() == b"old"
    assert os.listdir(tmp_path) == ["scene.mp4"]


IN_THE_BACKGROUND = """
import os, signal
import numpy as np
from deggflow.view.video import write_frames

def frames():
    for k in range(20):
        if k == 10:
            os.killpg(0, signal.SIGINT)
        yield np.full((240, 320, 3), k, np.uint8)  # more than a pipe holds: the encoder runs by now

signal.signal(signal.SIGINT, signal.SIG_IGN)
write_frames("film.mp4", frames(), 10)
"""


def test_ctrl_c_ends_no_video_of_a_command_that_ignores_it(tmp_path):
    """As commands in the background of a shell do; the encoder would not, and it gets what the terminal sends, too."""
    command = [sys.executable, "-c", IN_THE_BACKGROUND]
    ended = subprocess.run(
        command, cwd=tmp_path, capture_output=True, text=True, start_new_session=True
    )
    assert ended.returncode == 0, ended.stderr
    assert os.listdir(tmp_path) == ["film.mp4"]


@pytest.mark.parametrize(
    ("frames", "more"), [(0, {}), (2, {"taus": [0.0]}), (2, {"left_poses": [np.zeros((3, 3))]})]
)
def test_sequences_must_match(trio, tmp_path, frames, more):
    with pytest.raises(ValueError, match="frame"):
        write_video(tmp_path / "scene.mp4", trio[0], [trio[1]] * frames, **more, **SMALL)
    assert not list(tmp_path.iterdir())
