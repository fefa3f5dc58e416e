"""Trained weights as a safetensors file with a JSON card beside it. Nothing is unpickled."""

import json
from pathlib import Path
from typing import Any, TypeVar

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
from safetensors import SafetensorError
from safetensors.numpy import load_file, save

from .files import StrPath, write_atomically
from .jsonl import InputError, read_json

M = TypeVar("M", bound=eqx.Module)


def _is_weight(leaf: Any) -> bool:
    """Whether a leaf is an array of weights or stands for one (in a skeleton of shapes)."""
    return isinstance(leaf, jax.ShapeDtypeStruct) or eqx.is_inexact_array(leaf)


def _named_arrays(module: eqx.Module) -> dict[str, Any]:
    arrays = eqx.filter(module, _is_weight)
    return {
        jax.tree_util.keystr(path).lstrip("."): leaf
        for path, leaf in jax.tree_util.tree_leaves_with_path(arrays)
    }


def card_path(path: StrPath) -> Path:
    """Where the card of a weights file lies: beside it, the same name with .json."""
    path = Path(path)
    if path.name in ("", ".."):
        raise InputError("is a folder; name a file", file=path)
    return path.with_suffix(".json")


def save_weights(path: StrPath, module: eqx.Module, card: dict[str, Any]) -> None:
    """Writes `path` (safetensors) and the card beside it (same name, .json)."""
    path = Path(path)
    arrays = {name: np.asarray(leaf) for name, leaf in _named_arrays(module).items()}
    write_atomically(path, save(arrays))
    write_atomically(card_path(path), json.dumps(card, indent=2) + "\n")


def load_card(path: StrPath) -> dict[str, Any]:
    """The card of a weights file.

    Raises:
        InputError: The card can't be read, or is not a JSON object.
    """
    path = card_path(path)
    try:
        return read_json(path)
    except FileNotFoundError:
        raise InputError("there is no such card; it lies beside the weights", file=path) from None


def load_weights(path: StrPath, skeleton: M) -> M:
    """The skeleton with its arrays replaced by those of the file.

    The skeleton may hold arrays or only their shapes (`eqx.filter_eval_shape`).

    Raises:
        InputError: The file can't be read, is no safetensors file, or its arrays are not those of the skeleton, or not
            finite; names the file and the array.
    """
    try:
        stored = load_file(path)
    except OSError as error:
        raise InputError(f"can't be read: {error.strerror or error}", file=path) from None
    except (SafetensorError, ValueError, TypeError, KeyError) as error:
        raise InputError(f"is no safetensors file: {error}", file=path) from None
    wanted = _named_arrays(skeleton)
    for name in sorted(stored.keys() ^ wanted.keys()):
        where = "the file" if name in stored else "this field"
        raise InputError(f"does not hold this field's weights: only {where} has {name}", file=path)
    for name, leaf in wanted.items():
        given = stored[name]
        if given.shape != leaf.shape:
            raise InputError(
                f"{name} has shape {given.shape}, this field needs {leaf.shape}", file=path
            )
        if not jnp.issubdtype(given.dtype, jnp.floating):
            raise InputError(f"{name} must hold floats; got {given.dtype}", file=path)
        if not np.all(np.isfinite(given)):
            raise InputError(f"{name} holds numbers that are not finite", file=path)
    leaves = [jnp.asarray(stored[name]) for name in wanted]
    arrays, rest = eqx.partition(skeleton, _is_weight)
    return eqx.combine(jax.tree.unflatten(jax.tree.structure(arrays), leaves), rest)
