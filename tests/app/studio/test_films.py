"""Videos for pages: drawn by a process of their own, followed, and stopped when nobody waits for them."""

import subprocess

import pytest
from imageio_ffmpeg import count_frames_and_secs

from deggflow.jsonl import InputError
from deggflow.studio.desk import ClosedError
from deggflow.studio.filming import draw
from deggflow.studio.films import FilmDesk

CONDITION = {"objects": ["laptop"]}
POSES = [[0.0, 0.0, 0.0]]
SCENE = {
    "condition": CONDITION,
    "tau": [0.0, 1.0],
    "nominal": [POSES, POSES],
    "guided": [POSES, [[0.2, 0.1, 0.5]]],
}


@pytest.fixture
def films():
    return FilmDesk()


@pytest.fixture
def started(monkeypatch):
    """Processes that were started."""
    begin, processes = subprocess.Popen, []

    def recorded(command, *arguments, **options):
        processes.append(begin(command, *arguments, **options))
        return processes[-1]

    monkeypatch.setattr(subprocess, "Popen", recorded)
    return processes


def test_a_generation_is_drawn(tmp_path):
    path, told = tmp_path / "scene.mp4", []
    draw("scene", SCENE, path, lambda *now: told.append(now))
    assert told == [(1, 2), (2, 2)]
    assert count_frames_and_secs(str(path))[0] == 2 + 25  # the last one stays for a second


def test_a_page_that_closes_stops_its_video(films, started):
    """It has been told of the first pictures; then its process is gone, and the next video is not kept waiting."""
    told = []

    def check():
        if told:
            raise ClosedError

    long = {**SCENE, "tau": [k / 499 for k in range(500)]}
    long.update(nominal=[POSES] * 500, guided=[POSES] * 500)
    with pytest.raises(ClosedError):
        films.answer("scene", long, check, told.append)
    assert told[0]["frames"] == 500
    (process,) = started
    assert process.returncode not in (None, 0)
    assert films._filming.acquire(blocking=False)


def test_who_waits_for_another_video_can_leave(films):
    films._filming.acquire()

    def check():
        raise ClosedError

    with pytest.raises(ClosedError):
        films.answer("scene", SCENE, check)


@pytest.mark.parametrize(
    ("what", "fields", "error"),
    [
        ("scene", {**SCENE, "tau": [0.0]}, "field `tau`: must hold 2 to 500 times; got 1"),
        ("scene", {**SCENE, "tau": ["a", 1.0]}, r"field `tau\[0\]`"),
        ("scene", {**SCENE, "nominal": [POSES]}, "field `nominal`: must hold 2 pictures; got 1"),
        ("scene", {**SCENE, "guided": [POSES, [[0, 0]]]}, "must hold x, y and theta"),
        ("trial", {"line": "{}"}, "is missing"),
        ("fleet", {}, "field `ask`: must be one of scene, trial"),
    ],
)
def test_what_a_page_asks_is_checked(films, what, fields, error):
    with pytest.raises(InputError, match=error):
        films.answer(what, fields, lambda: None)
