"""A path for every robot out of its candidates, with few conflicts: by priority, then by best responses."""

import numpy as np
from jaxtyping import Float, Int

NEAR = 0.14  # map units, centres nearer than this are in conflict
CONFLICT = 4.0  # cost of two centres at the same place at one waypoint
RESTARTS, SWEEPS = 4, 5


def conflicts(
    paths: Float[np.ndarray, "robots candidates 64 2"],
) -> Float[np.ndarray, "robots candidates robots candidates"]:
    """Cost of the conflict of any two candidates; zero between those of one robot."""
    robots, count, waypoints, _ = paths.shape
    flat = paths.reshape(robots * count, waypoints, 2).astype(np.float32).transpose(1, 0, 2)
    square = np.sum(flat**2, axis=-1)
    cost = np.zeros((robots * count, robots * count), np.float32)
    for now, norm in zip(flat, square, strict=True):
        near = norm[:, None] + norm[None] - 2 * now @ now.T
        cost += np.maximum(1 - near / NEAR**2, 0.0)
    table = CONFLICT * cost.reshape(robots, count, robots, count)
    table[np.arange(robots), :, np.arange(robots)] = 0.0
    return table


def choose(
    paths: Float[np.ndarray, "robots candidates 64 2"],
    cost: Float[np.ndarray, "robots candidates"],
    rng: np.random.Generator,
) -> Int[np.ndarray, " robots"]:
    """The candidate of each robot.

    Args:
        paths: Candidates, in map units.
        cost: What each costs without the others.
        rng: Draws the orders in which robots choose.
    """
    table, robots = conflicts(paths), np.arange(len(paths))
    best, least = cost.argmin(1), np.inf
    for _ in range(RESTARTS):
        chosen, placed = np.zeros(len(paths), int), np.zeros(len(paths), bool)
        for robot in rng.permutation(len(paths)):
            others = robots[placed]
            chosen[robot] = np.argmin(cost[robot] + table[robot][:, others, chosen[others]].sum(-1))
            placed[robot] = True
        for _ in range(SWEEPS):
            before = chosen.copy()
            for robot in robots:
                chosen[robot] = np.argmin(cost[robot] + table[robot][:, robots, chosen].sum(-1))
            if np.array_equal(before, chosen):
                break
        pairs = table[robots[:, None], chosen[:, None], robots[None], chosen[None]].sum() / 2
        total = cost[robots, chosen].sum() + pairs
        if total < least:
            best, least = chosen.copy(), total
    return best


def least_distance(paths: Float[np.ndarray, "robots 64 2"]) -> float:
    """Least distance of two centres at any time, waypoints joined by straight lines; infinite for one robot."""
    first, second = np.triu_indices(len(paths), 1)
    gap = paths[first] - paths[second]
    move = np.diff(gap, axis=1)
    square = np.maximum(np.sum(move**2, axis=-1), 1e-12)
    share = np.clip(-np.sum(gap[:, :-1] * move, axis=-1) / square, 0.0, 1.0)
    nearest = gap[:, :-1] + share[..., None] * move
    return float(np.min(np.linalg.norm(nearest, axis=-1), initial=np.inf))
