"""Short ways around obstacles at an even pace, which robots may begin with instead of one of the field's paths."""

from collections.abc import Iterator, Sequence
from functools import cache
from typing import NamedTuple

import numpy as np
from jaxtyping import Float, Int

from deggflow.blocks import map_groups

from .condition import FleetCondition
from .paths import WAYPOINTS
from .planner import roadmap
from .roadmap import Roadmap
from .ways import FINE, Ways, evenly, rounded, timed_points

BOW = 0.8  # largest height of a bow over half of its chord
_ROBOTS_AT_ONCE = 64  # robots whose ways are looked for at once; more no longer fit a core's cache


class Search(NamedTuple):
    """Whose ways are looked for.

    Attributes:
        condition: The problem.
        robots: Numbers of robots.
        rng: Draws weights of moves, and heights of bows.
    """

    condition: FleetCondition
    robots: Int[np.ndarray, " robots"]
    rng: np.random.Generator


class _Job(NamedTuple):
    """A search with what was drawn for it."""

    roads: Roadmap
    ends: Float[np.ndarray, "2 robots 2"]
    variants: Int[np.ndarray, "robots each"]
    bows: Float[np.ndarray, " ways"] | None


def routes(searches: Sequence[Search], count: int) -> list[Float[np.ndarray, "count _robots 64 2"]]:
    """Short ways of the robots of each search around the obstacles, without a view to other robots."""
    jobs = [_job(search, count) for search in searches]

    def of_group(group: list[int]) -> list[Float[np.ndarray, "count _robots 64 2"]]:
        paths = _paths([jobs[k] for k in group])
        ends = np.cumsum([jobs[k].variants.size for k in group])
        parts = np.split(paths, ends[:-1])
        return [part.reshape(-1, count, WAYPOINTS, 2).swapaxes(0, 1) for part in parts]

    return map_groups(of_group, [*_job_groups(jobs)], len(jobs))


def _job(search: Search, count: int) -> _Job:
    condition, robots, rng = search.condition, search.robots, search.rng
    roads = roadmap(condition, rng)
    variants = rng.integers(len(roads.length), size=(len(robots), count))
    bows = None if condition.floor.obstacles else rng.uniform(0.0, BOW, variants.size)
    ends = np.stack([condition.starts, condition.goals])[:, robots]
    return _Job(roads, ends, variants, bows)


def _job_groups(jobs: Sequence[_Job]) -> Iterator[list[int]]:
    """Numbers of jobs on the same roadmap, few robots at once."""
    groups: dict[int, list[int]] = {}
    for k, job in enumerate(jobs):
        group = groups.setdefault(id(job.roads), [])
        if (
            group
            and sum(len(jobs[j].variants) for j in group) + len(job.variants) > _ROBOTS_AT_ONCE
        ):
            yield group
            group = groups[id(job.roads)] = []
        group.append(k)
    yield from groups.values()


def _paths(jobs: Sequence[_Job]) -> Float[np.ndarray, "ways 64 2"]:
    ends = np.concatenate([job.ends for job in jobs], axis=1)
    ways = jobs[0].roads.ways(ends, np.concatenate([job.variants for job in jobs]))
    if jobs[0].bows is not None:
        ways = _bows(ways, np.concatenate([job.bows for job in jobs if job.bows is not None]))
    points, _ = evenly(ways)
    return _at_even_pace() @ points


def _bows(ways: Ways, height: Float[np.ndarray, " ways"]) -> Ways:
    """Ways to the right of straight lines, by a share of half their lengths: who meets keeps to the right."""
    t = np.linspace(0.0, 1.0, 33)[:, None]
    start, goal = ways.corners[:, :1], ways.corners[:, 1:]
    right = (goal - start)[..., ::-1] * np.array([1, -1])
    corners = (1 - t) * start + t * goal
    corners = corners + height[:, None, None] / 2 * np.sin(np.pi * t) * right
    return Ways(corners, np.full(len(corners), len(t)))


@cache
def _at_even_pace() -> Float[np.ndarray, "64 fine"]:
    """The linear map from points of a way to its path: corners are rounded, then all steps are equally long."""
    points = np.stack([np.eye(FINE)] * 2, axis=-1)
    progress = np.tile(np.linspace(0.0, 1.0, WAYPOINTS), (FINE, 1))
    return timed_points(rounded(points), progress)[..., 0].T.copy()
