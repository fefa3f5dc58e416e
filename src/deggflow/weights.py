"""Trained weights as a safetensors file with a JSON card beside it. Nothing is unpickled."""

import json
from collections.abc import Callable, Mapping
from hashlib import sha256
from importlib.resources import files
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

_KEY = "deggflow"  # metadata key of digest and owner; a single key, as the order of several is not fixed


def _is_weight(leaf: Any) -> bool:
    """Whether a leaf is an array of weights, or the shape of one in a skeleton."""
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
    """Writes the leaves of a tree of arrays by name, with a digest that detects damage to the file.

    A kill leaves the old file or the new one. `owner` distinguishes files with the same arrays.
    """
    arrays = {name: np.asarray(leaf) for name, leaf in _named(tree).items()}
    write_atomically(path, save(arrays, {_KEY: f"{_digest(arrays)} {owner}"}))


def load_arrays(path: StrPath, like: T, owner: str = "") -> T:
    """Reads the arrays that `save_arrays` wrote.

    Args:
        path: A safetensors file.
        like: A tree of the same names, with arrays of the same shapes, or only their shapes.
        owner: The owner that the file was saved with.

    Raises:
        InputError: The file can't be read, is damaged, or holds other arrays; names the file and the array.
    """
    try:
        with safe_open(path, "numpy") as file:
            label = (file.metadata() or {}).get(_KEY)
            stored = {name: file.get_tensor(name) for name in file.keys()}  # noqa: SIM118
    except OSError as error:
        raise InputError(f"can't be read: {error.strerror or error}", file=path) from None
    except (SafetensorError, ValueError, TypeError, KeyError) as error:
        raise InputError(f"is no safetensors file: {error}", file=path) from None
    leaves = _named(like)
    for name in sorted(stored.keys() ^ leaves.keys()):
        where = "only the file" if name in stored else "not the file"
        raise InputError(f"does not hold these arrays: {where} has {name}", file=path)
    for name, leaf in leaves.items():
        array = stored[name]
        if array.shape != leaf.shape:
            raise InputError(f"{name} has shape {array.shape}, not {leaf.shape}", file=path)
        kinds = [jnp.issubdtype(each.dtype, jnp.inexact) for each in (array, leaf)]
        if kinds[0] != kinds[1]:
            what = "floats" if kinds[1] else "integers"
            raise InputError(f"{name} must hold {what}; got {array.dtype}", file=path)
    actual_digest = _digest(stored)
    digest, _, file_owner = (f"{actual_digest} " if label is None else label).partition(" ")
    if digest != actual_digest:
        raise InputError("was damaged after it was written: its digest does not match", file=path)
    if file_owner != owner:
        raise InputError("belongs to something else: its owner does not match", file=path)
    arrays = [jnp.asarray(stored[name]) for name in leaves]
    return jax.tree.unflatten(jax.tree.structure(like), arrays)


def card_path(path: StrPath) -> Path:
    """Path of the card of a weights file: beside it, with the suffix .json."""
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
        raise InputError(
            "there is no such card; it must lie beside the weights", file=path
        ) from None


def packaged_weights(package: str) -> Path:
    """The trained weights inside a package, in its folder `weights`."""
    return Path(str(files(package))) / "weights" / "field.safetensors"


def load_by_card(path: StrPath, skeleton: Callable[[Mapping[str, Any]], M]) -> M:
    """Reads a module from a weights file whose card describes the module.

    Args:
        path: The weights file.
        skeleton: Makes the skeleton for `load_weights` from the card; raises `InputError` naming an invalid field.
    """
    card = load_card(path)
    try:
        module = skeleton(card)
    except InputError as error:
        raise InputError(error.reason, file=card_path(path), field=error.field) from None
    return load_weights(path, module)


def expect_sizes(card: Mapping[str, Any], largest: Mapping[str, int]) -> dict[str, int]:
    """Checks the sizes of a network under a card's key "architecture"; each lies between 1 and its largest value."""
    names = tuple(largest)
    sizes = expect_object(card.get("architecture"), "architecture", names, names)
    return {
        name: expect_integer(sizes[name], f"architecture.{name}", 1, most)
        for name, most in largest.items()
    }


def load_weights(path: StrPath, skeleton: M) -> M:
    """The skeleton with its arrays replaced by those of a file.

    The skeleton may hold arrays or only their shapes (`eqx.filter_eval_shape`).

    Raises:
        InputError: The file can't be read, is damaged, or its arrays are not those of the skeleton, or not finite;
            names the file and the array.
    """
    weights, rest = eqx.partition(skeleton, _is_weight)
    arrays = load_arrays(path, weights)
    for name, array in _named(arrays).items():
        if not jnp.all(jnp.isfinite(array)):
            raise InputError(f"{name} holds numbers that are not finite", file=path)
    return eqx.combine(arrays, rest)
