"""Multi-agent flow matching with decoupled generative guidance."""

import importlib
from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    from .certificate import Certificate, certify
    from .generation import Generation, generate, refined_grid
    from .guidance import (
        AdaptiveShares,
        DecoupledGuidance,
        EqualShares,
        FixedShares,
        Local,
        NoGuidance,
        Own,
        Pooled,
        PrivateRequirement,
        SharedFactor,
        SharedRequirements,
        TighteningBound,
        hinge_violation,
        min_norm_input,
    )

__version__ = "0.1.0"

# Loaded when first used: `deggflow --help` must not wait for JAX.
_HOME = {
    "certificate": ("Certificate", "certify"),
    "generation": ("Generation", "generate", "refined_grid"),
    "guidance": (
        "AdaptiveShares",
        "DecoupledGuidance",
        "EqualShares",
        "FixedShares",
        "Local",
        "NoGuidance",
        "Own",
        "Pooled",
        "PrivateRequirement",
        "SharedFactor",
        "SharedRequirements",
        "TighteningBound",
        "hinge_violation",
        "min_norm_input",
    ),
}
_MODULE_OF = {name: module for module, names in _HOME.items() for name in names}

__all__ = [
    "AdaptiveShares",
    "Certificate",
    "DecoupledGuidance",
    "EqualShares",
    "FixedShares",
    "Generation",
    "Local",
    "NoGuidance",
    "Own",
    "Pooled",
    "PrivateRequirement",
    "SharedFactor",
    "SharedRequirements",
    "TighteningBound",
    "certify",
    "generate",
    "hinge_violation",
    "min_norm_input",
    "refined_grid",
]


def __getattr__(name: str) -> Any:
    if name not in _MODULE_OF:
        raise AttributeError(f"module 'deggflow' has no attribute {name!r}")
    value = getattr(importlib.import_module(f"deggflow.{_MODULE_OF[name]}"), name)
    globals()[name] = value
    return value
