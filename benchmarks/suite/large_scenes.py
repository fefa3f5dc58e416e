"""Many agents: what an object of a large scene costs, by the number of objects."""

from collections.abc import Iterator
from functools import partial

from deggflow.tasks.tabletop.changes import random_conditions
from deggflow.tasks.tabletop.field import load_field
from deggflow.tasks.tabletop.large import LargeSceneGenerator
from deggflow.tasks.tabletop.large.condition import padded_count

from .clock import Kept, Patience, in_turn
from .rows import Row, Way, rows_of

SIZES, QUICK_SIZES, SEED = (100, 300, 1000, 3000), (16, 32), 0


def large_scenes(patience: Patience, quick: bool) -> Iterator[Row]:
    """Guided large scenes and their records; the time of a sample is that of an object, ratios are to the smallest large scene's."""
    generator = LargeSceneGenerator(load_field())
    sizes = QUICK_SIZES if quick else SIZES
    names = {size: f"large_scenes/{size}" for size in sizes}
    first = names[sizes[0]]
    ways, kept = {}, {}
    for size, name in names.items():
        (condition,) = random_conditions(size, 1, "changed", SEED)
        kept[name] = Kept(partial(generator.batch, condition, SEED, 0, 0))
        reference = None if name == first else first
        note = f"padded to N = {padded_count(size)}"
        ways[name] = Way(f"guided large scene, N = {size}", size, reference, note)
    times = in_turn(kept, Patience(10 * patience.seconds, patience.least, 5))
    figures = {}
    for name, call in kept.items():
        made = call.result.records[0]
        figures[name] = {"evaluations": float(made.steps + made.refused_steps + 1)}
    yield from rows_of(ways, times, figures)
