"""Multi-agent flow matching with decoupled generative guidance."""

import importlib
from typing import TYPE_CHECKING, Any

from .lazy import lazy_names

if TYPE_CHECKING:
    from . import requirements
    from .certificate import Certificate
    from .certification import Trajectory, certify, certify_batch, verdicts
    from .drift import (
        AfterPrediction,
        EveryStep,
        Extrapolated,
        ExtrapolatedEndpoint,
        Held,
        Midpoint,
    )
    from .frames import to_pandas
    from .generation import Generation, generate, generate_batch, refined_grid
    from .guidance import (
        DecoupledGuidance,
        Fixed,
        Local,
        NoGuidance,
        Own,
        Pooled,
        PrivateRequirement,
        SharedFactor,
        SharedRequirements,
        TighteningBound,
        distances,
        hinge_violation,
        min_norm_input,
        safe_norm,
    )
    from .plotting import plot
    from .pretrained import ModelCard, from_pretrained, save_pretrained
    from .sampling import Samples, sample
    from .solver import EULER, HEUN, RK4
    from .step_guard import StepGuard

__version__ = "0.1.0"

__all__ = [
    "EULER",
    "HEUN",
    "RK4",
    "AfterPrediction",
    "Certificate",
    "DecoupledGuidance",
    "EveryStep",
    "Extrapolated",
    "ExtrapolatedEndpoint",
    "Fixed",
    "Generation",
    "Held",
    "Local",
    "Midpoint",
    "ModelCard",
    "NoGuidance",
    "Own",
    "Pooled",
    "PrivateRequirement",
    "Samples",
    "SharedFactor",
    "SharedRequirements",
    "StepGuard",
    "TighteningBound",
    "Trajectory",
    "certify",
    "certify_batch",
    "distances",
    "from_pretrained",
    "generate",
    "generate_batch",
    "hinge_violation",
    "min_norm_input",
    "plot",
    "refined_grid",
    "requirements",
    "safe_norm",
    "sample",
    "save_pretrained",
    "to_pandas",
    "verdicts",
]

_load = lazy_names(
    __name__,
    {
        "certificate": ("Certificate",),
        "certification": ("Trajectory", "certify", "certify_batch", "verdicts"),
        "drift": (
            "AfterPrediction",
            "EveryStep",
            "Extrapolated",
            "ExtrapolatedEndpoint",
            "Held",
            "Midpoint",
        ),
        "frames": ("to_pandas",),
        "generation": ("Generation", "generate", "generate_batch", "refined_grid"),
        "guidance": (
            "DecoupledGuidance",
            "Fixed",
            "Local",
            "NoGuidance",
            "Own",
            "Pooled",
            "PrivateRequirement",
            "SharedFactor",
            "SharedRequirements",
            "TighteningBound",
            "distances",
            "hinge_violation",
            "min_norm_input",
            "safe_norm",
        ),
        "plotting": ("plot",),
        "pretrained": ("ModelCard", "from_pretrained", "save_pretrained"),
        "sampling": ("Samples", "sample"),
        "solver": ("EULER", "HEUN", "RK4"),
        "step_guard": ("StepGuard",),
    },
)


def __getattr__(name: str) -> Any:
    """Loads names when they are first used: `deggflow --help` must not wait for JAX."""
    if name == "requirements":
        return importlib.import_module("deggflow.requirements")
    return _load(name)


def __dir__() -> list[str]:
    """All public names, loaded or not, for completion and documentation."""
    return sorted({*globals(), *__all__})
