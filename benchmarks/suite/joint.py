"""The same guidance problem given to one central QP over all agents, over every agent's own."""

from collections.abc import Iterator

from deggflow.tasks.tabletop.baselines import METHODS
from deggflow.tasks.tabletop.field import load_field
from deggflow.tasks.tabletop.generator import TabletopGenerator
from deggflow.tasks.tabletop.requirements import tabletop_guidance

from .clock import Patience, in_turn
from .generation import scene_call
from .rows import Row, Way, rows_of

SIZE = 8


def joint(patience: Patience, quick: bool) -> Iterator[Row]:
    """SafeFlow's kind of QP over ours."""
    batch = 1 if quick else 128
    (method,) = (one for one in METHODS if one.name == "joint barrier QP")
    way, field = method.make(method.default), load_field()
    ours = TabletopGenerator(field, tabletop_guidance())
    theirs = TabletopGenerator(field, way.guidance, guard=way.guard)
    calls = {
        "joint/ours": scene_call(ours, SIZE, batch),
        "joint/joint QP": scene_call(theirs, SIZE, batch),
    }
    where = f"guided scenes, N = {SIZE}, batch {batch}"
    ways = {
        "joint/ours": Way(f"{where}, every agent its own QP", batch),
        "joint/joint QP": Way(f"{where}, one QP for all ({method.source})", batch, "joint/ours"),
    }
    yield from rows_of(ways, in_turn(calls, patience))
