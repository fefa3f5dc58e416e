"""Measuring: what is done is kept and not done again, whatever stops the run."""

import json
import os
import platform
import time
from collections.abc import Callable, Mapping, Sequence
from dataclasses import asdict, dataclass, replace
from hashlib import sha256
from importlib.metadata import version
from pathlib import Path
from typing import Any, NamedTuple

from deggflow import __version__
from deggflow.files import write_atomically
from deggflow.jsonl import InputError, read_json
from deggflow.schema import parse_as

from .experiment import UNMET, Experiment, Progress, Settings

_SHORT = 12  # hexadecimal digits of a digest that people read


class Entry(NamedTuple):
    """An experiment and the files that its result depends on: weights, curves."""

    experiment: Experiment
    inputs: tuple[Path, ...] = ()


@dataclass(frozen=True)
class Stored:
    """A result as it stands in its file."""

    settings: Mapping[str, Any]
    digest: str  # of the settings
    code: str  # digest of the sources that measured it
    machine: Mapping[str, Any]
    seconds: float  # it took
    content: str  # digest of all the rest, which tells whether it still is what was measured
    result: Mapping[str, Any]

    @property
    def unmet(self) -> list[str]:
        """Guided results that should be satisfied and are not."""
        return list(self.result.get(UNMET, ()))


class Watch(NamedTuple):
    """Whom to tell."""

    begins: Callable[[str], None]  # the experiment's name
    says: Progress
    ends: Callable[[str, Stored | None], None]  # None: its result was there already


def digest(content: bytes) -> str:
    """A short name of some content."""
    return sha256(content).hexdigest()[:_SHORT]


def code_digest() -> str:
    """Of the sources that results come from: the library and its tasks, not pictures and commands."""
    root = Path(__file__).parents[2]
    parts = [path.relative_to(root) for path in root.rglob("*.py")]
    rooms = sorted(part for part in parts if part.parts[0] not in ("app", "view"))
    return digest(b"".join(str(part).encode() + (root / part).read_bytes() for part in rooms))


def identity(entry: Entry, settings: Settings) -> dict[str, Any]:
    """What a result depends on; with another identity it is measured anew."""
    # Three names tell one task's files from another's, wherever the package is installed.
    inputs = {"/".join(path.parts[-3:]): digest(path.read_bytes()) for path in entry.inputs}
    return {
        "experiment": entry.experiment.name,
        "version": __version__,
        "seed": settings.seed,
        "quick": settings.quick,
        "inputs": inputs,
    }


def machine() -> dict[str, Any]:
    """Where a result was measured."""
    affinity = getattr(os, "sched_getaffinity", None)
    return {
        "cores": len(affinity(0)) if affinity else os.cpu_count() or 1,
        "processor": platform.machine(),
        "system": platform.system(),
        "python": platform.python_version(),
        "jax": version("jax"),
    }


def result_path(out: Path, name: str) -> Path:
    """The file of an experiment's result."""
    return out / "results" / f"{name}.json"


def stored(out: Path, entry: Entry, settings: Settings, say: Progress) -> Stored | None:
    """The result that an earlier run left, if it is of the same settings and stands as it was written."""
    path = result_path(out, entry.experiment.name)
    try:
        found = read_json(path)
        if found.get("settings") != identity(entry, settings) or "content" not in found:
            return None
        known = parse_as(Stored, found)
        if known.content != _content(known):
            raise InputError("it does not hold what was measured", file=path)
    except FileNotFoundError:
        return None
    except InputError as error:
        say(f"{path} was changed after it was written and is not used: {error.reason}")
        return None
    return known


def _content(known: Stored) -> str:
    return digest(json.dumps(asdict(replace(known, content="")), sort_keys=True).encode())


def measured(out: Path, entry: Entry, settings: Settings, say: Progress) -> Stored:
    """Measures an experiment and writes its result."""
    wanted = identity(entry, settings)
    start = time.perf_counter()
    result = entry.experiment.measure(settings, say)
    seconds = time.perf_counter() - start
    found = Stored(
        wanted,
        digest(json.dumps(wanted, sort_keys=True).encode()),
        code_digest(),
        machine(),
        round(seconds, 2),
        "",
        result,
    )
    # Presented is what stands in the file, whether it was measured now or before: keys are text, tuples are lists.
    found = parse_as(Stored, json.loads(json.dumps(asdict(found), allow_nan=False)))
    found = replace(found, content=_content(found))
    write_atomically(
        result_path(out, entry.experiment.name), json.dumps(asdict(found), indent=1) + "\n"
    )
    return found


def results(
    out: Path, entries: Sequence[Entry], settings: Settings, chosen: Sequence[str], watch: Watch
) -> dict[str, Stored]:
    """Results by name: those of the chosen experiments, measured where they are missing, and all others there are."""
    found: dict[str, Stored] = {}
    for entry in entries:
        name = entry.experiment.name
        if name in chosen:
            watch.begins(name)
        known = stored(out, entry, settings, watch.says)
        if name in chosen:
            fresh = measured(out, entry, settings, watch.says) if known is None else None
            watch.ends(name, fresh)
            known = known or fresh
        if known is not None:
            found[name] = known
    return found
