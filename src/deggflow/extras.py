"""Packages of optional extras: imported when first used; what to install is said in one line."""

import importlib
from typing import Any

from .jsonl import InputError


def imported(package: str, extra: str, what: str) -> Any:
    """A module of an optional package.

    Args:
        package: Name of the module, such as "pyarrow.parquet".
        extra: The extra of this package that installs it.
        what: Who needs it, for the message.

    Raises:
        InputError: It is not installed.
    """
    try:
        return importlib.import_module(package)
    except ImportError as error:
        root = package.partition(".")[0]
        if error.name is not None and error.name.partition(".")[0] != root:
            raise
        raise InputError(
            f"{what} needs the package {root}: pip install 'deggflow[{extra}]'"
        ) from None
