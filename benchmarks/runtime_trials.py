"""Bridge trials by real processes of which one is killed or frozen in the middle, and by a joint QP whose process is killed.

Each trial is played by N robot processes and a world process on 127.0.0.1 (`deggflow bridge generate --processes`). After
a random number of rounds one robot gets SIGKILL or, in some trials, SIGSTOP. The same trials are planned by one process that
solves a joint QP for all robots (`JointBarrier`), which gets SIGKILL as it begins the same policy. A trial bridges the gap if
the replay by an independent integrator and Shapely agrees that it does. One row is written for each trial; rerun the command
to resume.

Run: python benchmarks/runtime_trials.py --out rows.jsonl [--kills 17 17 16] [--freezes 3 3 4] [--deadline 20] [--seed 0] [--joint-qp]
Pictures and videos of the trials: --lines trials.jsonl, then deggflow bridge render trials.jsonl --video
"""

import argparse
import json
import os
import random
import signal
import subprocess
import sys
import time
from collections import Counter
from pathlib import Path
from typing import Any

SIZES = (4, 6, 8)
ROUNDS = (
    30,
    700,
)  # after which the fault happens; a policy takes about 55, a trial about 15 policies
ROUNDS_OF_POLICY = 55
JOIN = 1800


def conditions_of(size, count, seed):
    from deggflow.tasks.bridge.scenes import random_conditions

    return random_conditions(size, count, seed)


class Faults:
    """Kills or freezes one robot of each trial after some of its rounds."""

    def __init__(self, team, plan, first):
        """Args: team: a `LocalTeam`; plan: (robot, rounds, signal) of each trial; first: number of the first trial."""
        self.team, self.plan, self.number = team, plan, first
        self.rounds, self.hit = 0, False

    def take(self, process, line):
        """A line of a process."""
        if self.hit or self.number >= len(self.plan) or "round" not in line:
            return
        robot, after, name = self.plan[self.number]
        if process != robot:
            return
        self.rounds += 1
        if self.rounds >= after:
            os.kill(self.team.pids[robot], getattr(signal, name))
            self.hit = True

    def next(self):
        """The next trial begins."""
        self.number, self.rounds, self.hit = self.number + 1, 0, False


def plan_of(size, kills, freezes, seed):
    rng = random.Random(f"{seed} {size}")
    signals = ["SIGKILL"] * kills + ["SIGSTOP"] * freezes
    return [(rng.randrange(size), rng.randint(*ROUNDS), name) for name in signals]


def play_team(size, plan, args, first, on_row):
    """Trials of one size by processes, from number `first` on."""
    from deggflow.app.team import LocalTeam
    from deggflow.tasks.bridge.options import BridgeGenerate
    from deggflow.tasks.bridge.oracle import refutation
    from deggflow.tasks.bridge.processes import BridgeProcesses

    conditions = conditions_of(size, len(plan), args.seed)
    options = BridgeGenerate(seed=args.seed, deadline=args.deadline, transport=args.transport)
    faults: Any = None
    with LocalTeam(
        "bridge", BridgeProcesses(), conditions, options, join=JOIN,
        on_line=lambda process, line: faults.take(process, line),
    ) as team:  # fmt: skip
        faults = Faults(team, plan, first)
        began = time.monotonic()
        for number, line in enumerate(team.results(first), start=first):
            robot, after, name = plan[number]
            records = [one["generation"] for one in line["certificate"]["policies"]]
            named = {each["agent"] for one in records for each in one.get("lost", ())}
            on_row(
                {
                    "size": size, "trial": number, "signal": name, "robot": robot + 1,
                    "rounds": after, "hit": faults.hit, "named": sorted(named),
                    "bridged": line["outcome"]["success"], "reason": line["outcome"]["reason"],
                    "satisfied": line["certificate"]["satisfied"],
                    "refuted": refutation(line), "seconds": round(time.monotonic() - began, 1),
                }
            )  # fmt: skip
            if args.lines is not None:
                with args.lines.open("a") as lines:
                    lines.write(json.dumps(line) + "\n")
            faults.next()
            began = time.monotonic()


def central(size, count, first, seed):
    """The joint QP's process: plans trials from number `first` on, each for all robots; says when it begins a policy and whether it bridged."""
    import jax.numpy as jnp

    from deggflow.app.session import prepare_jax

    prepare_jax()
    from deggflow.baselines import JointBarrier
    from deggflow.tasks.bridge.field import load_field
    from deggflow.tasks.bridge.generator import BridgeGenerator
    from deggflow.tasks.bridge.requirements import SafeValue, TaskValue, task_end

    field = load_field()
    task, safe = TaskValue(field.scales), SafeValue(field.scales)

    def margins(z, condition):
        end = jnp.ones((), z.dtype)
        return jnp.stack([task_end(condition) - task(end, z, condition), -safe(end, z, condition)])

    generator = BridgeGenerator(field, JointBarrier(margins, gain=2.0, rows=2))
    conditions = conditions_of(size, count, seed)
    for number in range(first, count):

        def tell(current):
            print(json.dumps({"policy": current.policy}), flush=True)

        condition = conditions[number]
        (trial,) = generator.trials([condition], seed=seed, first=number, on_round=tell)
        print(json.dumps({"trial": number, "bridged": trial.success}), flush=True)


def play_central(size, plan, args, kill):
    """The same trials by the joint QP: whether each bridges. With `kill`, its process is killed in every trial, and started again for the next."""
    bridged = {}
    while (first := len(bridged)) < len(plan):
        words = ["--central", str(size), str(len(plan)), str(first), "--seed", str(args.seed)]
        command = [sys.executable, __file__, *words, "--out", os.devnull]
        process, struck = subprocess.Popen(command, stdout=subprocess.PIPE, text=True), None
        for text in process.stdout:
            line = json.loads(text)
            if "bridged" in line:
                bridged[line["trial"]] = line["bridged"]
            elif kill and line["policy"] == plan[len(bridged)][1] // ROUNDS_OF_POLICY:
                process.kill()
                struck = len(bridged)
        process.stdout.close()
        code = process.wait()
        if struck is not None:
            bridged.setdefault(struck, False)
        elif code:
            raise RuntimeError(f"the joint QP's process ended with code {code}")
    return bridged


def report(rows):
    from deggflow.statistics import Rate

    for name in ("SIGKILL", "SIGSTOP"):
        for size in (*SIZES, None):
            some = [r for r in rows if r["signal"] == name and size in (None, r["size"])]
            hit = [r for r in some if r["hit"]]
            if not hit:
                continue
            who = "all" if size is None else f"N = {size}"
            good = sum(r["bridged"] and r["refuted"] is None for r in hit)
            told = sum(r["named"] == [f"robot {r['robot']}"] for r in hit)
            print(
                f"{name}, {who}: {len(some)} trials, {len(hit)} hit before their end; bridged {good} of {len(hit)}, "
                f"{Rate(good, len(hit))}; certificates that name the robot {told}; refuted "
                f"{sum(r['refuted'] is not None for r in hit)}; at most {max(r['seconds'] for r in hit):.0f} s"
            )
    with_qp = [r for r in rows if "joint_qp_killed" in r and r["hit"]]
    if with_qp:
        count = Counter(
            {name: sum(r[name] for r in with_qp) for name in ("joint_qp", "joint_qp_killed")}
        )
        print(
            f"joint QP of the same {len(with_qp)} trials: bridged {count['joint_qp']}, "
            f"with its process killed {count['joint_qp_killed']}"
        )
    for reason, number in Counter(r["reason"] for r in rows if not r["bridged"]).items():
        print(f"not bridged, {number}: {reason}")


def main():
    options = argparse.ArgumentParser(description=__doc__.split("\n")[0])
    options.add_argument("--out", type=Path, required=True)
    options.add_argument("--kills", type=int, nargs=3, default=(17, 17, 16))
    options.add_argument("--freezes", type=int, nargs=3, default=(3, 3, 4))
    options.add_argument("--deadline", type=float, default=20.0)
    options.add_argument("--transport", choices=("udp", "zenoh"), default="udp")
    options.add_argument("--seed", type=int, default=0)
    options.add_argument("--lines", type=Path, help="the trials themselves, to certify and render")
    options.add_argument("--joint-qp", action="store_true", help="also the joint QP")
    options.add_argument("--central", type=int, nargs=3, help=argparse.SUPPRESS)
    args = options.parse_args()
    if args.central:
        size, count, first = args.central
        central(size, count, first, args.seed)
        return
    rows = []
    if args.out.exists():
        rows = [json.loads(text) for text in args.out.read_text().splitlines()]

    def write():
        part = args.out.with_name(args.out.name + ".part")
        part.write_text("".join(json.dumps(row) + "\n" for row in rows))
        part.replace(args.out)

    def add(row):
        rows.append(row)
        print(json.dumps(row), flush=True)
        write()

    for size, kills, freezes in zip(SIZES, args.kills, args.freezes, strict=True):
        plan = plan_of(size, kills, freezes, args.seed)
        done = sum(row["size"] == size for row in rows)
        if done < len(plan):
            play_team(size, plan, args, done, add)
        mine = [row for row in rows if row["size"] == size]
        for name, kill in (("joint_qp", False), ("joint_qp_killed", True)):
            if args.joint_qp and any(name not in row for row in mine):
                bridged = play_central(size, plan, args, kill)
                for row in mine:
                    row[name] = bridged[row["trial"]]
                write()
    report(rows)


if __name__ == "__main__":
    main()
