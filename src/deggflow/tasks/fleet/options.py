"""The fleet's options of every command. Does not import JAX."""

import hashlib
from dataclasses import dataclass
from pathlib import Path
from typing import Any, Literal

from deggflow.jsonl import InputError
from deggflow.task import options

MapName = Literal["empty", "conveyor", "highways", "drop_region", "dense", "random", "any"]
Scheme = Literal["own", "random"]
WITHOUT_OWN = {"dense", "random", "any"}  # maps without starts and goals of their own


@dataclass(frozen=True)
class FleetFieldOptions(options.FieldOptions):
    """As of every task, and how many nominal paths a robot chooses from.

    Attributes:
        evaluations: How often a generation evaluates the field, for each of the nominal plans.
        guidance_phase: after: guidance acts on the nominal plan; during: throughout the generation, from one z(0).
        candidates: Nominal paths of each robot, of which it chooses one before guidance acts.
    """

    evaluations: int = 8
    guidance_phase: options.Phase = "after"
    candidates: int = 4

    def __post_init__(self) -> None:
        super().__post_init__()
        options.check_range("candidates", self.candidates, 1, 64)


@dataclass(frozen=True)
class FleetRecipe(options.Recipe):
    """Which demonstrations are made.

    Attributes:
        sizes: Numbers of robots.
    """

    training: int = 8_000
    validation: int = 400
    sizes: tuple[int, ...] = (3, 6, 9)


@dataclass(frozen=True)
class FleetTrain(options.TrainOptions):
    """How the field is trained.

    Attributes:
        batch: Plans in a training step.
        width: Width of all layers.
        rounds: Rounds of messages.
        blocks: Residual layers before the first round and after every one.
    """

    width: int = 192
    rounds: int = 1
    blocks: int = 1


@dataclass(frozen=True)
class FleetGenerate(FleetFieldOptions, options.GenerateOptions):
    """Which plans are generated, and how.

    Attributes:
        size: Instead of a file: number of robots of randomly drawn conditions, 1 to 64.
        count: How many conditions to draw with --size (default 1).
        out: File that receives the plans, line by line; rerun the command to resume. Default: stdout.
        max_draws: How often a plan is drawn again until it satisfies its requirements; robots that hold theirs keep
            their paths.
        map: Map of drawn conditions; any: one of the named maps, drawn at random.
        scheme: Starts and goals of drawn conditions: at random, or MMD's own of a map.
        floor: Floor of drawn conditions, instead of --map: an image whose dark pixels are obstacles (.png), or a JSON
            file with the "map" of a condition.
    """

    max_draws: int = 16
    map: MapName = "any"
    scheme: Scheme = "random"
    floor: Path | None = None

    def __post_init__(self) -> None:
        super().__post_init__()
        if self.conditions is not None and (self.map, self.scheme) != ("any", "random"):
            raise InputError("--map and --scheme go with --size, not with --conditions")
        if self.floor is not None and (self.conditions is not None or self.map != "any"):
            raise InputError("--floor goes with --size, instead of --map")
        if self.scheme == "own" and self.map in WITHOUT_OWN:
            raise InputError(
                f"--scheme own goes with --map empty, conveyor, highways or drop_region; got {self.map}"
            )

    def settings(self) -> dict[str, Any]:
        """As of every task; a file of conditions has its own maps, and a floor is known by its bytes."""
        drawn = self.conditions is None
        common = super().settings()
        del common["floor"]
        if self.floor is not None and self.floor.is_file():
            common["floor"] = hashlib.sha256(self.floor.read_bytes()).hexdigest()
        return {
            **common,
            "map": self.map if drawn else "",
            "scheme": self.scheme if drawn else "",
        }


@dataclass(frozen=True)
class FleetEvaluate(FleetFieldOptions, options.EvaluateOptions):
    """What is measured.

    Attributes:
        sizes: Numbers of robots.
        cases: Conditions of each map, scheme and size.
        maps: Maps.
        schemes: Starts and goals: MMD's own of a map, where it has one, and random ones.
    """

    sizes: tuple[int, ...] = (3, 6, 9, 15)
    max_draws: int = 16
    cases: int = 200
    maps: tuple[MapName, ...] = ("empty", "conveyor", "highways", "drop_region", "dense")
    schemes: tuple[Scheme, ...] = ("own", "random")

    def __post_init__(self) -> None:
        super().__post_init__()
        options.check_range("cases", self.cases, 1, options.MAX_COUNT)
        if (
            not self.maps
            or not self.schemes
            or ({*self.schemes} == {"own"} and {*self.maps} <= WITHOUT_OWN)
        ):
            raise InputError(
                "--maps and --schemes must leave something to measure; own starts and goals have empty, conveyor, highways "
                "and drop_region"
            )


@dataclass(frozen=True)
class FleetRender(options.RenderOptions):
    """What is drawn of each plan.

    Attributes:
        video: Also write a video of the robots' motion, with --playback of that in MuJoCo.
        playback: Robots with this drive follow each plan in MuJoCo's dynamics: write the model (MJCF), and say how closely
            they do.
        metres: Of a map unit, in a playback.
        seconds: From a waypoint to the next, in a playback.
        renderer: Of a playback's video; auto: MuJoCo where a GL library is found, else a top view by matplotlib.
    """

    video: bool = False
    playback: Literal["omni", "differential"] | None = None
    metres: float = 4.0
    seconds: float = 1.0
    renderer: Literal["auto", "mujoco", "matplotlib"] = "auto"

    def __post_init__(self) -> None:
        super().__post_init__()
        options.check_range("metres", self.metres, 1e-3, 1e3, "m")
        options.check_range("seconds", self.seconds, 0.05, 60.0, "s")


OPTIONS = options.TaskOptions(
    data=FleetRecipe,
    train=FleetTrain,
    generate=FleetGenerate,
    evaluate=FleetEvaluate,
    render=FleetRender,
)
