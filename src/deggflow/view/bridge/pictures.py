"""Pictures of a process: one moment, the stages below each other, nominal beside guided."""

from collections.abc import Sequence
from contextlib import closing

import numpy as np
from jaxtyping import UInt8

from deggflow.tasks.bridge.process import TICK, Process
from deggflow.tasks.bridge.world import GAP_LEFT, GAP_RIGHT
from deggflow.view.picture import GREY, Ink, panels
from deggflow.view.stage import Camera, RendererName, Shot

from .moment import moment_of
from .stage import bridge_stage

FAULT_INK: Ink = (190, 30, 25)

TITLES = ("nominal", "guided")


def picture(
    process: Process,
    tick: int,
    *,
    width: int = 1280,
    height: int = 720,
    camera: Camera = "studio",
    renderer: RendererName = "auto",
) -> UInt8[np.ndarray, "height width 3"]:
    """A picture of one moment.

    Args:
        process: The process.
        tick: Counted from 0; a negative one from the end.
        width: Of the picture, pixels.
        height: Of the picture, pixels.
        camera: "studio" (slanted) or "top"; MuJoCo only.
        renderer: "mujoco", "matplotlib" (a top view), or "auto": MuJoCo where OpenGL can be used.
    """
    return _pictures(process, [tick], Shot(width, height, camera, renderer))[0]


def snapshots(
    process: Process,
    ticks: Sequence[int] | None = None,
    *,
    width: int = 1280,
    height: int = 640,
    camera: Camera = "studio",
    renderer: RendererName = "auto",
) -> UInt8[np.ndarray, "rows columns 3"]:
    """Pictures of several moments below each other, as in the paper (fig:task1_rollout).

    Args:
        process: The process.
        ticks: The moments; if not given, the initial one, the end of building, and robots on the
            bridge, or the end of a crossing that failed. Stages that the process has not are left out.
        width: Of each picture, pixels.
        height: Of each picture, pixels.
        camera: As in `picture`.
        renderer: As in `picture`.

    Raises:
        ValueError: If there is nothing to show.
    """
    moments = telling_ticks(process) if ticks is None else ticks
    if len(moments) == 0:
        raise ValueError("`ticks` must name at least one moment; got none.")
    images = _pictures(process, moments, Shot(width, height, camera, renderer))
    gap = np.full((max(height // 60, 2), width, 3), 255, np.uint8)
    return np.concatenate([part for image in images for part in (gap, image)][1:])


def compare(
    left: Process,
    right: Process,
    *,
    titles: tuple[str, str] = TITLES,
    captions: tuple[str, str] | None = None,
    width: int = 960,
    height: int = 540,
    camera: Camera = "studio",
    renderer: RendererName = "auto",
) -> UInt8[np.ndarray, "rows columns 3"]:
    """The end of building of two processes beside each other, as in the paper (fig:task1_rescue).

    Args:
        left: The nominal process.
        right: The guided one from the same start.
        titles: Above the pictures.
        captions: Below the pictures; how building ended, if not given.
        width: Of each picture, pixels.
        height: Of each picture, pixels.
        camera: As in `picture`.
        renderer: As in `picture`.
    """
    sides = (left, right)
    ends = [last_of_building(process) for process in sides]
    shot = Shot(width, height, camera, renderer)
    images = [_pictures(process, [end], shot)[0] for process, end in zip(sides, ends, strict=True)]
    outcomes = [_outcome(process, end) for process, end in zip(sides, ends, strict=True)]
    inks = [
        FAULT_INK if _failed_at(process, end) else GREY
        for process, end in zip(sides, ends, strict=True)
    ]
    return panels(images, titles=titles, captions=captions or outcomes, inks=inks)


def last_of_building(process: Process) -> int:
    """The last tick before robots cross; the last of all, if the process ended before."""
    ticks = [tick for tick, stage in enumerate(process.stage) if stage != "cross"]
    return ticks[-1] if ticks else len(process.stage) - 1


def telling_ticks(process: Process) -> list[int]:
    """The initial tick, the end of building, and one of crossing, as far as there are such."""
    crossing = [tick for tick, stage in enumerate(process.stage) if stage == "cross"]
    ticks = [0, last_of_building(process)]
    if crossing and process.failure is not None:
        ticks.append(crossing[-1])
    elif crossing:
        x = process.robots[crossing, :, 0]
        over_gap = ((x > GAP_LEFT) & (x < GAP_RIGHT)).sum(axis=-1)
        busiest = np.flatnonzero(over_gap == over_gap.max())
        middle = (len(crossing) - 1) / 2
        ticks.append(crossing[int(min(busiest, key=lambda at: abs(at - middle)))])
    return sorted(set(ticks))


def _failed_at(process: Process, tick: int) -> bool:
    return process.failure is not None and tick == len(process.stage) - 1


def _outcome(process: Process, tick: int) -> str:
    if process.failure is not None and _failed_at(process, tick):
        return process.failure
    return f"bridge built in {process.stage.count('build') * TICK:.1f} s"


def _pictures(
    process: Process, ticks: Sequence[int], shot: Shot
) -> list[UInt8[np.ndarray, "height width 3"]]:
    with closing(bridge_stage(process, shot)) as stage:
        return [stage.picture(moment_of(process, tick)) for tick in ticks]
