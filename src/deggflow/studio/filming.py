"""The process that draws a video: `python -m deggflow.studio.filming FOLDER`.

It draws what the line on its standard input says into the folder, and ends when that input is closed, as it is when
the studio ends.
"""

import json
import os
import sys
import threading
from collections.abc import Callable
from contextlib import suppress
from pathlib import Path
from typing import Any

from deggflow.files import write_atomically
from deggflow.jsonl import parse_line
from deggflow.schema import parse_as
from deggflow.tasks.bridge.formats import parse_trial
from deggflow.view.bridge import write_process_video
from deggflow.view.tabletop import write_video

from .bridge_exports import building
from .films import PROGRESS, VIDEO, FilmScene

NICENESS = 10  # pages come first
BRIDGE_SIZE = 640, 360  # pixels


def draw(
    what: str, fields: dict[str, Any], path: Path, on_frame: Callable[[int, int], None]
) -> None:
    """Draws a scene's generation or a trial.

    Args:
        what: "scene" or "trial".
        fields: Of the message that asks for it.
        path: Of the video.
        on_frame: Told how many pictures are drawn, and of how many.
    """
    if what == "scene":
        asked = parse_as(FilmScene, fields)
        condition, nominal, guided = asked.checked()
        write_video(path, condition, guided, left_poses=nominal, taus=asked.tau, on_frame=on_frame)
    else:
        process = building(parse_trial(parse_line(fields["line"].encode())))
        width, height = BRIDGE_SIZE
        write_process_video(path, process, width=width, height=height, on_frame=on_frame)


def main(folder: Path) -> None:
    """Draws what a line on standard input says."""
    with suppress(AttributeError, OSError):  # not on Windows
        os.nice(NICENESS)
    job = json.loads(sys.stdin.buffer.readline())
    threading.Thread(target=_end_with_the_studio, daemon=True).start()

    def on_frame(*now: int) -> None:
        write_atomically(folder / PROGRESS, json.dumps(now))

    draw(job.pop("what"), job, folder / VIDEO, on_frame)


def _end_with_the_studio() -> None:
    while os.read(
        sys.stdin.fileno(), 1024
    ):  # unbuffered: the interpreter's end takes the buffer's lock
        pass
    os._exit(1)


if __name__ == "__main__":
    main(Path(sys.argv[1]))
