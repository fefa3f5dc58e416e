"""By what a certificate sees that it is asked about other requirements, or another condition, than a sample was made under."""

from collections.abc import Iterator, Sequence
from dataclasses import fields, is_dataclass
from functools import partial
from hashlib import sha256
from types import CodeType, FunctionType, MethodType
from typing import Any

import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Integer

_ENTRIES = 4096  # of a large array that are looked at
_DEPTH = 12  # of objects within objects


class _UnknownError(Exception):
    """Something is not known before the program runs."""


def requirement_numbers(requirements: Sequence[Any]) -> Integer[np.ndarray, " requirements"]:
    """A number for each requirement, from its settings, its arrays, and its functions with what they close over.

    Functions are told apart by their code, their defaults, and the numbers, texts, arrays, functions and modules they
    close over or name as globals; lists, dictionaries and other objects, which may change, are not looked into. A
    requirement that holds values known only inside a compiled program has the number 0, which stands for any.
    """
    return np.array([_number(each) for each in requirements], np.uint32)


def _number(value: Any) -> int:
    digest = sha256()
    try:
        for text in _parts(value, _DEPTH):
            digest.update(text)
            digest.update(b"\0")
    except _UnknownError:
        return 0
    return max(1, int.from_bytes(digest.digest()[:4], "little"))


def _parts(value: Any, depth: int) -> Iterator[bytes]:
    if depth == 0:
        return
    yield type(value).__qualname__.encode()
    if isinstance(value, jax.core.Tracer):
        raise _UnknownError
    if isinstance(value, bool | int | float | complex | str | bytes | None):
        yield repr(value).encode()
    elif isinstance(value, jax.Array | np.ndarray | np.generic):
        yield from _of_array(value)
    elif isinstance(value, tuple):
        for each in value:
            yield from _parts(each, depth - 1)
    elif isinstance(value, partial):
        yield from _parts((value.func, value.args, tuple(value.keywords.items())), depth - 1)
    elif isinstance(value, MethodType):
        yield from _parts((value.__func__, value.__self__), depth - 1)
    elif isinstance(value, FunctionType):
        yield from _of_function(value, depth - 1)
    elif is_dataclass(value) and not isinstance(value, type):
        for field in fields(value):
            yield from _parts(getattr(value, field.name, None), depth - 1)
    elif hasattr(value, "__wrapped__"):  # compiled by `jax.jit`
        yield from _parts(value.__wrapped__, depth - 1)


def _of_array(value: Any) -> Iterator[bytes]:
    if jnp.issubdtype(value.dtype, jax.dtypes.extended):
        value = jax.random.key_data(value)
    entries = np.asarray(value).reshape(-1)
    yield f"{value.dtype} {value.shape}".encode()
    yield np.ascontiguousarray(entries[:: 1 + len(entries) // _ENTRIES]).tobytes()


def _of_function(value: FunctionType, depth: int) -> Iterator[bytes]:
    yield value.__qualname__.encode()
    yield from _of_code(value.__code__)
    contents = [value.__defaults__, *(value.__kwdefaults__ or {}).values()]
    for cell in value.__closure__ or ():
        try:
            contents.append(cell.cell_contents)
        except ValueError:  # not assigned yet
            continue
    global_values = (value.__globals__.get(name) for name in value.__code__.co_names)
    plain = bool | int | float | complex | str | np.ndarray | jax.Array
    for each in (*contents, *(one for one in global_values if isinstance(one, plain))):
        yield from _parts(each, depth)


def _of_code(code: CodeType) -> Iterator[bytes]:
    yield code.co_code
    yield repr(code.co_names).encode()
    for constant in code.co_consts:
        if isinstance(constant, CodeType):
            yield from _of_code(constant)
        else:
            yield repr(constant).encode()


def fingerprint(condition: Any, dtype: Any) -> Integer[Array, " leaves"]:
    """A number for each array of a condition.

    A sum over the bits of all entries, with weights by their places, modulo 2^32; numbers are compared in the type of the
    states, in which the generation saw them.
    """
    numbers = [_sum_of_bits(leaf, dtype) for leaf in jax.tree.leaves(condition) if _is_number(leaf)]
    return jnp.stack(numbers) if numbers else jnp.zeros(0, jnp.uint32)


def _is_number(leaf: Any) -> bool:
    if isinstance(leaf, bool | int | float):
        return True
    is_array = isinstance(leaf, jax.Array | np.ndarray | np.generic)
    return is_array and (jnp.issubdtype(leaf.dtype, jnp.number) or leaf.dtype == bool)


def _sum_of_bits(leaf: Any, dtype: Any) -> Integer[Array, ""]:
    values = jnp.asarray(leaf)
    floating = jnp.issubdtype(values.dtype, jnp.floating)
    bits = jax.lax.bitcast_convert_type(values.astype(dtype if floating else jnp.int32), jnp.uint32)
    places = jnp.arange(bits.size, dtype=jnp.uint32)
    # Mixed before they are weighted, so that entries that change together do not cancel.
    mixed = (bits.ravel() ^ (bits.ravel() >> 15)) * jnp.uint32(0x85EBCA6B)
    mixed = (mixed ^ (mixed >> 13)) * (2 * places + 1) * jnp.uint32(0xC2B2AE35)
    return jnp.sum(mixed ^ (mixed >> 16), dtype=jnp.uint32)
