"""The interfaces that a task implements, and the code that all tasks share."""

import importlib
from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    from .data import write_data
    from .formats import Formats
    from .interface import (
        AbstractEvaluation,
        AbstractGenerator,
        AbstractPictures,
        AbstractTask,
        Chunking,
        Claim,
        Examination,
        OnStatus,
        PictureRequest,
        RunSettings,
        Table,
    )
    from .model import AbstractModel, TrainingData
    from .options import (
        CertifyOptions,
        EvaluateOptions,
        FieldOptions,
        GenerateOptions,
        Phase,
        ProcessOptions,
        Recipe,
        RenderOptions,
        TaskOptions,
        TrainOptions,
        check_range,
    )
    from .training import data_files, train_field

# Modules are loaded when first used: options are parsed before JAX is imported.
_HOME = {
    "data": ("write_data",),
    "formats": ("Formats",),
    "interface": (
        "AbstractEvaluation",
        "AbstractGenerator",
        "AbstractPictures",
        "AbstractTask",
        "Chunking",
        "Claim",
        "Examination",
        "OnStatus",
        "PictureRequest",
        "RunSettings",
        "Table",
    ),
    "model": ("AbstractModel", "TrainingData"),
    "options": (
        "CertifyOptions",
        "EvaluateOptions",
        "FieldOptions",
        "GenerateOptions",
        "Phase",
        "ProcessOptions",
        "Recipe",
        "RenderOptions",
        "TaskOptions",
        "TrainOptions",
        "check_range",
    ),
    "training": ("data_files", "train_field"),
}
_MODULE = {name: module for module, names in _HOME.items() for name in names}

__all__ = [
    "AbstractEvaluation",
    "AbstractGenerator",
    "AbstractModel",
    "AbstractPictures",
    "AbstractTask",
    "CertifyOptions",
    "Chunking",
    "Claim",
    "EvaluateOptions",
    "Examination",
    "FieldOptions",
    "Formats",
    "GenerateOptions",
    "OnStatus",
    "Phase",
    "PictureRequest",
    "ProcessOptions",
    "Recipe",
    "RenderOptions",
    "RunSettings",
    "Table",
    "TaskOptions",
    "TrainOptions",
    "TrainingData",
    "check_range",
    "data_files",
    "train_field",
    "write_data",
]


def __getattr__(name: str) -> Any:
    if name in _MODULE:
        return getattr(importlib.import_module(f"{__name__}.{_MODULE[name]}"), name)
    raise AttributeError(f"module {__name__!r} has no attribute {name!r}")
