"""Randomly drawn conditions."""

import numpy as np

from deggflow.jsonl import InputError

from .condition import SPEED_LIMIT, FleetCondition, Robot
from .maps import NAMED, SPEED_LIMITS, FloorMap, random_map
from .options import MapName, Scheme
from .schemes import OWN, Points, most_of_own, own_scheme, random_scheme


def random_conditions(
    size: int,
    count: int,
    name: MapName,
    scheme: Scheme,
    seed: int,
    first: int = 0,
    own_floor: FloorMap | None = None,
) -> list[FleetCondition]:
    """Conditions number `first` to `first + count - 1` of a seed; each depends on its own number alone.

    Args:
        size: Number of robots.
        count: How many.
        name: A named map, "random", or "any" of the named ones.
        scheme: MMD's own starts and goals of a map, or random ones.
        seed: Of the draws.
        first: Number of the first one.
        own_floor: The floor of all of them, instead of a map with a name.
    """
    if scheme == "own" and name in OWN and size > (most := most_of_own(name)):
        raise InputError(f"--scheme own has room for {most} robots on {name}; got {size}")
    out = []
    for number in range(first, first + count):
        rng = np.random.default_rng([seed, size, number])
        if own_floor is not None:
            robots = _robots(*random_scheme(own_floor, size, rng))
            out.append(FleetCondition(own_floor, robots))
            continue
        chosen = str(rng.choice(list(NAMED))) if name == "any" else name
        floor = NAMED[chosen] if chosen in NAMED else random_map(rng)
        own = scheme == "own" and chosen in OWN
        starts, goals = own_scheme(chosen, size) if own else random_scheme(floor, size, rng)
        limit = SPEED_LIMITS.get(chosen, SPEED_LIMIT)
        where = chosen if chosen in NAMED else floor
        out.append(FleetCondition(where, _robots(starts, goals), speed_limit=limit))
    return out


def _robots(starts: Points, goals: Points) -> tuple[Robot, ...]:
    return tuple(
        Robot((float(a), float(b)), (float(c), float(d)))
        for (a, b), (c, d) in zip(starts, goals, strict=True)
    )
