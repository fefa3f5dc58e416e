"""Guidance methods for the tabletop, each with its hyperparameters and the grid over which they are swept."""

from collections.abc import Callable, Mapping
from dataclasses import dataclass, replace

import equinox as eqx
import jax.numpy as jnp
from jaxtyping import Array, Float

from deggflow.baselines import (
    DualFlow,
    EndpointProjection,
    JointBarrier,
    PenaltyGradient,
    SplitBarrier,
    predict_then_correct,
)
from deggflow.flow import Field
from deggflow.generation import DEFAULT_STEPS, Generation, generate_batch
from deggflow.guidance import (
    AbstractAllocation,
    AbstractGuidance,
    DecoupledGuidance,
    LinearSchedule,
    NoGuidance,
    PowerSchedule,
)
from deggflow.shapes import Scalar
from deggflow.step_guard import StepGuard

from .condition import TabletopCondition
from .margins import TABLETOP, scene_margins
from .requirements import LOCAL, OWN, POOLED, affordance
from .verdict import BUFFER

TUNED = 8  # objects of the scenes at which settings were selected; larger scenes use those selected at N = 12
AHEAD = 0.005  # m above h = 0, the target of barriers and projections: without it their rows leave no room for rounding


def flat_margins(
    z: Float[Array, "agents 3"], condition: TabletopCondition
) -> Float[Array, " constraints"]:
    """Every margin h of a scene in one list, in m, each pair once."""
    return jnp.concatenate([margin.reshape(-1) for margin in scene_margins(z, condition)])


class BaselineRun(eqx.Module):
    """One method at one setting of its hyperparameters."""

    guidance: AbstractGuidance
    guard: StepGuard | None = None
    pull: Scalar | None = None  # of the fading field, after a prediction without guidance
    draws: int = 1  # samples drawn at most, until one satisfies

    def generate(
        self,
        field: Field,
        noise: Float[Array, "scenes agents 3"],
        condition: TabletopCondition,
        *,
        keep_path: bool = False,
    ) -> Generation:
        """One draw of every scene; after a prediction, the path is that of the correction."""
        if self.pull is None:
            return generate_batch(
                field, self.guidance, noise, condition,
                guard=self.guard, keep_trace=False, keep_path=keep_path,
            )  # fmt: skip
        return predict_then_correct(
            field, self.guidance, noise, condition,
            steps=DEFAULT_STEPS, pull=self.pull, guard=self.guard, keep_path=keep_path,
        )  # fmt: skip


Hyperparameters = Mapping[str, float]


@dataclass(frozen=True)
class Method:
    """A method with its hyperparameters: the information it requires, its source, and the settings that are tried."""

    name: str
    source: str
    information_required: str  # what an agent, or whoever computes its input, must know besides its own state and field
    make: Callable[[Hyperparameters], BaselineRun]
    default: Hyperparameters  # of ours: what ships; of baselines: the best of the grid at N = 8
    grid: tuple[Hyperparameters, ...]
    ours: bool = False
    crowded: Hyperparameters | None = (
        None  # of baselines: the best of the grid at N = 12, if it is another
    )

    def chosen(self, size: int) -> Hyperparameters:
        """The setting that tables use for a number of objects."""
        return self.crowded if self.crowded is not None and size > TUNED else self.default


def _number(hyperparameters: Hyperparameters, name: str) -> Scalar:
    return jnp.asarray(
        hyperparameters[name], jnp.float32
    )  # not static: one program for all settings


def _ours(
    allocation: AbstractAllocation, *, reanchored: bool
) -> Callable[[Hyperparameters], BaselineRun]:
    def make(hyperparameters: Hyperparameters) -> BaselineRun:
        buffer, power = hyperparameters["buffer"], hyperparameters["power"]
        omega = LinearSchedule() if power == 1 else PowerSchedule(power)
        requirement = affordance(allocation, buffer=buffer, reanchored=reanchored, omega=omega)
        return BaselineRun(DecoupledGuidance((requirement,)), StepGuard())

    return make


def _joint(hyperparameters: Hyperparameters) -> BaselineRun:
    return BaselineRun(JointBarrier(flat_margins, _number(hyperparameters, "gain"), AHEAD))


def _corrected(hyperparameters: Hyperparameters) -> BaselineRun:
    return replace(_joint(hyperparameters), pull=_number(hyperparameters, "pull"))


def _corrected_by_ours(hyperparameters: Hyperparameters) -> BaselineRun:
    return replace(
        _ours(POOLED, reanchored=True)(hyperparameters), pull=_number(hyperparameters, "pull")
    )


def _dual(hyperparameters: Hyperparameters) -> BaselineRun:
    numbers = (_number(hyperparameters, "gain"), _number(hyperparameters, "damping"))
    return BaselineRun(DualFlow(flat_margins, *numbers, buffer=AHEAD))


def _projected(hyperparameters: Hyperparameters) -> BaselineRun:
    start, iterations = _number(hyperparameters, "start"), int(hyperparameters["iterations"])
    return BaselineRun(EndpointProjection(flat_margins, iterations, start, AHEAD))


def _violation(
    z: Float[Array, "agents 3"], condition: TabletopCondition
) -> Float[Array, " agents"]:
    return TABLETOP.violation(z, condition, BUFFER)


def _penalty(hyperparameters: Hyperparameters) -> BaselineRun:
    return BaselineRun(PenaltyGradient(_violation, _number(hyperparameters, "gain")))


def _split(hyperparameters: Hyperparameters) -> BaselineRun:
    return BaselineRun(SplitBarrier(flat_margins, _number(hyperparameters, "gain"), AHEAD))


def _rejection(hyperparameters: Hyperparameters) -> BaselineRun:
    return BaselineRun(NoGuidance(), draws=int(hyperparameters["draws"]))


def _grid(**values: tuple[float, ...]) -> tuple[Hyperparameters, ...]:
    hyperparameters: list[dict[str, float]] = [{}]
    for name, choices in values.items():
        hyperparameters = [
            {**hyperparameters, name: value}
            for hyperparameters in hyperparameters
            for value in choices
        ]
    return tuple(hyperparameters)


_SHIPPED = {"buffer": BUFFER, "power": 1.0}  # the paper's delta, and its omega = 0.1 + 1.8 tau
_OURS = _grid(buffer=(BUFFER, 0.005), power=(1.0, 8.0))
_AFTERWARDS = {**_SHIPPED, "pull": 0.0}
_GAINS = _grid(gain=(0.5, 1.0, 2.0, 4.0, 8.0))
PROPOSED = (
    Method(
        "pooled", "this library", "neighbours' states; two sums over the team",
        _ours(POOLED, reanchored=True), _SHIPPED, _OURS, ours=True,
    ),
    Method(
        "predict, then pooled", "SafeFlowMatcher's phases, this library's guidance", "neighbours' states; two sums over the team",
        _corrected_by_ours, _AFTERWARDS,
        _grid(buffer=(BUFFER, 0.005), power=(1.0,), pull=(0.0, 2.0)), ours=True,
    ),
    Method(
        "local", "this library", "neighbours' states; two sums over neighbours",
        _ours(LOCAL, reanchored=True), _SHIPPED, (_SHIPPED,), ours=True,
    ),
    Method(
        "own", "the paper (PE guidance)", "neighbours' states",
        _ours(OWN, reanchored=False), _SHIPPED, (_SHIPPED,), ours=True,
    ),
)  # fmt: skip
BASELINES = (
    Method(
        "joint barrier QP", "SafeFlow, arXiv:2504.08661", "all states and fields, in one solver",
        _joint, {"gain": 2.0}, _GAINS, crowded={"gain": 1.0},
    ),
    Method(
        "predict, then correct", "SafeFlowMatcher, arXiv:2509.24243", "all states and fields, in one solver",
        _corrected, {"gain": 2.0, "pull": 0.0},
        _grid(gain=(1.0, 2.0, 4.0), pull=(0.0, 2.0)), crowded={"gain": 1.0, "pull": 0.0},
    ),
    Method(
        "dual flow", "Lagrangian dual flows", "neighbours' states and multipliers",
        _dual, {"gain": 2.0, "damping": 4.0},
        _grid(gain=(0.5, 2.0, 8.0), damping=(1.0, 4.0)), crowded={"gain": 8.0, "damping": 4.0},
    ),
    Method(
        "endpoint projection", "PCFM, arXiv:2506.04171", "all states and fields, in one solver",
        _projected, {"start": 0.9999, "iterations": 5.0},
        _grid(start=(0.0, 0.5, 0.9999), iterations=(5.0,)), crowded={"start": 0.5, "iterations": 5.0},
    ),
    Method(
        "penalty gradient", "universal guidance (Bansal et al. 2024)", "neighbours' states",
        _penalty, {"gain": 2.0},
        _grid(gain=(0.5, 1.0, 2.0, 5.0, 10.0, 20.0, 60.0)),
    ),
    Method(
        "equal split with slack", "dec_share_cbf of GCBF+, arXiv:2401.14554", "neighbours' states and fields",
        _split, {"gain": 2.0}, _GAINS, crowded={"gain": 4.0},
    ),
    Method(
        "rejection sampling", "the nominal model, drawn again", "nothing while generating",
        _rejection, {"draws": 16.0}, _grid(draws=(1.0, 4.0, 16.0)),
    ),
)  # fmt: skip
METHODS = (*PROPOSED, *BASELINES)
