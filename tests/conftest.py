import gc
import os
import signal
from importlib.util import find_spec
from pathlib import Path

import hypothesis
import jax
import jaxtyping
import pytest


def check_shapes(package):
    """Has arguments and results checked in modules that name shapes. All other types are mypy's, as each check takes long."""
    (folder,) = map(Path, find_spec(package).submodule_search_locations)
    modules = []
    for path in folder.rglob("*.py"):
        if "jaxtyping" in path.read_text():
            parts = path.relative_to(folder).with_suffix("").parts
            modules.append(".".join((package, *parts)))
    jaxtyping.install_import_hook(modules, "beartype.beartype")


check_shapes("deggflow")
# A shell that runs tests in the background has them ignore Ctrl-C, and so would every process that they interrupt.
if signal.getsignal(signal.SIGINT) is signal.SIG_IGN:
    signal.signal(signal.SIGINT, signal.default_int_handler)
jax.config.update("jax_numpy_rank_promotion", "raise")
# Tracing makes many objects that live on: looking for garbage after every 700 of them takes up to a tenth of the time.
gc.set_threshold(100_000, 20, 50)


@pytest.fixture(scope="session", autouse=True)
def compiled_programs(tmp_path_factory):
    """A folder of compiled programs that a worker's tests and the processes that they start share.

    Each worker has its own, as JAX's writing of an entry is not atomic.
    """
    folder = tmp_path_factory.mktemp("programs")
    settings = {
        "jax_compilation_cache_dir": str(folder / "xla"),
        "jax_persistent_cache_min_compile_time_secs": 0.0,
        "jax_persistent_cache_min_entry_size_bytes": 0,
    }
    for name, value in settings.items():
        jax.config.update(name, value)
        os.environ[name.upper()] = str(value)
    return folder


@pytest.fixture
def key():
    return jax.random.key(0)


PIECES = 20_000  # of memory; a process may have 65,530 by Linux's default, and a module takes up to 10,000


@pytest.fixture(autouse=True, scope="module")
def few_programs():
    """Compiled programs take a few pieces of memory each, and a process that has too many can't compile another.

    What JAX keeps of a module is not looked through again and again for garbage during the following ones.
    """
    yield
    maps = Path("/proc/self/maps")
    if maps.exists() and len(maps.read_bytes().splitlines()) > PIECES:
        gc.unfreeze()
        jax.clear_caches()
        gc.collect()
    gc.freeze()


# Machines differ in speed, and others may use them.
hypothesis.settings.register_profile("unhurried", deadline=None)
hypothesis.settings.load_profile("unhurried")
