"""Trained weights as a safetensors file with a JSON card beside it. Nothing is unpickled."""

import json
from pathlib import Path
from typing import Any, TypeVar

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
from safetensors.numpy import load_file, save

from .files import StrPath, write_atomically

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


def save_weights(path: StrPath, module: eqx.Module, card: dict[str, Any]) -> None:
    """Writes `path` (safetensors) and the card beside it (same name, .json)."""
    path = Path(path)
    arrays = {name: np.asarray(leaf) for name, leaf in _named_arrays(module).items()}
    write_atomically(path, save(arrays))
    write_atomically(path.with_suffix(".json"), json.dumps(card, indent=2) + "\n")


def load_card(path: StrPath) -> dict[str, Any]:
    """The card of a weights file.

    Raises:
        OSError: The card can't be read.
        ValueError: The card is not a JSON object.
    """
    path = Path(path).with_suffix(".json")
    try:
        card = json.loads(path.read_text("utf-8"))
    except (ValueError, RecursionError) as error:
        raise ValueError(f"{path}: not JSON: {error}") from None
    if not isinstance(card, dict):
        raise ValueError(f"{path}: must hold a JSON object; got {type(card).__name__}.")
    return card


def load_weights(path: StrPath, skeleton: M) -> M:
    """The skeleton with its arrays replaced by those of the file.

    The skeleton may hold arrays or only their shapes (`eqx.filter_eval_shape`).

    Raises:
        ValueError: Names or shapes in the file are not those of the skeleton.
    """
    stored, wanted = load_file(path), _named_arrays(skeleton)
    if stored.keys() != wanted.keys():
        odd = sorted(stored.keys() ^ wanted.keys())
        raise ValueError(
            f"{path} does not hold this field's weights: {odd[0]} is on one side only."
        )
    for name, leaf in wanted.items():
        if stored[name].shape != leaf.shape:
            raise ValueError(
                f"{path}: {name} has shape {stored[name].shape}, this field needs {leaf.shape}."
            )
    leaves = [jnp.asarray(stored[name]) for name in wanted]
    arrays, rest = eqx.partition(skeleton, _is_weight)
    return eqx.combine(jax.tree.unflatten(jax.tree.structure(arrays), leaves), rest)
