"""Bytes on the wire and time of teams of processes, beside theory and the batched program.

Every team generates in processes of its own on 127.0.0.1, by datagrams; bytes are those of all datagrams that a process received
for a round, repetitions included, from the second round of a generation on. `theory` is what docs/runtime.md says of
messages that are sent once. The batched program runs before and after in this process, compiled; the ratio of times is to the mean.

The last table has the large scene again, in threads of this process with sockets of their own: told borders, and told all
states. Samples of both must be equal bit for bit, and close to that of the batched program.

Run: python benchmarks/runtime_wire.py [--objects 8] [--robots 8] [--large 200 --processes 8] [--seed 1] [--deadline 60]
"""

import argparse
import time
from concurrent.futures import ThreadPoolExecutor
from statistics import fmean, median

import jax
import jax.numpy as jnp
import numpy as np

HEADERS = {"tabletop": 84, "bridge": 188}  # bytes of a message with its header


def rounds_of(name, factory, condition, options):
    """Rounds of all processes of one result, and the result."""
    from deggflow.app.team import LocalTeam

    rounds = {}

    def take(process, line):
        if "round" in line:
            rounds.setdefault(process, []).append(line["round"])

    with LocalTeam(name, factory, [condition], options, on_line=take, join=1800) as team:
        (result,) = team.results()
    return rounds, result


def timed(make):
    began = time.perf_counter()
    made = make()
    return time.perf_counter() - began, made


def row(what, rounds, result, theory, batched, samples=1):
    """One line of the table."""
    later = [[one for one in some if one["round"] > 1] for some in rounds.values()]
    received = fmean(one["bytes"] for some in later for one in some)
    seconds = fmean(sum(one["seconds"] for one in some) for some in later) / samples
    wait = median(one["seconds"] for some in later for one in some)
    ratio = "" if theory is None else f"{received / theory:.2f}"
    print(
        f"| {what} | {len(rounds)} | {fmean(map(len, later)) / samples:.0f} | {received:.0f} | {theory or ''} | {ratio} | "
        f"{1e3 * wait:.1f} ms | {seconds:.2f} s | {batched:.3f} s | {seconds / batched:.1f} |",
        flush=True,
    )
    assert result["certificate"]["satisfied"], "the result does not satisfy its requirements"


def around(batched, team):
    """A team's rounds between two runs of the batched program, and the mean time of these."""
    batched()  # compiles
    before, _ = timed(batched)
    rounds, result = team()
    after, _ = timed(batched)
    return rounds, result, (before + after) / 2


def tabletop(size, args, processes=0):
    from deggflow.tasks.tabletop.changes import random_conditions
    from deggflow.tasks.tabletop.generator import few_evaluations
    from deggflow.tasks.tabletop.large import make_scenes
    from deggflow.tasks.tabletop.model import TabletopModel
    from deggflow.tasks.tabletop.options import TabletopGenerate
    from deggflow.tasks.tabletop.processes import TabletopProcesses
    from deggflow.tasks.tabletop.task import scene_generator

    options = TabletopGenerate(
        size=size, seed=args.seed, processes=processes, deadline=args.deadline, max_draws=1
    )
    (condition,) = random_conditions(size, 1, options.requirements, args.seed)
    generator = scene_generator(TabletopModel().load(None), drift=few_evaluations(options))
    rounds, result, batched = around(
        lambda: make_scenes(generator, [condition], seed=args.seed, max_draws=1),
        lambda: rounds_of("tabletop", TabletopProcesses(), condition, options),
    )
    theory = None if processes else (size - 1) * HEADERS["tabletop"]
    what = "large scene" if processes else "tabletop"
    row(f"{what}, {size} objects", rounds, result, theory, batched)
    return generator, condition


def bridge(size, args):
    from deggflow.tasks.bridge.field import load_field
    from deggflow.tasks.bridge.generator import BridgeGenerator
    from deggflow.tasks.bridge.options import BridgeGenerate
    from deggflow.tasks.bridge.policies import few_evaluations
    from deggflow.tasks.bridge.processes import BridgeProcesses
    from deggflow.tasks.bridge.requirements import bridge_guidance
    from deggflow.tasks.bridge.scenes import random_conditions

    options = BridgeGenerate(size=size, seed=args.seed, processes=0, deadline=args.deadline)
    (condition,) = random_conditions(size, 1, args.seed)
    field = load_field()
    guidance = bridge_guidance(field.scales, speed_limit=options.speed_limit)
    generator = BridgeGenerator(
        field, guidance, drift=few_evaluations(options), speed_limit=options.speed_limit
    )
    rounds, result, batched = around(
        lambda: generator.trials([condition], seed=args.seed),
        lambda: rounds_of("bridge", BridgeProcesses(), condition, options),
    )
    policies = len(result["certificate"]["policies"])
    theory = (size - 1) * HEADERS["bridge"]
    row(f"bridge, {size} robots, a policy", rounds, result, theory, batched / policies, policies)


class Everybody:
    """A neighbourhood in which all have to be told of all."""

    def __init__(self, objects):
        self._objects, self.skin = objects, np.inf
        self.way, self.only = objects.way, objects.only

    def pairs(self, z, condition):
        return self._objects.pairs(z, condition)[0], jnp.asarray(False)


def in_threads(program, owners, z0, arrays, args):
    """What each of K threads generates, and its rounds."""
    from deggflow.runtime import (
        Exchange,
        PartStart,
        Timing,
        UdpTransport,
        free_addresses,
        run_part,
    )

    addresses = free_addresses(args.processes)

    def part(number):
        rounds, transport = [], UdpTransport(number, addresses)
        timing = Timing(deadline=args.deadline, tick=5.0)
        exchange = Exchange(number, args.processes, transport, timing, rounds.append)
        try:
            made = run_part(
                program, PartStart(number, owners, z0, arrays), exchange, patience=600.0
            )
        finally:
            transport.close()
        return made, rounds

    with ThreadPoolExecutor(args.processes) as pool:
        return list(pool.map(part, range(args.processes)))


def borders(generator, condition, args):
    """The large scene, told borders and told all states."""
    from deggflow.runtime import PartProgram, PartStart, compile_part, owners_of
    from deggflow.tasks.tabletop.large.condition import to_arrays
    from deggflow.tasks.tabletop.large.field import large_scene_field
    from deggflow.tasks.tabletop.large.generator import (
        BESIDE,
        HEARD,
        initial_noise,
        large_scene_guidance,
        large_scenes_like,
    )
    from deggflow.tasks.tabletop.large.parts import ObjectNeighbourhood
    from deggflow.tasks.tabletop.verdict import BUFFER

    large, count = large_scenes_like(generator), len(condition.objects)
    z0 = initial_noise(condition, args.seed, 0, 0)
    arrays = jax.tree.map(jnp.asarray, to_arrays(condition, BUFFER))
    owners = np.full(len(z0), -1)
    owners[:count] = owners_of(count, args.processes)
    field, guidance = large_scene_field(large.field, HEARD), large_scene_guidance()
    assert large.guard is not None
    objects, samples = ObjectNeighbourhood(2 * BESIDE), []
    for what, near in (("borders", objects), ("all states", Everybody(objects))):
        program = PartProgram(
            field, guidance, near, grid=large.grid, drift=large.drift, guard=large.guard
        )
        compile_part(program, PartStart(0, owners, z0, arrays))
        made = in_threads(program, owners, z0, arrays, args)
        received = [[one.bytes for one in rounds[1:]] for _, rounds in made]
        print(
            f"| {what} | {len(received[0]) + 1} | {fmean(map(fmean, received)):.0f} | {max(map(fmean, received)):.0f} | "
            f"{fmean(map(sum, received)) / 1e3:.1f} kB |",
            flush=True,
        )
        samples.append(np.asarray(made[0][0].generation.z))
    whole = large.batch(condition, args.seed, 0, 0).z[0]
    print(
        f"told borders and told all states: {'equal' if np.array_equal(samples[0], samples[1]) else 'NOT equal'} bit for bit; "
        f"greatest difference from the batched program {np.abs(samples[0] - whole).max():.1e}"
    )


def main():
    options = argparse.ArgumentParser(description=__doc__.split("\n")[0])
    options.add_argument("--objects", type=int, default=8, help="of the tabletop; 0: none")
    options.add_argument("--robots", type=int, default=8, help="of the bridge; 0: none")
    options.add_argument(
        "--large", type=int, default=200, help="objects of the large scene; 0: none"
    )
    options.add_argument("--processes", type=int, default=8, help="that share the large scene")
    options.add_argument("--seed", type=int, default=1)
    options.add_argument("--deadline", type=float, default=60.0)
    args = options.parse_args()
    from deggflow.app.session import prepare_jax

    prepare_jax()
    print(
        "| team | processes | rounds | bytes received in a round | theory | ratio | median round | in processes | batched | ratio |"
    )
    print("|---|---|---|---|---|---|---|---|---|---|")
    if args.objects:
        tabletop(args.objects, args)
    if args.robots:
        bridge(args.robots, args)
    if args.large:
        generator, condition = tabletop(args.large, args, args.processes)
        print("\n| told | rounds | bytes received in a round | of the busiest process | in all |")
        print("|---|---|---|---|---|")
        borders(generator, condition, args)


if __name__ == "__main__":
    main()
