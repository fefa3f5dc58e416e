"""Every experiment, in the order of the report."""

from pathlib import Path

from deggflow.weights import packaged_weights

from . import baselines, bridge, deviation, examples, least_deviation, tabletop
from .curves import Sources, TrainingCurves
from .run import Entry


def weights(task: str) -> Path:
    """The shipped weights of a task."""
    return packaged_weights(f"deggflow.tasks.{task}")


def entries(sources: Sources) -> tuple[Entry, ...]:
    """All experiments, with the files that their results depend on.

    Args:
        sources: Training curves to show, by task and seed.
    """
    on_bridge, on_table = (weights("bridge"),), (weights("tabletop"),)
    curves = tuple(path for of_seeds in sources.values() for path in of_seeds.values())
    return (
        *(Entry(each, on_bridge) for each in bridge.EXPERIMENTS),
        *(Entry(each, on_table) for each in tabletop.EXPERIMENTS),
        *(Entry(each, on_table) for each in examples.EXPERIMENTS),
        Entry(TrainingCurves(sources), curves),
        *(Entry(each, on_table) for each in deviation.EXPERIMENTS),
        *(Entry(each, on_table) for each in baselines.EXPERIMENTS),
        *(Entry(each, on_table) for each in least_deviation.EXPERIMENTS),
    )
