"""Search for trials in which nominal policies fail and guided ones, from the same start and z(0), succeed."""

from collections import Counter
from collections.abc import Iterator, Mapping
from typing import Any, NamedTuple

import numpy as np
from jaxtyping import Float

from deggflow.guidance import DecoupledGuidance
from deggflow.tasks.bridge.assembly import surroundings
from deggflow.tasks.bridge.condition import BridgeCondition
from deggflow.tasks.bridge.courses import SAFE, guided_course, nominal_values
from deggflow.tasks.bridge.evaluate import failure_kind
from deggflow.tasks.bridge.field import BridgeField
from deggflow.tasks.bridge.generator import BridgeGenerator, Replay
from deggflow.tasks.bridge.policies import initial_noise
from deggflow.tasks.bridge.requirements import bridge_guidance
from deggflow.tasks.bridge.scenes import random_conditions
from deggflow.tasks.bridge.trial import Trial
from deggflow.tasks.bridge.verdict import margins
from deggflow.tasks.bridge.world import DT, EXECUTED

from .experiment import UNMET, Progress

MOST = 512  # trials searched
BREAKS = ("plank_leaves", "support_lost", "robot_leaves", "robot_in_gap")  # the first is preferred


class _Replays(NamedTuple):
    """One trial, nominal and guided, from the same start and z(0)."""

    number: int
    nominal: Replay
    guided: Replay


class _Pair(NamedTuple):
    """The nominal and the guided generator of one field."""

    nominal: BridgeGenerator
    guided: BridgeGenerator
    guidance: DecoupledGuidance

    def replays(self, trial: Trial, number: int) -> _Replays:
        """The trial with both generators, by its number in the run."""
        nominal, guided = (
            each.replay(trial.condition, seed=trial.seed, number=number)
            for each in (self.nominal, self.guided)
        )
        return _Replays(number, nominal, guided)


def measure_rescue(
    field: BridgeField,
    size: int,
    seed: int,
    first: int,
    say: Progress,
    *,
    together: int = 1,
    most: int = MOST,
) -> dict[str, Any]:
    """An example among trials number `first` to `first + most - 1`, and statistics of the search.

    The example is the first trial in which nominal policies drive the plank out of the workspace, guided ones bridge the
    gap, and guidance has to act in the guided trial, too, at the time of the nominal failure. If there is none, it is the
    first trial in which nominal policies violate safety and guided ones bridge the gap.
    """
    guidance = bridge_guidance(field.scales)
    pair = _Pair(BridgeGenerator(field), BridgeGenerator(field, guidance), guidance)
    failures: Counter[str] = Counter()
    guided: list[tuple[int, Trial]] = []  # (number, trial)
    example: dict[str, Any] | None = None
    for number, trial in _nominal_trials(pair, size, seed, first, together, most, say):
        if trial.reason is None:
            continue
        kind = failure_kind(trial.reason)
        failures[kind] += 1
        if kind not in BREAKS:
            continue
        replays = pair.replays(trial, number)
        guided.append((number, replays.guided.trial))
        candidate = _example(pair, replays)
        example = example or candidate
        if candidate is not None and is_telling(candidate):
            example = candidate
            break
    unmet = [f"N = {size}, trial {k + 1}: {run.reason}" for k, run in guided if run.reason]
    return {
        "size": size,
        "seed": seed,
        "first": first,
        "scanned": number - first + 1,
        "failures": dict(failures),
        "guided": len(guided),
        "rescued": len(guided) - len(unmet),
        "example": example,
        UNMET: unmet,
    }


def _nominal_trials(
    pair: _Pair, size: int, seed: int, first: int, together: int, most: int, say: Progress
) -> Iterator[tuple[int, Trial]]:
    """Yields (number, trial)."""
    for start in range(first, first + most, together):
        many = f"s {start + 1} to {start + together}" if together > 1 else f" {start + 1}"
        say(f"N = {size}, nominal trial{many}")
        conditions = random_conditions(size, together, seed, start)
        yield from enumerate(pair.nominal.trials(conditions, seed=seed, first=start), start)


def _example(pair: _Pair, replays: _Replays) -> dict[str, Any] | None:
    """Both trials, and both generations at the time of the nominal failure; None if the pair is no example."""
    number, nominal, guided = replays
    policy = len(nominal.conditions) - 1  # executed when the nominal trial failed
    if nominal.trial.success or not guided.trial.success or policy >= len(guided.conditions):
        return None
    failed = nominal.trial
    noise = initial_noise(failed.seed, np.array([number]), policy, 0)[0]
    goals = surroundings(failed.condition, failed.seed, number + 1, drives=False).goals
    return {
        "number": number,
        "kind": failure_kind(str(nominal.trial.reason)),
        "policy": policy + 1,
        "seconds": policy * EXECUTED * DT,
        "nominal": nominal.trial.to_json(),
        "guided": guided.trial.to_json(),
        "robot_goals": goals.tolist(),
        "places": {
            "guided": _place(pair, noise, guided.conditions[policy]),
            "nominal": _place(pair, noise, nominal.conditions[policy]),
        },
    }


def _place(
    pair: _Pair, noise: Float[np.ndarray, "agents dim"], condition: BridgeCondition
) -> dict[str, Any]:
    """q_safe of both generations from one state and one z(0)."""
    course = guided_course(pair.guided.policies, noise, condition)
    nominal = nominal_values(pair.nominal.policies, pair.guidance, noise, condition)
    contacts, plank = condition.contacts[condition.mask].tolist(), np.asarray(condition.plank)
    return {
        "plank": plank.tolist(),
        "margin": float(margins(plank, contacts).plank),
        "hypotheses_hold": course.hypotheses_hold,
        "tau": course.tau.tolist(),
        "q_safe": course.value[:, SAFE].tolist(),
        "beta_safe": course.bound[:, SAFE].tolist(),
        "q_safe_nominal": nominal[:, SAFE].tolist(),
    }


def is_telling(example: Mapping[str, Any]) -> bool:
    """Whether the plank leaves the workspace and a nominal policy would be unsafe in the guided trial, too."""
    place = example["places"]["guided"]
    return (
        example["kind"] == BREAKS[0]
        and place["q_safe_nominal"][-1] > 0
        and place["q_safe"][-1] <= 0
    )


def commands(result: Mapping[str, Any], pictures: str) -> str:
    """The commands that make the trials of a result up to its example, and draw that one with the options `pictures`."""
    line = result["example"]["number"] + 1
    return (
        f"deggflow bridge generate --size {result['size']} --count {line} --seed {result['seed']} --out trials.jsonl\n"
        f"deggflow bridge render trials.jsonl --lines {line} {pictures}"
    )
