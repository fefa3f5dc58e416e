"""Measuring: each finished result is kept and never measured again, even if the run is interrupted."""

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

_SHORT = 12  # hexadecimal digits of a digest in the report


class Entry(NamedTuple):
    """An experiment with its input files.

    Attributes:
        experiment: The experiment.
        inputs: Files that its result depends on: weights or curves.
    """

    experiment: Experiment
    inputs: tuple[Path, ...] = ()


@dataclass(frozen=True)
class Stored:
    """A result with its provenance, as its file holds it.

    Attributes:
        settings: What the result depends on, as by `identity`.
        digest: Digest of the settings.
        code: Digest of the sources that measured it.
        machine: Where it was measured, as by `machine`.
        seconds: Duration of the measurement.
        content: Digest of all other fields, which detects changes of the file.
        result: The result.
    """

    settings: Mapping[str, Any]
    digest: str
    code: str
    machine: Mapping[str, Any]
    seconds: float
    content: str
    result: Mapping[str, Any]

    @property
    def unmet(self) -> list[str]:
        """Messages on results that are not as expected."""
        return list(self.result.get(UNMET, ()))


class Watch(NamedTuple):
    """Callbacks of a run.

    Attributes:
        begins: Called with the name of an experiment before it.
        says: Called with the current activity.
        ends: Called with the name of an experiment and its new result; None if the result existed already.
    """

    begins: Callable[[str], None]
    says: Progress
    ends: Callable[[str, Stored | None], None]


def digest(content: bytes) -> str:
    """A short digest of some content."""
    return sha256(content).hexdigest()[:_SHORT]


def code_digest() -> str:
    """Digest of the sources that affect results: the library and its tasks, without pictures and commands."""
    root = Path(__file__).parents[2]
    parts = [path.relative_to(root) for path in root.rglob("*.py")]
    rooms = sorted(part for part in parts if part.parts[0] not in ("app", "view"))
    return digest(b"".join(str(part).encode() + (root / part).read_bytes() for part in rooms))


def identity(entry: Entry, settings: Settings) -> dict[str, Any]:
    """What a result depends on; a result of another identity is measured again."""
    # The last three path components identify a task's file, regardless of where the package is installed.
    inputs = {"/".join(path.parts[-3:]): digest(path.read_bytes()) for path in entry.inputs}
    return {
        "experiment": entry.experiment.name,
        "version": __version__,
        "seed": settings.seed,
        "quick": settings.quick,
        "inputs": inputs,
    }


def machine() -> dict[str, Any]:
    """The machine and the versions that a result is measured with."""
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


def read_result(out: Path, entry: Entry, settings: Settings, say: Progress) -> Stored | None:
    """The result of an earlier run; None if there is none, if its settings differ, or if its file was changed."""
    path = result_path(out, entry.experiment.name)
    try:
        value = read_json(path)
        if value.get("settings") != identity(entry, settings) or "content" not in value:
            return None
        stored = parse_as(Stored, value)
        if stored.content != _content(stored):
            raise InputError("its digest does not match its content", file=path)
    except FileNotFoundError:
        return None
    except InputError as error:
        say(f"{path} was changed after it was written and is not used: {error.reason}")
        return None
    return stored


def _content(stored: Stored) -> str:
    return digest(json.dumps(asdict(replace(stored, content="")), sort_keys=True).encode())


def measure_result(out: Path, entry: Entry, settings: Settings, say: Progress) -> Stored:
    """Measures an experiment and writes its result."""
    inputs = identity(entry, settings)
    start = time.perf_counter()
    result = entry.experiment.measure(settings, say)
    seconds = time.perf_counter() - start
    stored = Stored(
        inputs,
        digest(json.dumps(inputs, sort_keys=True).encode()),
        code_digest(),
        machine(),
        round(seconds, 2),
        "",
        result,
    )
    # JSON turns keys into text and tuples into lists: a new result must equal the one read from its file.
    stored = parse_as(Stored, json.loads(json.dumps(asdict(stored), allow_nan=False)))
    stored = replace(stored, content=_content(stored))
    write_atomically(
        result_path(out, entry.experiment.name), json.dumps(asdict(stored), indent=1) + "\n"
    )
    return stored


def results(
    out: Path, entries: Sequence[Entry], settings: Settings, selection: Sequence[str], watch: Watch
) -> dict[str, Stored]:
    """Results by name: all existing ones, and the missing ones of the selected experiments, which are measured."""
    by_name: dict[str, Stored] = {}
    for entry in entries:
        name = entry.experiment.name
        if name in selection:
            watch.begins(name)
        stored = read_result(out, entry, settings, watch.says)
        if name in selection:
            fresh = measure_result(out, entry, settings, watch.says) if stored is None else None
            watch.ends(name, fresh)
            stored = stored or fresh
        if stored is not None:
            by_name[name] = stored
    return by_name
