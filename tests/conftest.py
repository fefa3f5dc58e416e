import gc
from pathlib import Path

import jax
import pytest

jax.config.update("jax_numpy_rank_promotion", "raise")


@pytest.fixture
def key():
    return jax.random.key(0)


PIECES = 20_000  # of memory; a process may have 65,530 by Linux's default


@pytest.fixture(autouse=True, scope="module")
def few_programs():
    """Compiled programs take a few pieces of memory each, and a process that has too many can't compile another."""
    yield
    maps = Path("/proc/self/maps")
    if maps.exists() and len(maps.read_bytes().splitlines()) > PIECES:
        jax.clear_caches()
        gc.collect()
