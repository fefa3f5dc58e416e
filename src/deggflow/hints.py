"""Advice on use that is correct but slow, given once."""

import warnings
from collections import Counter
from typing import Any

import jax

UNCOMPILED_CALLS = 3  # of the same shapes; a call or two by hand are nothing to remark on
_calls = Counter[tuple[str, tuple[int, ...]]]()


def advise_compiling(function: str, z: Any) -> None:
    """Warns at the third call of a function, for states of one shape, that was not compiled as a whole.

    Its loops are traced and compiled in every such call, which takes seconds.

    Args:
        function: Its name.
        z: The states that it returns; under `jax.jit` and other transformations they are tracers.
    """
    if isinstance(z, jax.core.Tracer):
        return
    _calls[function, z.shape] += 1
    if _calls[function, z.shape] == UNCOMPILED_CALLS:
        warnings.warn(
            f"`{function}` was called {UNCOMPILED_CALLS} times outside of `jax.jit`, and each call compiled its loops "
            f"anew. Wrap it once and call that: compiled = equinox.filter_jit({function}). `sample` compiles by itself.",
            stacklevel=3,
        )
