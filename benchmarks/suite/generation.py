"""Nominal and guided generation of both tasks: what hard requirements cost, by number of agents and of samples."""

from collections.abc import Iterator
from functools import partial
from typing import Any

import jax
import numpy as np

from deggflow.blocks import padded_batch
from deggflow.guidance import AbstractGuidance
from deggflow.tasks.bridge.condition import padded_robots
from deggflow.tasks.bridge.condition import to_arrays as trial_arrays
from deggflow.tasks.bridge.field import load_field as load_bridge
from deggflow.tasks.bridge.policies import PolicyGenerator
from deggflow.tasks.bridge.policies import initial_noise as policy_noise
from deggflow.tasks.bridge.requirements import bridge_guidance
from deggflow.tasks.bridge.scenes import random_conditions as random_trials
from deggflow.tasks.tabletop.changes import random_conditions
from deggflow.tasks.tabletop.condition import padded_size, to_arrays
from deggflow.tasks.tabletop.field import load_field
from deggflow.tasks.tabletop.generator import TabletopGenerator, initial_noise
from deggflow.tasks.tabletop.requirements import LOCAL, OWN, tabletop_guidance
from deggflow.trace import Work

from .clock import Call, Kept, Patience, in_turn
from .rows import Row, Way, rows_of

SEED = 0
OBJECTS, ROBOTS, BATCHES = (4, 8, 12), (4, 8), (1, 32, 512)


def scenes(patience: Patience, quick: bool) -> Iterator[Row]:
    """Nominal and guided scenes; at N = 8 other ways to guide as well."""
    field = load_field()

    def way(*guidance: AbstractGuidance, **settings: Any) -> TabletopGenerator:
        return TabletopGenerator(field, *guidance, **settings)

    usual = {"nominal": way(), "guided": way(tabletop_guidance())}
    fixed = {"guided, fixed steps": way(tabletop_guidance(), guard=None)}
    other = {
        "guided, own (the paper's)": way(tabletop_guidance(OWN, reanchored=False)),
        "guided, local": way(tabletop_guidance(LOCAL)),
    }
    for size in (8,) if quick else OBJECTS:
        for batch in (1, 16) if quick else BATCHES:
            ways = {
                **usual,
                **(fixed if size == 8 and batch < 512 else {}),
                **(other if (size, batch) == (8, 32) else {}),
            }
            calls = {name: scene_call(generator, size, batch) for name, generator in ways.items()}
            padded = padded_size(size), padded_batch(batch)
            yield from _compared("scenes", calls, size, batch, padded, patience)


def policies(patience: Patience, quick: bool) -> Iterator[Row]:
    """Nominal and guided policies of the bridge."""
    field = load_bridge()
    guidance = bridge_guidance(field.scales)
    usual = {"nominal": PolicyGenerator(field), "guided": PolicyGenerator(field, guidance)}
    fixed = {"guided, fixed steps": PolicyGenerator(field, guidance, guard=None)}
    for robots in (8,) if quick else ROBOTS:
        for batch in (1,) if quick else BATCHES:
            ways = {**usual, **(fixed if robots == 8 and not quick else {})}
            calls = {
                name: policy_call(generator, robots, batch) for name, generator in ways.items()
            }
            padded = padded_robots(robots), batch
            yield from _compared("policies", calls, robots, batch, padded, patience)


def scene_call(generator: TabletopGenerator, size: int, batch: int) -> Call:
    """Generates scenes: the compiled program with its transfers, nothing decoded or judged."""
    conditions = to_arrays(random_conditions(size, batch, "changed", SEED))
    noise = initial_noise(SEED, np.arange(batch), 0)[:, : conditions.mask.shape[1]]
    return partial(generator.draw, noise, conditions)


def policy_call(generator: PolicyGenerator, robots: int, batch: int) -> Call:
    """Generates policies: the compiled program, nothing decoded or checked."""
    agents = padded_robots(robots)
    conditions = trial_arrays(random_trials(robots, batch, SEED), agents)
    conditions = jax.tree.map(
        lambda leaf: leaf if leaf.dtype == bool else leaf.astype(np.float32), conditions
    )
    noise = policy_noise(SEED, np.arange(batch), 0, 0)[:, :agents]
    return lambda: jax.block_until_ready(generator.draw(noise, conditions))


def _compared(
    task: str,
    calls: dict[str, Call],
    size: int,
    batch: int,
    padded: tuple[int, int],
    patience: Patience,
) -> list[Row]:
    """Rows of one team size and one batch; ratios to the nominal generation."""
    where = f"N = {size}, batch {batch}"
    nominal = f"{task}/{size}/{batch}/nominal"
    note = "" if padded == (size, batch) else f"padded to N = {padded[0]}, batch {padded[1]}"
    names = {name: f"{task}/{size}/{batch}/{name.split(' (')[0]}" for name in calls}
    ways = {
        names[name]: Way(f"{name}, {where}", batch, None if name == "nominal" else nominal, note)
        for name in calls
    }
    kept = {names[name]: Kept(call) for name, call in calls.items()}
    times = in_turn(kept, patience)
    figures = {
        name: _work(call.result.summary.work) for name, call in kept.items() if name != nominal
    }
    return rows_of(ways, times, figures)


def _work(work: Work) -> dict[str, float]:
    """Evaluations of the guided field that a sample took: one more than steps where none was refused."""
    median, late, most = np.quantile(np.asarray(work.evaluations), (0.5, 0.99, 1.0))
    return {"evaluations": float(median), "99%": float(late), "most": float(most)}
