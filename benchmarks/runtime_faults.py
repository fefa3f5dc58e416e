"""Simulated teams whose agents crash and whose messages are delayed, lost, duplicated and cut off, within the fault model.

Every run generates one sample, each agent by itself (`deggflow.runtime`), on a network that a seed decides message by
message. Checked by NumPy in float64, by formulas of this script:

- survivors agree: all have the same bytes of the sample, of its record and of who was lost, and lose only who crashed;
- no certificate is false: what is said to be satisfied holds for the sample;
- what is feasible for the survivors is satisfied, if need be by another draw: survivors begin again from another z(0),
  with those that were lost as obstacles where they stopped. It is feasible where the lost do not violate a requirement
  among themselves, as nobody can move them;
- the sample is that of the batched program with the agents stopping where they were lost.

With --outside, outages and freezes last longer than deadlines. Agents may then give up, but none may disagree with another
or have a false certificate.

The numbers of all agents that were told the same are computed in one call (simulated_team.py); with --apart each agent has
a program of its own.

Run: python benchmarks/runtime_faults.py [--generations 10000] [--seed 0] [--outside] [--apart]
One run again: --generations 1 --seed N.
"""

import argparse
import random
import sys
import time
from collections import Counter
from functools import cache
from typing import Any

import jax
import jax.numpy as jnp
import numpy as np
from simulated_team import CompiledTeam, SimulatedProgram

from deggflow import (
    DecoupledGuidance,
    EveryStep,
    Extrapolated,
    PrivateRequirement,
    SharedFactor,
    SharedRequirements,
    distances,
    generate,
    refined_grid,
)
from deggflow.guidance import Recovering
from deggflow.runtime import Fault, Member, Network, Simulation, TeamError, TeamProgram
from deggflow.runtime.agreement import DisagreementError
from deggflow.statistics import Rate

APART, CENTRE = 0.5, 0.25  # least distance; squared distance of the mean from the origin
GRID = refined_grid(20)
DRIFTS = (EveryStep(), Extrapolated(5))
SIZES = (4, 5)
SAME = 1e-3  # of samples by two float32 programs
MAX_DRAWS = 8


def field(tau, z, condition):
    """Draws all agents together, each after its neighbour."""
    return 2.0 * (0.3 * jnp.roll(z, 1, axis=0) - z) + 0.3 * jnp.sin(3 * z)


def centre(tau, z, condition):
    return jnp.sum(jnp.mean(z, axis=0) ** 2) - CENTRE


GUIDANCES = (
    DecoupledGuidance((PrivateRequirement(lambda z, _: distances(z) - APART, 0.05, name="apart"),)),
    DecoupledGuidance(
        (
            PrivateRequirement(lambda z, _: distances(z) - APART, 0.05, name="apart"),
            SharedRequirements(
                (SharedFactor(centre, alpha=Recovering(), buffer=0.02, name="centre"),)
            ),
        )
    ),
)


@cache
def programs(which, drift):
    """The team's program, and the batched one."""
    guidance = GUIDANCES[which]
    settings: dict[str, Any] = {"grid": GRID, "drift": DRIFTS[drift]}

    def batched(z0, stops):
        return generate(field, guidance, z0, None, stops=stops, **settings)

    return TeamProgram(field, guidance, **settings), jax.jit(batched)


@cache
def compiled_team(which, drift, agents):
    """The program for all agents of a simulated team."""
    return CompiledTeam(programs(which, drift)[0], agents)


def least_distance(z, some):
    """Between two of some agents."""
    apart = np.linalg.norm(z[:, None] - z[None], axis=-1)
    pairs = some[:, None] & some[None] & ~np.eye(len(z), dtype=bool)
    return np.min(apart, where=pairs, initial=np.inf)


def holds(z, which):
    """Whether a sample meets the requirements."""
    everybody = np.ones(len(z), bool)
    good = least_distance(z, everybody) >= APART
    return good and (not which or np.sum(np.mean(z, axis=0) ** 2) <= CENTRE)


def faults_of(rng, agents, most, outside):
    """Crashes, and outside of the fault model freezes, of at most `most` agents at any message."""
    copies = rng.choice([5, 40, 400])
    return [
        Fault(
            agent,
            rng.randrange(copies),
            rng.uniform(0.5, 20.0) if outside and rng.random() < 0.5 else float("inf"),
        )
        for agent in rng.sample(range(agents), rng.randint(0, most))
    ]


def play(seed, outside=False, apart=False):
    """One run: what there is to count, and what is wrong. With `apart`, each agent calls a program of its own."""
    rng = random.Random(seed)
    which, drift, agents = rng.randrange(2), rng.randrange(len(DRIFTS)), rng.choice(SIZES)
    program, _ = programs(which, drift)
    if not apart:
        program = SimulatedProgram(compiled_team(which, drift, agents))
    most = (agents - 1) // 2
    start = program.start(np.random.default_rng(seed).normal(size=(agents, 2)).astype(np.float32))
    network = Network(loss=rng.choice([0.0, 0.1, 0.4]), partitions=rng.randrange(4))
    deadline = network.deadline
    if outside:
        network, deadline = Network(outage=4.0, partitions=3, loss=0.3), 0.9
    team = [Member(program, k, start, faults=most, deadline=deadline) for k in range(agents)]
    simulation = Simulation(team, network, faults_of(rng, agents, most, outside), seed)
    outcome = simulation.run(lambda member: member.generated is not None)
    return judged(team, outcome, which, programs(which, drift), start.z0, outside, seed)


class Gone:
    """An agent that was lost before: it says nothing."""

    generated = None

    def start(self):
        """Does nothing, as all of it."""

    def tick(self, now):
        pass

    def receive(self, data, now):
        pass

    def sent(self):
        return []


def draw_again(program, generated, number, seed):
    """Another draw of the survivors, on a network that loses nothing for good; lost agents stay where they stopped."""
    lost = np.isfinite(generated.stops)
    z = np.asarray(generated.generation.z)
    other = np.random.default_rng((seed, number)).normal(size=z.shape).astype(z.dtype)
    start = program.start(np.where(lost[:, None], z, other), lost=np.flatnonzero(lost).tolist())
    network = Network(loss=0.1)
    team = [
        Gone() if gone else Member(program, k, start, faults=0, deadline=network.deadline)
        for k, gone in enumerate(lost)
    ]
    finished = Simulation(team, network, [], seed).run(
        lambda member: isinstance(member, Gone) or member.generated is not None
    )
    assert not finished.errors, finished.errors
    return next(member.generated for member in team if member.generated is not None)


def redrawn(program, generated, which, seed):
    """The first draw after a failed one that satisfies the requirements, with its number; the last one if none does."""
    for number in range(2, MAX_DRAWS + 1):
        generated = draw_again(program, generated, number, seed)
        if generated.certify(GUIDANCES[which]).satisfied:
            break
    return generated, number


def judged(team, outcome, which, compiled, z0, outside, seed):
    """Counts, and a list of what is wrong."""
    program, batched = compiled
    made = [member for member in team if member.generated is not None]
    unfinished = [
        k for k, member in enumerate(team) if member not in made and k not in outcome.crashed
    ]
    wrong = []
    kinds = {type(error) for error in outcome.errors.values()}
    if any(not issubclass(kind, TeamError) or kind is DisagreementError for kind in kinds):
        wrong.append(f"errors: {outcome.errors}")
    if unfinished and not outside:
        wrong.append(f"agents {unfinished} have no sample: {outcome.errors}")
    counts = Counter({"generations": 1, "with a sample": bool(made), "gave up": len(unfinished)})
    if not made:
        return counts, wrong
    one = made[0].generated
    same = [
        jax.tree.all(jax.tree.map(lambda a, b: a.tobytes() == b.tobytes(), one, other.generated))
        for other in made[1:]
    ]
    if not all(same) or DisagreementError in kinds:
        wrong.append("survivors disagree")
    lost = np.isfinite(one.stops)
    if not outside and not set(np.flatnonzero(lost)) <= outcome.crashed:
        wrong.append(f"lost {np.flatnonzero(lost)}, crashed {sorted(outcome.crashed)}")
    z = one.generation.z.astype(float)
    certificate = one.certify(GUIDANCES[which])
    named = {int(each.agent.split()[1]): each.tau for each in certificate.generation.lost}
    if named != {int(k): float(one.stops[k]) for k in np.flatnonzero(lost)}:
        wrong.append(f"the certificate names {named}")
    feasible = bool(least_distance(z, lost) >= APART)
    last, draws, satisfied = one, 1, certificate.satisfied
    if feasible and not satisfied and not outside:
        last, draws = redrawn(program, one, which, seed)
        satisfied = last.certify(GUIDANCES[which]).satisfied
    false = satisfied and not holds(last.generation.z.astype(float), which)
    if false:
        wrong.append("a false certificate")
    apart = float(np.abs(one.generation.z - batched(z0, one.stops).z).max())
    counts += Counter(
        {
            "with losses": bool(lost.any()),
            "lost agents": int(lost.sum()),
            "feasible": feasible,
            "satisfied": satisfied,
            "satisfied by the first draw": certificate.satisfied,
            "survivors agree": all(same) and DisagreementError not in kinds,
            "false certificates": false,
            "feasible, not satisfied": feasible and not satisfied,
            "feasible, drawn again": draws > 1,
            "as the batched program": apart <= SAME,
        }
    )
    return counts, wrong


def main():
    options = argparse.ArgumentParser(description=__doc__.split("\n")[0])
    options.add_argument("--generations", type=int, default=10_000)
    options.add_argument(
        "--seed", type=int, default=0, help="of the first run; each takes the next"
    )
    options.add_argument("--outside", action="store_true", help="of the fault model")
    options.add_argument(
        "--apart", action="store_true", help="each agent has a program of its own; slower"
    )
    args = options.parse_args()
    total, failing, began = Counter(), [], time.monotonic()
    for seed in range(args.seed, args.seed + args.generations):
        counts, wrong = play(seed, args.outside, args.apart)
        total.update(counts)
        if wrong:
            failing.append(seed)
            print(f"--seed {seed}: {'; '.join(wrong)}", flush=True)
        if counts["feasible, drawn again"]:
            outcome = "not satisfied" if counts["feasible, not satisfied"] else "satisfied"
            print(f"--seed {seed}: feasible, drawn again, {outcome}", flush=True)
    for name, count in total.items():
        print(f"{name:<26} {count}")
    good = total["feasible"] - total["feasible, not satisfied"]
    made, claims = total["with a sample"], total["satisfied"]
    for text, successes, cases in (
        ("survivors agree", total["survivors agree"], made),
        ("certificates that are true, of those that say satisfied", claims - total["false certificates"], claims),
        ("satisfied of what is feasible for survivors", good, total["feasible"]),
    ):  # fmt: skip
        if cases:
            print(f"{text}: {Rate(successes, cases)}")
    print(f"runs with something wrong: {len(failing)} ({time.monotonic() - began:.0f} s)")
    sys.exit(bool(failing))


if __name__ == "__main__":
    main()
