"""Trained weights as a safetensors file with a JSON card beside it. Nothing is unpickled."""

import json
from collections.abc import Callable, Mapping
from hashlib import sha256
from pathlib import Path
from typing import Any, TypeVar

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
from safetensors import SafetensorError, safe_open
from safetensors.numpy import save

from .files import StrPath, write_atomically
from .jsonl import InputError, expect_integer, expect_object, read_json

M = TypeVar("M", bound=eqx.Module)
T = TypeVar("T")

_KEY = "deggflow"  # of the metadata: digest and owner. One key, as several would come in any order


def _is_weight(leaf: Any) -> bool:
    """Whether a leaf is an array of weights or stands for one (in a skeleton of shapes)."""
    return isinstance(leaf, jax.ShapeDtypeStruct) or eqx.is_inexact_array(leaf)


def _named(tree: Any) -> dict[str, Any]:
    return {
        jax.tree_util.keystr(path).lstrip("."): leaf
        for path, leaf in jax.tree_util.tree_leaves_with_path(tree)
    }


def _digest(arrays: Mapping[str, np.ndarray]) -> str:
    parts = sha256()
    for name, array in sorted(arrays.items()):
        parts.update(f"{name} {array.dtype} {array.shape} ".encode())
        parts.update(np.ascontiguousarray(array).tobytes())
    return parts.hexdigest()


def save_arrays(path: StrPath, tree: Any, owner: str = "") -> None:
    """Writes the leaves of a tree of arrays by name, with a digest that tells whether the file is damaged.

    A kill leaves the old file or the new one. `owner` tells files of the same arrays apart.
    """
    arrays = {name: np.asarray(leaf) for name, leaf in _named(tree).items()}
    write_atomically(path, save(arrays, {_KEY: f"{_digest(arrays)} {owner}"}))


def load_arrays(path: StrPath, like: T, owner: str = "") -> T:
    """The arrays that `save_arrays` wrote.

    Args:
        path: A safetensors file.
        like: A tree of the same names, with arrays of the same shapes, or only their shapes.
        owner: As it was saved.

    Raises:
        InputError: The file can't be read, is damaged, or holds other arrays; names the file and the array.
    """
    try:
        with safe_open(path, "numpy") as file:
            told = (file.metadata() or {}).get(_KEY)
            stored = {name: file.get_tensor(name) for name in file.keys()}  # noqa: SIM118
    except OSError as error:
        raise InputError(f"can't be read: {error.strerror or error}", file=path) from None
    except (SafetensorError, ValueError, TypeError, KeyError) as error:
        raise InputError(f"is no safetensors file: {error}", file=path) from None
    wanted = _named(like)
    for name in sorted(stored.keys() ^ wanted.keys()):
        where = "only the file" if name in stored else "not the file"
        raise InputError(f"does not hold these arrays: {where} has {name}", file=path)
    for name, leaf in wanted.items():
        given = stored[name]
        if given.shape != leaf.shape:
            raise InputError(f"{name} has shape {given.shape}, not {leaf.shape}", file=path)
        kinds = [jnp.issubdtype(each.dtype, jnp.inexact) for each in (given, leaf)]
        if kinds[0] != kinds[1]:
            what = "floats" if kinds[1] else "integers"
            raise InputError(f"{name} must hold {what}; got {given.dtype}", file=path)
    found = _digest(stored)
    digest, _, belongs = (f"{found} " if told is None else told).partition(" ")
    if digest != found:
        raise InputError("was damaged after it was written: its digest is another", file=path)
    if belongs != owner:
        raise InputError("belongs to something else: its owner is another", file=path)
    leaves = [jnp.asarray(stored[name]) for name in wanted]
    return jax.tree.unflatten(jax.tree.structure(like), leaves)


def card_path(path: StrPath) -> Path:
    """Where the card of a weights file lies: beside it, the same name with .json."""
    path = Path(path)
    if path.name in ("", ".."):
        raise InputError("is a folder; name a file", file=path)
    return path.with_suffix(".json")


def save_weights(path: StrPath, module: eqx.Module, card: dict[str, Any]) -> None:
    """Writes `path` (safetensors) and the card beside it (same name, .json)."""
    save_arrays(path, eqx.filter(module, _is_weight))
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


def load_by_card(path: StrPath, skeleton: Callable[[Mapping[str, Any]], M]) -> M:
    """A module from a weights file whose card says which module it is.

    Args:
        path: The weights file.
        skeleton: Makes the skeleton of `load_weights` from the card; raises `InputError` with the card's field that is
            not as it should be.
    """
    card = load_card(path)
    try:
        made = skeleton(card)
    except InputError as error:
        raise InputError(error.reason, file=card_path(path), field=error.field) from None
    return load_weights(path, made)


def expect_sizes(card: Mapping[str, Any], largest: Mapping[str, int]) -> dict[str, int]:
    """The sizes of a network that a card names under "architecture", each from 1 to its largest."""
    given = expect_object(card.get("architecture"), "architecture", tuple(largest), tuple(largest))
    return {
        name: expect_integer(given[name], f"architecture.{name}", 1, most)
        for name, most in largest.items()
    }


def load_weights(path: StrPath, skeleton: M) -> M:
    """The skeleton with its arrays replaced by those of the file.

    The skeleton may hold arrays or only their shapes (`eqx.filter_eval_shape`).

    Raises:
        InputError: The file can't be read, is damaged, or its arrays are not those of the skeleton, or not finite;
            names the file and the array.
    """
    wanted, rest = eqx.partition(skeleton, _is_weight)
    arrays = load_arrays(path, wanted)
    for name, array in _named(arrays).items():
        if not jnp.all(jnp.isfinite(array)):
            raise InputError(f"{name} holds numbers that are not finite", file=path)
    return eqx.combine(arrays, rest)
