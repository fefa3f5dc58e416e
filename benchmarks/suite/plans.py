"""Plans of the fleet: nominal ones, and certified ones one at a time and many at once, by map."""

from collections.abc import Iterator, Sequence
from functools import partial
from typing import Any

import numpy as np

from deggflow.tasks.fleet.condition import FleetCondition, padding
from deggflow.tasks.fleet.drawn import random_conditions
from deggflow.tasks.fleet.field import load_field
from deggflow.tasks.fleet.generator import FleetGenerator, initial_noise
from deggflow.tasks.fleet.maps import NAMED
from deggflow.tasks.fleet.options import FleetFieldOptions
from deggflow.tasks.fleet.schemes import OWN

from .clock import Call, Patience, in_turn
from .rows import Row, Way, rows_of

SEED, ROBOTS = 1, 9


def plans(patience: Patience, quick: bool) -> Iterator[Row]:
    """First draws with verdicts and certificates, MMD's starts and goals where a map has them; ratio: to nominal plans."""
    field, options = load_field(), FleetFieldOptions()
    nominal, guided = FleetGenerator(field, options, guided=False), FleetGenerator(field, options)
    for name in ("conveyor",) if quick else tuple(NAMED):
        for batch in (1,) if quick else (1, 512):
            scheme: Any = "own" if name in OWN else "random"
            conditions = random_conditions(ROBOTS, batch, name, scheme, SEED)  # type: ignore[arg-type]
            calls = {
                "nominal": _nominal(nominal, conditions),
                "certified": partial(guided.plans, conditions, seed=SEED),
            }
            where = f"plans of {ROBOTS} robots, {name}, batch {batch}"
            names = {kind: f"plans/{name}/{batch}/{kind}" for kind in calls}
            ways = {
                names[kind]: Way(f"{kind} {where}", batch, None if kind == "nominal" else names["nominal"])
                for kind in calls
            }  # fmt: skip
            times = in_turn({names[kind]: call for kind, call in calls.items()}, patience)
            yield from rows_of(ways, times)


def _nominal(generator: FleetGenerator, conditions: Sequence[FleetCondition]) -> Call:
    """Nominal plans with their verdicts, from one z(0) each."""
    agents = padding(conditions).agents
    noise = initial_noise(SEED, np.arange(len(conditions)), 0, agents, 1)
    return lambda: generator.batch(noise, conditions)
