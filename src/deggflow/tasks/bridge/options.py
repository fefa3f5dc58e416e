"""The bridge's options of every command. Does not import JAX."""

from dataclasses import dataclass
from pathlib import Path
from typing import ClassVar, Literal

from deggflow.jsonl import InputError
from deggflow.task import options


@dataclass(frozen=True)
class BridgeFieldOptions(options.FieldOptions):
    """As of every task; a policy's grid has 50 steps."""

    most_evaluations: ClassVar[int] = 50

    evaluations: int = 12


@dataclass(frozen=True)
class DemonstrationRecipe(options.Recipe):
    """Which demonstrations are made.

    Attributes:
        sizes: Numbers of robots.
    """

    training: int = 3_000
    validation: int = 200


@dataclass(frozen=True)
class BridgeTrain(options.TrainOptions):
    """How the field is trained.

    Attributes:
        batch: Policies in a training step.
    """

    steps: int = 40_000
    learning_rate: float = 1e-3


@dataclass(frozen=True)
class BridgeGenerate(BridgeFieldOptions, options.ProcessOptions):
    """Which trials are generated, and how.

    Attributes:
        size: Instead of a file: number of robots of randomly drawn trials, 2 to 8.
        count: How many trials to draw with --size (default 1).
        out: File that receives the trials, line by line; rerun the command to resume. Default: stdout.
        guidance: degg: guided; none: the nominal field alone, every policy as it is drawn.
        max_draws: How often a policy is drawn again until it is below its bounds; then the team stops.
        speed_limit: Largest speed of every robot's contact point, m/s: a private requirement of each robot.
    """

    in_world: ClassVar[bool] = True

    speed_limit: float | None = None

    def __post_init__(self) -> None:
        super().__post_init__()
        if self.speed_limit is None:
            return
        if not 0.01 <= self.speed_limit <= 10:
            raise InputError(f"--speed-limit must lie in [0.01, 10] m/s; got {self.speed_limit}")
        if not self.guided:
            raise InputError(
                "--speed-limit goes with --guidance degg; the nominal field cannot enforce a limit"
            )


@dataclass(frozen=True)
class BridgeEvaluate(BridgeFieldOptions, options.EvaluateOptions):
    """What is measured.

    Attributes:
        sizes: Numbers of robots.
        seed: Seed of trials and of z(0).
        max_draws: How often a policy is drawn again.
        trials: Random trials of each size.
        modes: Instead: so many trials from one symmetric start, and on which side planks pass.
        figure: With --modes: file that receives the planks' paths as a figure (.png, .pdf or .svg).
        hard: Instead: one guided policy from each of so many hard states of each size, next to a wall or the gap.
    """

    trials: int = 50
    modes: int = 0
    figure: Path | None = None
    hard: int = 0

    def __post_init__(self) -> None:
        super().__post_init__()
        options.check_range("hard", self.hard, 0, options.MAX_COUNT)
        options.check_range("trials", self.trials, 1, options.MAX_COUNT)
        options.check_range("modes", self.modes, 0, options.MAX_COUNT)
        if self.hard and self.modes:
            raise InputError("--hard and --modes measure different things; give one")
        endings = (".png", ".pdf", ".svg")
        if self.figure is not None and (not self.modes or self.figure.suffix not in endings):
            raise InputError("--figure goes with --modes, and ends in .png, .pdf or .svg")


@dataclass(frozen=True)
class BridgeRender(BridgeFieldOptions, options.RenderOptions):
    """What is drawn of each trial.

    Attributes:
        nominal: Draw the end of the nominal trial from the same start and z(0) beside each.
        process: Also draw the complete process: robots drive to the plank, build the bridge, cross it.
        video: Also write a video, of the complete process with --process, beside the nominal one with --nominal.
        curves: Also draw q_task and q_safe under their bounds while an early, a middle and a late policy were generated.
        renderer: auto: MuJoCo where a GL library is found, else a top view by matplotlib.
        weights: Weights the trials were generated with, for --nominal and --curves.
    """

    nominal: bool = False
    process: bool = False
    video: bool = False
    curves: bool = False
    renderer: Literal["auto", "mujoco", "matplotlib"] = "auto"


OPTIONS = options.TaskOptions(
    data=DemonstrationRecipe,
    train=BridgeTrain,
    generate=BridgeGenerate,
    evaluate=BridgeEvaluate,
    render=BridgeRender,
)
