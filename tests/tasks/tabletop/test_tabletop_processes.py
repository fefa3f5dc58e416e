"""Objects as processes; tests/app/test_team.py runs real ones."""

from typing import NamedTuple

import numpy as np

from deggflow.runtime import TeamGeneration, Timing
from deggflow.task import RunSettings
from deggflow.task.processes import Link
from deggflow.tasks.tabletop import processes
from deggflow.tasks.tabletop.changes import random_conditions
from deggflow.tasks.tabletop.generator import TabletopGenerator, initial_noise
from deggflow.tasks.tabletop.requirements import tabletop_guidance


class Call(NamedTuple):
    """How a generation of the team was begun."""

    start: object
    faults: int


def test_a_scene_that_failed_is_drawn_again_around_the_lost(monkeypatch, field):
    """Lost objects stay where they stopped, the others begin anew, and fewer may be lost."""
    (condition,) = random_conditions(4, 1, "default", 0)
    generator = TabletopGenerator(field, tabletop_guidance(), steps=12)
    calls, stopped = [], np.array([0.5, -0.25, 1.0], np.float32)

    def run_agent(program, number, start, transport, *, faults, **_):
        """The first draw ends with all objects in one place and one lost, the second where it began."""
        calls.append(Call(start, faults))
        z0 = np.asarray(start.z0)
        generation = generator.generation(z0, condition)
        stops = np.full(len(z0), np.inf, np.float32)
        z = np.array(generation.z)
        if len(calls) == 1:
            z[:], stops[2] = stopped, 0.3
        else:
            stops[2] = 0.0
        return TeamGeneration(generation._replace(z=z), stops)

    monkeypatch.setattr(processes, "run_agent", run_agent)
    monkeypatch.setattr(processes, "compile_agent", lambda *args: None)
    agent = processes.ObjectAgent(generator, Link(0, None, Timing(), faults=2), keep_trace=False)
    made = agent.make(condition, RunSettings(seed=3, first=0, max_draws=2))
    assert made.lost == {2}
    assert made.result.certificate.draws == 2
    (one, two) = calls
    assert (one.faults, two.faults) == (2, 1)
    assert list(one.start.stops[:4]) == [np.inf] * 4
    assert list(two.start.stops[:4]) == [np.inf, np.inf, 0, np.inf]
    np.testing.assert_array_equal(two.start.z0[2], stopped)
    others = initial_noise(3, np.array([0]), 1)[0, :4]
    np.testing.assert_array_equal(np.asarray(two.start.z0)[[0, 1, 3]], others[[0, 1, 3]])
