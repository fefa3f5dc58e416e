"""The interfaces that a task implements, and the code that all tasks share."""

from typing import TYPE_CHECKING

from deggflow.lazy import lazy_names

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

# Options are parsed before JAX is imported.
__getattr__ = lazy_names(
    __name__,
    {
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
    },
)
