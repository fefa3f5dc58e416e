"""The identity of a training run: settings, data by content, the field by its parts."""

import json
import re
from collections.abc import Iterator, Mapping
from dataclasses import asdict, fields, is_dataclass
from functools import partial
from hashlib import sha256
from typing import Any

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np

from .settings import Augment, Dataset, SampleLoss, TrainingConfig
from .store import StoredDataset

CONTENT = ", sha256 "  # between an array's shape and the digest of its bytes
SECTIONS = ("settings", "identity", "functions", "data", "field")  # of config.json


def _qualified_name(value: Any) -> str:
    """Name of a function or class with its module, without private modules, as these move between releases."""
    public = re.match(r"(?:[^_.][^.]*\.)*", f"{value.__module__ or ''}.")
    return f"{public[0] if public else ''}{value.__qualname__}"


def _array_text(value: Any, *, content: bool) -> str:
    text = f"{value.dtype} {value.shape}"
    if not content:
        return text
    if jnp.issubdtype(value.dtype, jax.dtypes.prng_key):
        value = jax.random.key_data(value)
    octets = np.ascontiguousarray(value).reshape(-1).view(np.uint8)
    return f"{text}{CONTENT}{sha256(octets.data).hexdigest()}"


def parts(value: Any, name: str, *, trained: bool) -> Iterator[tuple[str, str]]:
    """The parts of a value and their descriptions, by name: arrays, static fields, functions and classes.

    Args:
        value: A field, a function, a dataset, or part of one.
        name: Name of the value.
        trained: Whether its floating-point arrays change in training; their description then has dtype and shape, but
            not their content.
    """
    if isinstance(value, StoredDataset):
        paths = jax.tree_util.tree_leaves_with_path(value.structure)
        for (path, each), digest in zip(paths, value.digests, strict=True):
            yield name + jax.tree_util.keystr(path), f"{each.dtype} {each.shape}{CONTENT}{digest}"
        return
    leaf = value is None or jax.tree_util.all_leaves([value])
    within = trained and not leaf  # the inside of a leaf is not trained
    if isinstance(value, partial):
        yield name, _qualified_name(type(value))
        for each in ("func", "args", "keywords"):
            yield from parts(getattr(value, each), f"{name}.{each}", trained=within)
    elif is_dataclass(value) and not isinstance(value, type):
        yield name, _qualified_name(type(value))
        for field in fields(value):
            part, fixed = getattr(value, field.name, None), field.metadata.get("static", False)
            yield from parts(part, f"{name}.{field.name}", trained=within and not fixed)
    elif isinstance(value, jax.Array | np.ndarray):
        yield name, _array_text(value, content=not (trained and eqx.is_inexact_array(value)))
    elif leaf:
        if isinstance(value, set | frozenset):
            yield name, f"{{{', '.join(sorted(map(repr, value)))}}}"
        elif hasattr(value, "__qualname__") and hasattr(value, "__module__"):
            yield name, _qualified_name(value)
        else:  # an address in memory differs between processes
            yield name, re.sub(r" at 0x[0-9a-fA-F]+", "", repr(value))
    else:
        inner = jax.tree_util.tree_leaves_with_path(
            value, lambda node: node is not value and (node is None or is_dataclass(node))
        )
        for path, part in inner:
            yield from parts(part, name + jax.tree_util.keystr(path), trained=trained)


def _flat(value: Mapping[str, Any], name: str = "") -> Iterator[tuple[str, Any]]:
    for key, inner in value.items():
        if isinstance(inner, Mapping):
            yield from _flat(inner, f"{name}{key}.")
        else:
            yield f"{name}{key}", inner


def description(
    field: eqx.Module,
    training: Dataset | StoredDataset,
    validation: Dataset,
    config: TrainingConfig,
    identity: Mapping[str, Any],
    loss: SampleLoss,
    augment: Augment | None,
) -> dict[str, dict[str, Any]]:
    """The identity of a run without its number of steps: the sections of config.json.

    Args:
        field: Initial field.
        training: Training data.
        validation: Held-out data.
        config: Settings.
        identity: Further values that identify the run.
        loss: Loss of one sample.
        augment: Augmentation of one sample.

    Raises:
        ValueError: `identity` has values that JSON cannot represent.
    """
    settings = asdict(config)
    del settings["steps"]
    data = {"training": training, "validation": validation}.items()
    functions = {"loss": loss, "augment": augment}.items()
    try:  # in the form in which it is read back: lists for tuples, text for keys
        json_identity = json.loads(json.dumps(dict(identity), allow_nan=False))
    except (TypeError, ValueError) as error:
        raise ValueError(f"`identity` must hold values that JSON can represent: {error}.") from None
    return {
        "settings": settings,
        "identity": dict(_flat(json_identity)),
        "functions": {
            k: v for name, each in functions for k, v in parts(each, name, trained=False)
        },
        "data": {k: v for name, each in data for k, v in parts(each, name, trained=False)},
        "field": dict(parts(field, "field", trained=True)),
    }
