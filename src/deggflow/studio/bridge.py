"""What the studio does with bridge trials: runs them, shows how policies were generated, reads and writes them."""

import json
from collections.abc import Callable
from functools import lru_cache
from threading import Lock
from typing import Any

import numpy as np

from deggflow.jsonl import expect_integer, parse_line
from deggflow.tasks.bridge import world
from deggflow.tasks.bridge.condition import BridgeCondition
from deggflow.tasks.bridge.consistency import contradictions
from deggflow.tasks.bridge.courses import guided_course
from deggflow.tasks.bridge.field import BridgeField
from deggflow.tasks.bridge.formats import MAX_SEED, parse_condition, parse_trial
from deggflow.tasks.bridge.generator import MAX_DRAWS, BridgeGenerator, Progress
from deggflow.tasks.bridge.oracle import refutation
from deggflow.tasks.bridge.policies import initial_noise
from deggflow.tasks.bridge.scenes import random_conditions
from deggflow.tasks.bridge.task import trial_generator
from deggflow.tasks.bridge.trial import Trial
from deggflow.tasks.bridge.verdict import bridges, margins
from deggflow.view.bridge.results import regenerate
from deggflow.view.colours import ACCENTS

from .bridge_exports import TRIAL_EXPORTS
from .bridge_margins import least_margins
from .bridge_messages import (
    Placed,
    PolicyCourse,
    Random,
    Run,
    Settings,
    Write,
    number_of_policy,
    settings,
)
from .desk import NOBODY, Answers, Asker, TaskDesk
from .messages import Nothing, Open, command

LIMITS = 4  # speed limits whose compiled programs are kept


class BridgeDesk(TaskDesk):
    """Answers pages on the bridge. Compiled programs and recomputed trials are shared by all pages, and nothing else."""

    def __init__(self, load_field: Callable[[], BridgeField]) -> None:
        """Args: load_field: called once, when the first trial is requested."""
        self._field = lru_cache(maxsize=1)(load_field)
        self._generator = lru_cache(maxsize=LIMITS)(self._new_generator)
        self._conditions = lru_cache(maxsize=8)(self._new_conditions)
        self._nominal = lru_cache(maxsize=32)(self._new_nominal)
        self._generating = Lock()  # two threads would compile the same program twice

    def answers(self) -> Answers:
        """Trials, the courses of their policies, random conditions and files."""
        return {
            "world": (Nothing, lambda request, asker: dimensions()),
            "random": (Random, self._random),
            "placed": (Placed, self._placed),
            "run": (Run, self._run),
            "course": (PolicyCourse, self._course),
            "open": (Open, self._open),
            "export": (Write, self._export),
        }

    def warm_up(self) -> None:
        """Compiles what the first page asks for, before it does."""
        condition = random_conditions(4, 1, 0)[0]
        self._run(Run(condition.to_json(), 0, MAX_DRAWS, None), NOBODY)

    def _new_generator(self, guided: bool, speed_limit: float | None) -> BridgeGenerator:
        return trial_generator(self._field(), guided=guided, speed_limit=speed_limit)

    def _new_conditions(self, line: str, number: int) -> tuple[Trial, list[BridgeCondition]]:
        trial = _parsed(line)
        generator = self._generator(True, trial.certificate.speed_limit)
        return trial, regenerate(generator, trial, number + 1)

    def _new_nominal(self, asked: Settings) -> Trial:
        return self._generator(False, None).trials([asked.condition], seed=asked.seed)[0]

    def _random(self, request: Random, asker: Asker) -> dict[str, Any]:
        size = expect_integer(request.size, "size", world.MIN_ROBOTS, world.MAX_ROBOTS)
        seed = expect_integer(request.seed, "seed", 0, MAX_SEED)
        return {"condition": random_conditions(size, 1, seed)[0].to_json()}

    def _placed(self, request: Placed, asker: Asker) -> dict[str, Any]:
        condition = parse_condition(request.condition, "condition")
        return {"start": _trouble(condition.plank, condition.contacts, False),
                "goal": _trouble(condition.goal, condition.contacts, True)}  # fmt: skip

    def _run(self, request: Run, asker: Asker) -> dict[str, Any]:
        asked, told = settings(request), 1

        def on_policy(progress: Progress) -> None:
            nonlocal told
            asker.check()
            new, told = progress.poses[told:].tolist(), len(progress.poses)
            asker.tell({"poses": new, "policy": progress.record.to_json()})

        with self._generating:
            (trials,) = self._generator(True, asked.speed_limit).stream(
                [asked.condition], seed=asked.seed, max_draws=asked.max_draws, on_policy=on_policy
            )
            asker.check()
            nominal = self._nominal(asked._replace(max_draws=1, speed_limit=None))
        trial = trials[0]
        outcome = {"success": nominal.success, "reason": nominal.reason}
        return {
            **examined(trial),
            "nominal": {
                "poses": nominal.poses.tolist(),
                "twists": nominal.twists.tolist(),
                **outcome,
            },
            "command": _command(asked),
        }

    def _course(self, request: PolicyCourse, asker: Asker) -> dict[str, Any]:
        number = expect_integer(request.number, "number", 0, MAX_SEED)
        with self._generating:
            trial, conditions = self._conditions(request.line, number)
            policies = trial.certificate.policies
            policy = number_of_policy(request.policy, len(policies))
            draw = policies[policy].draws
            noise = initial_noise(trial.seed, np.array([number]), policy, draw - 1)[0]
            generator = self._generator(True, trial.certificate.speed_limit).of_draw(draw)
            asker.check()
            return guided_course(generator, noise, conditions[policy]).to_json()

    def _open(self, request: Open, asker: Asker) -> dict[str, Any]:
        def parse(value: Any) -> dict[str, Any]:
            if isinstance(value, dict) and "condition" in value:
                return examined(parse_trial(value))
            return {"condition": parse_condition(value).to_json()}

        return request.rows(parse, "bridge condition or trial", asker.check)

    def _export(self, request: Write, asker: Asker) -> dict[str, Any]:
        return request.of(TRIAL_EXPORTS)(_parsed(request.line)).to_json()


def _parsed(line: str) -> Trial:
    return parse_trial(parse_line(line.encode("utf-8", "surrogatepass")))


def dimensions() -> dict[str, Any]:
    """The world as the page draws it (m, s), and the robots' colours."""
    names = (
        "X_MIN", "X_MAX", "Y_MIN", "Y_MAX", "GAP_LEFT", "GAP_RIGHT", "PLANK_LENGTH", "PLANK_WIDTH",
        "ROBOT_RADIUS", "CONTACT_SIDE", "CENTRE_SIDE", "CONTACT_SPACING", "SUPPORT", "DT", "EXECUTED",
        "MIN_ROBOTS", "MAX_ROBOTS",
    )  # fmt: skip
    return {**{name.lower(): getattr(world, name) for name in names}, "accents": ACCENTS}


def _trouble(pose: Any, contacts: Any, is_goal: bool) -> str | None:
    """What is wrong with the plank at a pose; None if nothing is."""
    at = np.array([pose], np.float64)
    distances = margins(at, contacts)
    if distances.least()[0] < 0:
        return distances.reason(0)
    if is_goal and not bridges(at)[0]:
        return "the plank does not bridge the gap"
    return None


def examined(trial: Trial) -> dict[str, Any]:
    """A trial's line as it stands in a file, its margins, and what independent checks find wrong with it."""
    line = json.dumps(trial.to_json(), allow_nan=False)
    value = json.loads(line)
    wrong = [refutation(value), *(str(each) for each in contradictions(value))]
    refuted = next((each for each in wrong if each is not None), None)
    return {"line": line, "refuted": refuted, "margins": least_margins(trial)}


def _command(asked: Settings) -> str:
    draws = None if asked.max_draws == MAX_DRAWS else asked.max_draws
    options = {"max-draws": draws, "speed-limit": asked.speed_limit}
    return command("bridge", asked.condition.to_json(), asked.seed, options, "trial.jsonl")
