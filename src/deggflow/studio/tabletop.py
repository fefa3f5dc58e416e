"""What the studio does with scenes: makes them, judges them, replays their generation, reads and writes them."""

import json
from collections.abc import Callable, Mapping
from dataclasses import replace
from functools import lru_cache
from threading import Lock
from typing import Any

import numpy as np

from deggflow.certificate import Certificate
from deggflow.flow import Field
from deggflow.jsonl import expect_choice, expect_integer
from deggflow.redraw import with_draws
from deggflow.tasks.tabletop.changes import random_conditions
from deggflow.tasks.tabletop.condition import SceneCondition
from deggflow.tasks.tabletop.formats import MAX_SEED, parse_scene
from deggflow.tasks.tabletop.generator import MAX_DRAWS, TabletopGenerator, initial_noise, judged
from deggflow.tasks.tabletop.library import MAX_OBJECTS
from deggflow.tasks.tabletop.scene import Scene
from deggflow.tasks.tabletop.settled import judge_generated
from deggflow.tasks.tabletop.task import scene_generator
from deggflow.tasks.tabletop.verdict import Poses, judge

from .desk import NOBODY, Answers, Asker, TaskDesk
from .messages import Nothing, Open, command
from .shown import judgement, library, rounded
from .tabletop_exports import SCENE_EXPORTS
from .tabletop_messages import (
    Claim,
    Draw,
    Generate,
    Judge,
    Replay,
    Write,
    checked_scene,
    studio_condition,
)

FAMILIES = ("default", "changed", "opposite", "side", "larger", "combined", "balanced")


class TabletopDesk(TaskDesk):
    """Answers pages on the tabletop task. Compiled programs are shared by all pages, and nothing else."""

    def __init__(self, load_field: Callable[[], Field]) -> None:
        """Args: load_field: called once, when the first scene is requested."""
        self._load_field = load_field
        self._loaded: tuple[TabletopGenerator, TabletopGenerator] | None = None
        # One at a time: two threads would compile the same program twice.
        self._loading, self._generating, self._replaying = Lock(), Lock(), Lock()
        self._nominal = lru_cache(maxsize=32)(self._nominal_poses)

    def answers(self) -> Answers:
        """Scenes, verdicts, replays, random conditions and files."""
        return {
            "library": (Nothing, lambda request, asker: library()),
            "generate": (Generate, self._generate),
            "replay": (Replay, self._replay),
            "judge": (Judge, self._judge),
            "line": (Claim, self._line),
            "draw": (Draw, self._draw),
            "open": (Open, self._open),
            "export": (Write, self._export),
        }

    def _generators(self) -> tuple[TabletopGenerator, TabletopGenerator]:
        """The nominal and the guided one, those of the commands."""
        with self._loading:
            if self._loaded is None:
                field = self._load_field()
                self._loaded = scene_generator(field, guided=False), scene_generator(field)
            return self._loaded

    def warm_up(self) -> None:
        """Compiles what the first page asks for, before it does."""
        condition = random_conditions(8, 1, "changed", 0)[0]
        request = Generate(condition.to_json(), 0, MAX_DRAWS, None)
        scene = json.loads(self._generate(request, NOBODY)["line"])
        poses = [[item["x"], item["y"], item["theta"]] for item in scene["objects"]]
        self._replay(Replay(condition.to_json(), 0, 0, poses), NOBODY)

    def _generate(self, request: Generate, asker: Asker) -> dict[str, Any]:
        condition = studio_condition(request.condition)
        seed = expect_integer(request.seed, "seed", 0, MAX_SEED)
        max_draws = expect_integer(request.max_draws, "max_draws", 1, MAX_DRAWS)
        drawn: list[Scene] = []

        def on_draw(number: int, scene: Scene) -> None:
            drawn.append(scene)
            asker.check()

        with self._generating:
            guided = self._generators()[1]
            if request.draw is None:
                (scene,) = guided.scenes(
                    [condition], seed=seed, max_draws=max_draws, keep_trace=True, on_draw=on_draw
                )
                draw = next(k for k, each in enumerate(drawn) if each.poses is scene.poses)
            else:
                draw = expect_integer(request.draw, "draw", 0, MAX_DRAWS - 1)
                batch = guided.batch(_noise(seed, draw), [condition], keep_trace=True)
                scene = with_draws(judged(batch, [condition], seed)[0].sample, draw + 1)
            nominal = self._nominal(condition.objects, condition.width, condition.depth, seed, draw)
        reasons = [each.certificate.reason for each in drawn]
        return {
            **written(scene),
            "draw": draw,
            "refused": [reason for reason in reasons if reason is not None],
            "judgement": judgement(condition, scene.poses),
            "nominal": {
                "poses": rounded(nominal),
                "judgement": judgement(condition, nominal, breaches_only=True),
            },
            "command": None if request.draw is not None else _command(scene, max_draws),
        }

    def _nominal_poses(
        self, objects: tuple[str, ...], width: float, depth: float, seed: int, draw: int
    ) -> Poses:
        """Under other requirements the nominal scene is the same: the field knows objects and table alone."""
        condition = SceneCondition(objects, {}, width, depth)
        batch = self._generators()[0].batch(_noise(seed, draw), [condition])
        return judge_generated([condition], batch.poses).poses[0]

    def _replay(self, request: Replay, asker: Asker) -> dict[str, Any]:
        condition, poses = checked_scene(request)
        seed = expect_integer(request.seed, "seed", 0, MAX_SEED)
        draw = expect_integer(request.draw, "draw", 0, MAX_DRAWS - 1)
        nominal, guided = self._generators()
        z0, paths = _noise(seed, draw)[0], {}
        with self._replaying:
            for name, generator in (("nominal", nominal), ("guided", guided)):
                asker.check()
                path = generator.path(z0, condition, guided.taus)
                paths[name] = judge_generated([condition] * len(path), path).poses
        # This program rounds differently from the one that made the scene; the last picture is the scene.
        apart = float(np.abs(paths["guided"][-1] - poses).max())
        paths["guided"][-1] = poses
        return {
            "tau": guided.taus.tolist(),
            "apart": apart,
            **{name: [rounded(each) for each in path] for name, path in paths.items()},
        }

    def _judge(self, request: Judge, asker: Asker) -> dict[str, Any]:
        return judgement(*checked_scene(request))

    def _line(self, request: Claim, asker: Asker) -> dict[str, Any]:
        condition, poses = checked_scene(request)
        seed = expect_integer(request.seed, "seed", 0, MAX_SEED)
        verdict = judge([condition], [poses])[0]
        reason = verdict.reason(condition.objects)
        claim = Certificate(verdict.satisfied, verdict.min_margin, verdict.violation, 1, reason)
        return written(Scene(condition, poses, claim, seed))

    def _draw(self, request: Draw, asker: Asker) -> dict[str, Any]:
        family = expect_choice(request.family, "family", FAMILIES)
        size = expect_integer(request.size, "size", 1, MAX_OBJECTS)
        seed = expect_integer(request.seed, "seed", 0, MAX_SEED)
        (condition,) = random_conditions(size, 1, family, seed)
        return {"condition": condition.to_json()}

    def _open(self, request: Open, asker: Asker) -> dict[str, Any]:
        def parse(value: Any) -> dict[str, Any]:
            if isinstance(value, dict) and "condition" in value:
                return written(parse_scene(_shown(value, "condition.")))
            return {"condition": _shown(value)}

        return request.rows(parse, "tabletop condition or scene", asker.check)

    def _export(self, request: Write, asker: Asker) -> dict[str, Any]:
        return request.of(SCENE_EXPORTS)(*checked_scene(request)).to_json()


def _noise(seed: int, draw: int) -> Any:
    """z(0) of the first scene of a run, as of the command."""
    return initial_noise(seed, np.array([0]), draw)


def _shown(value: Any, prefix: str = "") -> Any:
    """A line as it is, if the studio can show it."""
    studio_condition(value["condition"] if prefix else value, prefix.rstrip("."))
    return value


def written(scene: Scene) -> dict[str, Any]:
    """A scene's line as it stands in a file, and its trace beside it."""
    certificate = scene.certificate
    record = certificate.generation
    trace: Mapping[str, Any] | None = None
    if record is not None and record.trace is not None:
        trace = {"names": [each.name for each in record.requirements], **vars(record.trace)}
        bare = replace(certificate, generation=replace(record, trace=None))
        scene = replace(scene, certificate=bare)
    return {"line": json.dumps(scene.to_json(), allow_nan=False), "trace": trace}


def _command(scene: Scene, max_draws: int) -> str:
    limit = None if max_draws == MAX_DRAWS else max_draws
    asked = scene.condition.to_json()
    return command("tabletop", asked, scene.seed, {"max-draws": limit}, "scene.jsonl")
