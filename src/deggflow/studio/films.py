"""Videos for pages, each drawn by a process of its own (`filming`): other answers don't wait for its pictures."""

import json
import os
import subprocess
import sys
import tempfile
from contextlib import suppress
from dataclasses import dataclass
from pathlib import Path
from threading import Lock
from typing import IO, Any, cast

from deggflow.jsonl import InputError, expect_list, expect_number, parse_line
from deggflow.tasks.bridge.formats import parse_trial
from deggflow.tasks.tabletop.verdict import Poses

from .desk import Answers, Asker, TaskDesk
from .messages import Export
from .tabletop_messages import parse_poses, studio_condition

MAX_FRAMES = 500  # of a scene's generation
POLL = 0.1  # s between looks at the process
VIDEO, PROGRESS = "film.mp4", "progress.json"  # files that the process writes


@dataclass(frozen=True)
class FilmScene:
    """A video of a generation is asked for, nominal beside guided.

    Attributes:
        condition: As in a file.
        tau: Generative time of each picture.
        nominal: Poses at each of them.
        guided: Poses at each of them.
    """

    condition: Any
    tau: Any
    nominal: Any
    guided: Any

    def checked(self) -> tuple[Any, list[Poses], list[Poses]]:
        """Condition, nominal and guided poses.

        Raises:
            InputError: Something is wrong; names the field.
        """
        condition = studio_condition(self.condition)
        frames = len(expect_list(self.tau, "tau"))
        if not 2 <= frames <= MAX_FRAMES:
            raise InputError(f"must hold 2 to {MAX_FRAMES} times; got {frames}", field="tau")
        for k, tau in enumerate(self.tau):
            expect_number(tau, f"tau[{k}]", 0.0, 1.0, "")
        ways = []
        for name, way in (("nominal", self.nominal), ("guided", self.guided)):
            if len(expect_list(way, name)) != frames:
                raise InputError(f"must hold {frames} pictures; got {len(way)}", field=name)
            ways.append([parse_poses(poses, condition) for poses in way])
        return condition, ways[0], ways[1]


@dataclass(frozen=True)
class FilmTrial:
    """A video of the building of a bridge is asked for.

    Attributes:
        line: A trial as it stands in a file.
    """

    line: str


class FilmDesk(TaskDesk):
    """Makes videos, one at a time; pages that close stop theirs."""

    def __init__(self) -> None:
        self._filming = Lock()

    def answers(self) -> Answers:
        """A video of a scene, or of a trial."""
        return {"scene": (FilmScene, self._scene), "trial": (FilmTrial, self._trial)}

    def warm_up(self) -> None:
        """Nothing is kept."""

    def _scene(self, request: FilmScene, asker: Asker) -> dict[str, Any]:
        request.checked()
        return self._film("scene", vars(request), asker)

    def _trial(self, request: FilmTrial, asker: Asker) -> dict[str, Any]:
        parse_trial(parse_line(request.line.encode("utf-8", "surrogatepass")))
        return self._film("trial", vars(request), asker)

    def _film(self, what: str, fields: dict[str, Any], asker: Asker) -> dict[str, Any]:
        while not self._filming.acquire(timeout=POLL):
            asker.check()
        try:
            with tempfile.TemporaryDirectory(
                prefix="deggflow-film-", ignore_cleanup_errors=True
            ) as folder:
                content = _filmed(Path(folder), {"what": what, **fields}, asker)
            return Export(f"{what}.mp4", "video/mp4", content).to_json()
        finally:
            self._filming.release()


def _filmed(folder: Path, job: dict[str, Any], asker: Asker) -> bytes:
    """The video that a process draws; it is killed if the page is closed."""
    complaints = folder / "complaints.txt"
    command = [sys.executable, "-m", "deggflow.studio.filming", str(folder)]
    with complaints.open("wb") as sink:
        alone = {**os.environ, "JAX_PLATFORMS": "cpu"}  # a GPU's memory is the studio's
        process = subprocess.Popen(command, stdin=subprocess.PIPE, stderr=sink, env=alone)
    with cast(IO[bytes], process.stdin) as pipe:
        try:
            with suppress(BrokenPipeError):  # a process that ended at once has said why
                pipe.write(json.dumps(job).encode() + b"\n")
                pipe.flush()
            _follow(process, folder / PROGRESS, asker)
        finally:
            process.kill()
            process.wait()
    if process.returncode:
        said = complaints.read_text(errors="replace").strip().splitlines()
        raise RuntimeError(said[-1] if said else "the video was not finished")
    return (folder / VIDEO).read_bytes()


def _follow(process: "subprocess.Popen[bytes]", progress: Path, asker: Asker) -> None:
    """Tells the page of each picture until the process ends."""
    told = None
    while True:
        try:
            process.wait(POLL)
            return
        except subprocess.TimeoutExpired:
            asker.check()
        if progress.exists() and (now := progress.read_text()) != told:
            told = now
            frame, frames = json.loads(now)
            asker.tell({"frame": frame, "frames": frames})
