"""The field's products in bfloat16 over float32: time, and whether first draws still satisfy every requirement."""

from collections.abc import Iterator

import numpy as np

from deggflow.statistics import Rate
from deggflow.tasks.tabletop.changes import random_conditions
from deggflow.tasks.tabletop.field import load_field
from deggflow.tasks.tabletop.generator import TabletopGenerator, initial_noise, judged
from deggflow.tasks.tabletop.requirements import tabletop_guidance

from .clock import Patience, in_turn
from .generation import scene_call
from .rows import Row, Way, rows_of

CASES, SEED = 1000, 1


def bfloat16(patience: Patience, quick: bool) -> Iterator[Row]:
    """Guided scenes by both, of the same conditions from the same z(0)."""
    field, batch = load_field(), 16 if quick else 512
    for size in (8,) if quick else (8, 12):
        first = f"bfloat16/{size}/float32"
        generators = {
            first: TabletopGenerator(field, tabletop_guidance()),
            f"bfloat16/{size}/bfloat16": TabletopGenerator(
                field.in_bfloat16(), tabletop_guidance()
            ),
        }
        ways = {
            name: Way(
                f"guided scenes, N = {size}, batch {batch}, {name.split('/')[-1]} products",
                batch,
                None if name == first else first,
            )
            for name in generators
        }
        calls = {name: scene_call(one, size, batch) for name, one in generators.items()}
        cases = 16 if quick else CASES
        figures = {name: _success(one, size, cases) for name, one in generators.items()}
        yield from rows_of(ways, in_turn(calls, patience), figures)


def _success(generator: TabletopGenerator, size: int, cases: int) -> dict[str, float]:
    """First draws that exact geometry finds satisfied, with the 95% Wilson interval of their share."""
    conditions = random_conditions(size, cases, "changed", SEED)
    noise = initial_noise(SEED, np.arange(cases), 0)
    candidates = judged(generator.batch(noise, conditions), conditions, SEED)
    satisfied = sum(one.satisfied for one in candidates)
    low, high = Rate(satisfied, cases).interval()
    return {"satisfied": satisfied, "of": cases, "% from": 100 * low, "to": 100 * high}
