"""One policy for 8 robots: time of a single one after compilation, throughput of a batch, compile time.

Pinned to one core. Run: python benchmarks/bridge_policy.py [--robots 8] [--rounds 50] [--batch 512]
"""

import argparse
import os
import statistics
import time
from functools import partial

if hasattr(os, "sched_setaffinity"):
    os.sched_setaffinity(0, {min(os.sched_getaffinity(0))})

import jax
import numpy as np

from deggflow.tasks.bridge.condition import padded_robots, to_arrays
from deggflow.tasks.bridge.field import load_field
from deggflow.tasks.bridge.policies import PolicyGenerator, initial_noise
from deggflow.tasks.bridge.requirements import bridge_guidance
from deggflow.tasks.bridge.scenes import random_conditions


def policy(generator, noise, condition):
    """Generates and waits for the result."""
    jax.block_until_ready(generator.draw(noise, condition))


def timed(call):
    """Seconds of one call."""
    begin = time.perf_counter()
    call()
    return time.perf_counter() - begin


def main():
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--robots", type=int, default=8)
    parser.add_argument("--rounds", type=int, default=50)
    parser.add_argument("--batch", type=int, default=512)
    options = parser.parse_args()
    field = load_field()
    trials = random_conditions(options.robots, options.batch, 0)
    agents = padded_robots(options.robots)
    kinds = {
        "nominal": PolicyGenerator(field),
        "guided, fixed steps": PolicyGenerator(field, bridge_guidance(field.scales), guard=None),
        "guided, guarded": PolicyGenerator(field, bridge_guidance(field.scales)),
    }
    calls = {}
    for name, generator in kinds.items():
        for size, rounds in ((1, options.rounds), (options.batch, 3)):
            condition = to_arrays(trials[:size], agents)
            noise = initial_noise(0, np.arange(size), 0, 0)[:, :agents]
            draw = partial(policy, generator, noise, condition)
            calls[name, size] = draw, timed(draw), rounds
    times = {key: [] for key in calls}
    for turn in range(
        options.rounds
    ):  # in turns: what else the machine does hits all of them alike
        for key, (draw, _, rounds) in calls.items():
            if turn < rounds:
                times[key].append(timed(draw))
    print(f"{options.robots} robots, {len(kinds['nominal'].grid) - 1} steps, one core")
    print("policies              batch  first call  median of later ones  policies/s")
    for (name, size), found in times.items():
        median = statistics.median(found)
        print(
            f"{name:20s}  {size:5d}  {calls[name, size][1]:8.1f} s  {1000 * median:17.1f} ms  {size / median:10.0f}"
        )


if __name__ == "__main__":
    main()
