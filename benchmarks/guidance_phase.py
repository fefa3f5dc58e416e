"""Guidance during the generation, or after a prediction: what each moves, what it costs and what comes out.

Usage: python benchmarks/guidance_phase.py [tabletop | bridge] [--sizes 8 12] [--cases 512] [--trials 60]
"""

import time
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, replace
from functools import partial
from typing import Any, Literal

import numpy as np
import tyro

from deggflow.app.session import prepare_jax


@dataclass(frozen=True)
class Settings:
    """What is compared."""

    task: tyro.conf.Positional[Literal["tabletop", "bridge"]] = "tabletop"
    sizes: tuple[int, ...] = ()  # tabletop: 8 and 12; bridge: 4, 6 and 8
    evaluations: tuple[int, ...] = ()  # of the field; tabletop: 16 and 8, bridge: 12 and 8
    cases: int = 512  # of changed requirements
    demonstrated: int = 8  # of these, conditions for which demonstrations are made, too
    demonstrations: int = 64  # of each, and samples
    trials: int = 60
    rounds: int = 3  # of timing
    seed: int = 1


Ways = dict[str, Any]
"""Drifts by what the table calls them."""


def ways(counts: Sequence[int], make: Callable[[int], Any]) -> Ways:
    """During and after, with every step and with few evaluations."""
    from deggflow import AfterPrediction, EveryStep

    return {
        "during, every step": EveryStep(),
        **{f"during, {count}": make(count) for count in counts},
        **{f"after, {count}": AfterPrediction(make(count)) for count in counts},
    }


def show(head: Sequence[str], table: Sequence[Sequence[str]]) -> None:
    for row in (head, ["---"] * len(head), *table):
        print("| " + " | ".join(row) + " |", flush=True)


def tabletop(settings: Settings) -> None:
    head = (
        "N", "guidance, evaluations", "satisfied, first draw", "hypotheses hold", "deviation", "least margin", "mean margin",
        "default met", "distance to demonstrations", "time",
    )  # fmt: skip
    for size in settings.sizes or (8, 12):
        show(head, scenes(settings, size))
    print(
        f"\n{settings.cases} cases of changed requirements, seed {settings.seed}; scenes are drawn once. deviation: RMS "
        "distance per object, in z, to the nominal samples of 100 steps; margins: mm, the least and the mean over scenes of "
        "a scene's least one; default met: scenes that also meet the default requirements; distance to demonstrations: "
        f"energy distance, mean and standard error over {settings.demonstrated} changed conditions, between "
        f"{settings.demonstrations} scenes and as many relaxed random arrangements, the training data's construction under "
        "the changed requirements; time: of a batch, over that of the first guided row, median of rounds in which the rows take turns."
    )


def scenes(settings: Settings, size: int) -> list[list[str]]:
    """The table's rows of one size."""
    from deggflow import EveryStep, ExtrapolatedEndpoint
    from deggflow.tasks.tabletop.changes import random_conditions
    from deggflow.tasks.tabletop.field import load_field
    from deggflow.tasks.tabletop.generator import TabletopGenerator, initial_noise
    from deggflow.tasks.tabletop.requirements import tabletop_guidance
    from deggflow.tasks.tabletop.verdict import judge

    field, guidance = load_field(), tabletop_guidance()
    conditions = random_conditions(size, settings.cases, "changed", settings.seed)
    default = [replace(c, requirements={}, balance=None, given=None) for c in conditions]
    noise = initial_noise(settings.seed, np.arange(settings.cases), 0)
    few = conditions[: settings.demonstrated]
    repeated = [c for c in few for _ in range(settings.demonstrations)]
    others = initial_noise(settings.seed, np.arange(len(repeated)), 1)
    wanted = demonstrations(repeated, settings.seed)
    nominal = TabletopGenerator(field, drift=EveryStep())
    reference = nominal.batch(noise, conditions).z[:, :size]
    natural = sum(each.satisfied for each in judge(default, nominal.batch(noise, default).poses))
    distances = energy_distances(nominal.batch(others, repeated).poses, wanted, settings)
    table = [[str(size), "nominal, every step", "", "", "0", "", "", str(natural), distances]]
    runs: dict[str, Callable[[], Any]] = {}
    for name, drift in ways(settings.evaluations or (16, 8), ExtrapolatedEndpoint).items():
        generator = TabletopGenerator(field, guidance, drift=drift)
        made = generator.batch(noise, conditions)
        runs[name] = partial(generator.batch, noise, conditions)
        verdicts = judge(conditions, made.poses)
        margins = 1000 * np.array([each.min_margin for each in verdicts])
        deviation = np.sqrt(np.mean(np.sum((made.z[:, :size] - reference) ** 2, axis=-1)))
        table.append(
            [
                str(size), name, f"{sum(each.satisfied for each in verdicts)} of {settings.cases}",
                str(sum(each is not None and each.hypotheses_hold for each in made.records)), f"{deviation:.3f}",
                f"{margins.min():.1f}", f"{margins.mean():.1f}",
                str(sum(each.satisfied for each in judge(default, made.poses))),
                energy_distances(generator.batch(others, repeated).poses, wanted, settings),
            ]
        )  # fmt: skip
    times = ratios(runs, settings.rounds)
    return [[*row, times.get(row[1], "")] for row in table]


def ratios(runs: Mapping[str, Callable[[], Any]], rounds: int) -> dict[str, str]:
    """Seconds over those of the first run: medians over rounds in which the runs take turns."""
    taken: dict[str, list[float]] = {name: [] for name in runs}
    for _ in range(rounds):
        for name, run in runs.items():
            start = time.perf_counter()
            run()
            taken[name].append(time.perf_counter() - start)
    first = next(iter(taken.values()))
    return {name: f"{np.median(np.divide(each, first)):.2f}" for name, each in taken.items()}


def demonstrations(conditions: Sequence[Any], seed: int) -> list[Any]:
    """Poses of relaxed random arrangements that meet the conditions, as the training data's do."""
    import jax

    from deggflow.redraw import Candidate, redraw_until_satisfied
    from deggflow.tasks.tabletop.codec import decode_exactly
    from deggflow.tasks.tabletop.condition import to_arrays
    from deggflow.tasks.tabletop.options import SceneRecipe
    from deggflow.tasks.tabletop.relax import relaxed_scenes
    from deggflow.tasks.tabletop.verdict import judge

    recipe, root = SceneRecipe(), jax.random.key(seed)
    arrays = to_arrays(conditions)

    def attempt(index: Sequence[int], number: int) -> list[Candidate[Any]]:
        # All of them each time, so that one program does.
        keys = jax.random.split(jax.random.fold_in(root, number), len(conditions))
        z = np.asarray(relaxed_scenes(keys, arrays, recipe.clearance)[0])
        poses = [decode_exactly(z[k], conditions[k]) for k in index]
        found = [each.min_margin for each in judge([conditions[k] for k in index], poses)]
        return [Candidate(p, m >= recipe.spare, m) for p, m in zip(poses, found, strict=True)]

    return [each.sample for each in redraw_until_satisfied(attempt, len(conditions), 50)]


def energy_distances(poses: Sequence[Any], wanted: Sequence[Any], settings: Settings) -> str:
    """Between scenes and demonstrations of each condition; positions over half the table, headings as unit vectors."""
    from scipy.spatial.distance import cdist, pdist

    from deggflow.tasks.tabletop.library import TABLE_DEPTH, TABLE_WIDTH

    def features(some: Sequence[Any]) -> Any:
        x, y, theta = np.moveaxis(np.array(some), -1, 0)
        scaled = 2 * x / TABLE_WIDTH, 2 * y / TABLE_DEPTH, np.cos(theta), np.sin(theta)
        return np.concatenate(scaled, axis=-1)

    found = []
    for k in range(settings.demonstrated):
        part = slice(k * settings.demonstrations, (k + 1) * settings.demonstrations)
        ours, theirs = features(poses[part]), features(wanted[part])
        found.append(2 * cdist(ours, theirs).mean() - pdist(ours).mean() - pdist(theirs).mean())
    return f"{np.mean(found):.3f} +- {np.std(found, ddof=1) / np.sqrt(len(found)):.3f}"


def bridge(settings: Settings) -> None:
    head = (
        "N", "guidance, evaluations", "bridged", "policies", "met, first draw", "hypotheses hold", "deviation", "least margin",
        "duration", "effort", "refuted", "nominal bridged", "time",
    )  # fmt: skip
    for size in settings.sizes or (4, 6, 8):
        show(head, trials(settings, size))
    print(
        f"\n{settings.trials} trials, seed {settings.seed}. policies: generated in all; deviation: RMS distance per robot, in z, "
        "of guided policies to the nominal ones of 50 steps from the same states and z(0); least margin: mm, to any failure; "
        "duration: of bridged trials, s; effort: mean of their integrals of the squared twist; refuted: by the replay; time: of "
        "a batch of policies, over that of the first row, median of rounds in which the rows take turns."
    )


def trials(settings: Settings, size: int) -> list[list[str]]:
    """The table's rows of one size."""
    import jax

    from deggflow import EveryStep, ExtrapolatedEndpoint
    from deggflow.tasks.bridge.field import load_field
    from deggflow.tasks.bridge.generator import BridgeGenerator, Round
    from deggflow.tasks.bridge.oracle import refutation
    from deggflow.tasks.bridge.policies import PolicyGenerator, initial_noise, rounded
    from deggflow.tasks.bridge.requirements import bridge_guidance
    from deggflow.tasks.bridge.scenes import random_conditions
    from deggflow.tasks.bridge.world import DT

    field = load_field()
    guidance = bridge_guidance(field.scales)
    wanted = random_conditions(size, settings.trials, settings.seed)
    rounds: list[Round] = []
    BridgeGenerator(field, guidance, drift=EveryStep()).trials(
        wanted, seed=settings.seed, on_round=rounds.append
    )
    states = jax.tree.map(lambda *leaves: np.concatenate(leaves), *(r.condition for r in rounds))
    noise = initial_noise(settings.seed, np.arange(len(states.plank)), 0, 0)
    noise = noise[:, : states.mask.shape[1]]

    def nominal_bridged(drift: Any) -> str:
        return str(
            sum(
                t.success
                for t in BridgeGenerator(field, drift=drift).trials(wanted, seed=settings.seed)
            )
        )

    reference = PolicyGenerator(field, drift=EveryStep()).draw(noise, rounded(states)).z
    table, runs = [], {}
    for name, drift in ways(
        settings.evaluations or (12, 8), lambda m: ExtrapolatedEndpoint(m, power=1.5)
    ).items():
        made = BridgeGenerator(field, guidance, drift=drift).trials(wanted, seed=settings.seed)
        policies = PolicyGenerator(field, guidance, drift=drift)
        drawn = policies.draw(noise, rounded(states))
        runs[name] = partial(policies.draw, noise, rounded(states))
        records = [each for trial in made for each in trial.certificate.policies]
        square = np.sum((np.asarray(drawn.z) - reference) ** 2, axis=-1)
        bridged = [trial for trial in made if trial.success]
        table.append(
            [
                str(size), name, f"{len(bridged)} of {settings.trials}", str(len(records)),
                str(sum(each.met and each.draws == 1 for each in records)),
                str(sum(each.generation is not None and each.generation.hypotheses_hold for each in records)),
                f"{np.sqrt(square[states.mask].mean()):.3f}",
                f"{1000 * min(trial.certificate.min_margin for trial in made):.0f}",
                f"{DT * np.mean([len(trial.twists) for trial in bridged]):.1f}",
                f"{DT * np.mean([np.sum(trial.twists**2) for trial in bridged]):.3f}",
                str(sum(refutation(trial.to_json()) is not None for trial in made)), nominal_bridged(drift),
            ]
        )  # fmt: skip
    times = ratios(runs, settings.rounds)
    return [[*row, times[row[1]]] for row in table]


def main(settings: Settings) -> None:
    prepare_jax()
    (tabletop if settings.task == "tabletop" else bridge)(settings)


if __name__ == "__main__":
    main(tyro.cli(Settings))
