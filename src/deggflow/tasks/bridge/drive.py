"""Driving before and after the bridge is built: to the contact points, and over the plank to the goals.

Source: paper, Task 1, first and third stage of a complete process. Robots drive straight between ticks.
"""

import numpy as np
from jaxtyping import Float

from .ground import LEFT, Clear, Pose, around_plank, over_bridge, placed, plank_distance
from .planner import NoWayError, plan
from .roadmap import PITCH, Lattice, lines, links, make_lattice, make_roadmap
from .straighten import straighten
from .verdict import bridges, robot_centres
from .world import (
    CENTRE_SIDE,
    GAP_LEFT,
    GAP_RIGHT,
    PLANK_LENGTH,
    PLANK_WIDTH,
    ROBOT_GOALS_MIN,
    ROBOT_RADIUS,
    X_MAX,
    Y_MAX,
    Y_MIN,
)

__all__ = ["NoWayError", "approach", "contact_centres", "cross", "random_goals", "random_starts"]

BESIDE = 0.075  # m from touching the plank to the nearest points of the roadmap
SWITCH = 0.05  # m that a disk is off the gap where robots join and leave the plank's centre line
EDGE = 0.1  # m from disks at random starts and goals to the workspace's boundary and to the gap
GOALS_APART = 0.25  # m between disks at random goals
# m from disks at random starts to each other and to the plank, the first that has room; at 0.36 m another
# robot fits in between, so that no robot blocks another.
STARTS_APART = (0.36, 0.15, 0.05)
TRIES = 512  # random points drawn at once

Centres = Float[np.ndarray, "robots 2"]
Drive = Float[np.ndarray, "ticks robots 2"]


def contact_centres(plank: Pose, contacts: Centres) -> Centres:
    """Centres of robots that touch the plank at their contact points (m)."""
    return placed(plank, robot_centres(contacts.tolist()))


def _beside_plank(plank: Pose) -> tuple[Lattice, Clear]:
    """The left ground with the plank as an obstacle; rows and columns are parallel to the plank."""
    clear = around_plank(plank)
    end = (PLANK_LENGTH - PLANK_WIDTH) / 2 + CENTRE_SIDE + BESIDE
    pitch = 2 * end / np.ceil(2 * end / PITCH)
    # 2 (CENTRE_SIDE + BESIDE) is 7 PITCH: rows lie alike on both sides.
    columns, rows = lines(pitch, end), lines(PITCH, CENTRE_SIDE + BESIDE)
    return make_lattice(plank, columns, rows, clear), clear


def random_starts(plank: Pose, contacts: Centres, rng: np.random.Generator) -> Centres:
    """Random places on the left ground from which every robot can reach its contact point.

    Raises:
        NoWayError: There is no room for a robot.
    """
    lattice, clear = _beside_plank(plank)
    robots = len(contacts)
    point, to = links(contact_centres(plank, contacts), lattice, clear)
    part = np.full(robots, -2)
    part[point] = lattice.component[to]
    for free in STARTS_APART:
        samples = rng.uniform(LEFT[0] + EDGE, LEFT[1] - EDGE, (TRIES, 2))
        samples = samples[plank_distance(plank, samples) >= ROBOT_RADIUS + free]
        point, to = links(samples, lattice, clear)
        where = np.full(len(samples), -1)
        where[point] = lattice.component[to]
        starts = np.full((robots, 2), np.inf)
        for robot in range(robots):
            apart = np.linalg.norm(samples[:, None] - starts[None], axis=-1).min(-1)
            fits = (where == part[robot]) & (apart >= 2 * ROBOT_RADIUS + free)
            if not fits.any():
                break
            starts[robot] = samples[np.argmax(fits)]
        if np.isfinite(starts).all():
            return starts
    raise NoWayError(f"robot {robot + 1} has no room from which it could reach its contact point")


def random_goals(robots: int, rng: np.random.Generator) -> Centres:
    """Random places for robots on the right ground."""
    low = np.array([ROBOT_GOALS_MIN, Y_MIN + ROBOT_RADIUS + EDGE])
    high = np.array([X_MAX, Y_MAX]) - ROBOT_RADIUS - EDGE
    while True:
        goals = np.empty((0, 2))
        for sample in rng.uniform(low, high, (TRIES, 2)):
            apart = np.linalg.norm(goals - sample, axis=-1)
            if np.all(apart >= 2 * ROBOT_RADIUS + GOALS_APART):
                goals = np.concatenate([goals, sample[None]])
            if len(goals) == robots:
                return goals


def approach(starts: Centres, plank: Pose, contacts: Centres, *, seed: int = 0) -> Drive:
    """Robots drive around the plank and each other to their contact points.

    Args:
        starts: Centres at the beginning (m), on the left ground.
        plank: Pose of the plank, which lies still.
        contacts: Contact points in the plank's frame (m).
        seed: Of the orders in which the robots are planned when the first ones fail.

    Returns:
        Centres at every tick, from `starts` to the contact points; robots that have arrived wait.

    Raises:
        NoWayError: A robot finds no way.
    """
    lattice, clear = _beside_plank(plank)
    return _drive(lattice, clear, starts, contact_centres(plank, contacts), seed)


def cross(plank: Pose, contacts: Centres, goals: Centres, *, seed: int = 0) -> Drive:
    """Robots drive from their contact points over the plank, one behind the other, to their goals.

    The plank is thin: where it lies on the ground robots climb it from any side.

    Args:
        plank: Pose of the plank, which bridges the gap.
        contacts: Contact points in the plank's frame (m).
        goals: Centres at the end (m).
        seed: Of the orders in which the robots are planned when the first ones fail.

    Returns:
        Centres at every tick, from the contact points to `goals`; robots that have arrived wait.

    Raises:
        NoWayError: The plank does not bridge the gap, or a robot finds no way.
    """
    if not bridges(plank[None])[0]:
        raise NoWayError("robot 1 cannot cross: the plank does not bridge the gap")
    slope = np.tan(plank[2])
    left, right = GAP_LEFT - ROBOT_RADIUS - SWITCH, GAP_RIGHT + ROBOT_RADIUS + SWITCH
    line = np.array([left, plank[1] + slope * (left - plank[0]), np.arctan(slope)])
    length = float((right - left) / np.cos(line[2]))
    clear = over_bridge(line, length)
    columns, rows = lines(length / np.ceil(length / PITCH), 0.0), lines(PITCH, 0.0)
    lattice = make_lattice(line, columns, rows, clear)
    return _drive(lattice, clear, contact_centres(plank, contacts), goals, seed)


def _drive(lattice: Lattice, clear: Clear, starts: Centres, goals: Centres, seed: int) -> Drive:
    roadmap, ends = make_roadmap(lattice, starts, goals, clear)
    ways, clearance = plan(roadmap, ends, seed)
    ways = straighten(ways, clear, clearance)
    count = max(int(way.ticks[-1]) for way in ways) + 1
    return np.stack([way.at_ticks(count) for way in ways], axis=1)
