"""The tabletop's options of every command. Does not import JAX."""

from dataclasses import dataclass
from pathlib import Path
from typing import Any, Literal

from deggflow.jsonl import InputError
from deggflow.task import options

Family = Literal["default", "changed", "opposite", "side", "larger", "combined", "balanced"]


@dataclass(frozen=True)
class TabletopFieldOptions(options.FieldOptions):
    """How often the field is evaluated, and when guidance acts.

    Attributes:
        guidance_phase: after: guidance acts on the nominal scene; during: throughout the generation, as in the paper.
    """

    guidance_phase: options.Phase = "after"


@dataclass(frozen=True)
class SceneRecipe(options.Recipe):
    """Which training scenes are made.

    Attributes:
        training: Training scenes of each size.
        validation: Validation scenes of each size.
        seed: Seed of the scenes.
        sizes: Numbers of objects.
        clearance: Free space aimed at around objects and regions, m.
        spare: Least margin of a scene that is kept, m.
    """

    clearance: float = 0.10
    spare: float = 0.015

    def __post_init__(self) -> None:
        super().__post_init__()
        options.check_range("clearance", self.clearance, 0.015, 0.5, "m")
        options.check_range("spare", self.spare, 0.0, 1.0, "m")


@dataclass(frozen=True)
class TabletopTrain(options.MessagePassingOptions):
    """How the field is trained.

    Attributes:
        batch: Scenes in a training step.
    """


@dataclass(frozen=True)
class TabletopGenerate(TabletopFieldOptions, options.ProcessOptions):
    """Which scenes are generated, and how.

    Attributes:
        size: Instead of a file: number of objects of randomly drawn scenes: 1 to 12 different ones on the paper's
            table; more are a large scene: types repeat, and the table grows in proportion.
        count: How many scenes to draw with --size (default 1).
        out: File that receives the scenes, line by line; rerun the command to resume. Default: stdout.
        max_draws: How often a scene is drawn again until it satisfies its requirements.
        requirements: How the requirements of drawn scenes are changed.
        trace: Certificates also hold every requirement's value, bound and limit at every point of the generation.
    """

    requirements: Family = "changed"
    trace: bool = False

    def __post_init__(self) -> None:
        super().__post_init__()
        if self.conditions is not None and self.requirements != "changed":
            raise InputError("--requirements goes with --size, not with --conditions")
        if self.processes and self.guidance_phase != "after":
            raise InputError("--processes with a number goes with --guidance-phase after")

    def settings(self) -> dict[str, Any]:
        """As of every task; a file of conditions has its own requirements."""
        family = self.requirements if self.conditions is None else ""
        return {**super().settings(), "requirements": family}


@dataclass(frozen=True)
class TabletopEvaluate(TabletopFieldOptions, options.EvaluateOptions):
    """What is measured.

    Attributes:
        sizes: Numbers of objects.
        cases: Random cases of each size.
        requirements: Families of changed requirements, one table row each.
        compare: Compare the allocations own, pooled and local, re-anchored or not, on first draws instead.
        failures: JSON Lines file to which every guided draw that its verdict refused is added, with the reason.
    """

    cases: int = 1_000
    requirements: tuple[Family, ...] = ("changed",)
    compare: bool = False
    failures: Path | None = None

    def __post_init__(self) -> None:
        super().__post_init__()
        options.check_range("cases", self.cases, 1, options.MAX_COUNT)


@dataclass(frozen=True)
class TabletopRender(TabletopFieldOptions, options.RenderOptions):
    """What is drawn of each scene.

    Attributes:
        nominal: Draw the nominal scene of the same z(0) beside each.
        video: Also write a video of the generation.
        mjcf: Also write each scene as a MuJoCo model (XML).
        renderer: auto: MuJoCo where a GL library is found, else a top view by matplotlib.
        weights: Weights the scenes were generated with, for --nominal and --video.
    """

    nominal: bool = False
    video: bool = False
    mjcf: bool = False
    renderer: Literal["auto", "mujoco", "matplotlib"] = "auto"


OPTIONS = options.TaskOptions(
    data=SceneRecipe,
    train=TabletopTrain,
    generate=TabletopGenerate,
    evaluate=TabletopEvaluate,
    render=TabletopRender,
)
