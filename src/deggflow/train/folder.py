"""The folder of a training run: which run it holds (config.json), how far it is, and its curves (curves.csv)."""

from collections.abc import Mapping
from pathlib import Path
from typing import Any, NamedTuple

from deggflow.files import StrPath, write_atomically
from deggflow.jsonl import (
    InputError,
    expect_integer,
    expect_list,
    expect_object,
    quoted,
    read_json,
    shorten,
)

from .identity import CONTENT, SECTIONS
from .settings import Curve

VERSION = 3  # of config.json and checkpoints; before 2, averages began at the initial weights


def read_curves(path: StrPath) -> list[Curve]:
    """The training curves of a run; none if the file does not exist.

    Raises:
        InputError: The file can't be read, or is not as `train` writes it; with file, line and reason.
    """
    path = Path(path)
    if not path.exists():
        return []
    header = ",".join(Curve._fields)
    try:
        lines = path.read_text("utf-8").split("\n")
    except OSError as error:
        raise InputError(f"can't be read: {error.strerror}", file=path) from None
    except UnicodeDecodeError:
        raise InputError("these are no training curves: not UTF-8 text", file=path) from None
    if lines[0].strip() != header:
        raise InputError(
            f"these are no training curves: must be {header}; got {shorten(lines[0])!r}",
            file=path,
            line=1,
        )
    if lines.pop():
        raise InputError(
            "must end with a line break; something is cut off", file=path, line=len(lines) + 1
        )
    curves: list[Curve] = []
    for number, line in enumerate(lines[1:], start=2):
        try:
            step, training, validation = line.split(",")
            curves.append(Curve(int(step), float(training), float(validation)))
        except ValueError:
            raise InputError(
                f"must be a whole number and two numbers ({header}); got {shorten(line)!r}",
                file=path,
                line=number,
            ) from None
        if curves[-1].step <= (curves[-2].step if curves[:-1] else 0):
            raise InputError(
                f"`step` must grow from line to line; got {curves[-1].step}", file=path, line=number
            )
    return curves


def curves_until(path: Path, done: int, every: int) -> list[Curve]:
    """The points up to a checkpoint, of which none may be missing."""
    # A kill between the curve and its checkpoint leaves a point that is about to be made again.
    curves = [curve for curve in read_curves(path) if curve.step <= done]
    if [curve.step for curve in curves] != list(range(every, done + 1, every)):
        raise InputError(
            f"must have a point at every {every} steps up to {done}, where the last checkpoint is; "
            f"got {len(curves)} of {done // every}",
            file=path,
        )
    return curves


def write_curves(path: Path, curves: list[Curve]) -> None:
    """Writes what `read_curves` reads; a kill leaves the old file or the new one."""
    lines = [
        ",".join(Curve._fields),
        *(f"{c.step},{c.training!r},{c.validation!r}" for c in curves),
    ]
    write_atomically(path, "\n".join(lines) + "\n")


def read_config(path: Path) -> dict[str, Any] | None:
    """The config.json of a run, or None if there is no file; `InputError` if it is not one."""
    try:
        found = read_json(path)
    except FileNotFoundError:
        return None
    try:
        keys = ("version", "segments", *SECTIONS)
        if "version" not in found and "validate_every" in found:
            raise InputError(
                "the run in this folder was begun by an older version of deggflow, whose averaged weights keep a share "
                "of the initial ones; complete it with that version or choose another folder"
            )
        expect_object(found, "", tuple(found), ("version",))
        if found["version"] != VERSION:
            raise InputError(
                f"must be {VERSION}; got {quoted(found['version'])}: another version of deggflow began this run",
                field="version",
            )
        expect_object(found, "", keys, keys)
        ends = expect_list(found["segments"], "segments")
        if not ends:
            raise InputError("must not be empty", field="segments")
        for k, end in enumerate(ends):
            expect_integer(end, f"segments[{k}]", ends[k - 1] + 1 if k else 1, 2**31 - 1)
        for name in SECTIONS:
            section = found[name]
            expect_object(section, name, tuple(section) if isinstance(section, dict) else ())
    except InputError as error:
        raise InputError(error.reason, file=path, field=error.field) from None
    return found


class ConfigFile(NamedTuple):
    """The config.json of a run under way, told from any that takes its place."""

    path: Path
    device: int
    inode: int

    def check(self) -> None:
        """Refuses to go on in a folder that was removed: a checkpoint without its config.json is nobody's."""
        if _file_identity(self.path) != self[1:]:
            raise InputError(
                "was removed or replaced while the run was writing beside it", file=self.path
            )


def config_file(path: Path) -> ConfigFile:
    """The config.json as it is now."""
    return ConfigFile(path, *_file_identity(path))


def _file_identity(path: Path) -> tuple[int, int]:
    try:
        status = path.stat()
    except FileNotFoundError:
        return -1, -1
    return status.st_dev, status.st_ino


def check_same_run(path: Path, begun: Mapping[str, Any], wanted: Mapping[str, Any]) -> None:
    """Refuses what differs from the run that was begun, by name."""
    for section in SECTIONS:
        here, there = wanted[section], begun[section]
        for name in dict.fromkeys((*here, *there)):
            if name in here and name in there and here[name] == there[name]:
                continue
            now, then = (shorten(of[name]) if name in of else "absent" for of in (here, there))
            now, then = (text.split(CONTENT)[0] for text in (now, then))
            what = f"is {now} here, {then} in"
            if now == then:
                what = "holds other values here than in"
            raise InputError(
                f"`{name}` {what} the run that was begun in this folder; go on with what it was begun with, "
                "or choose another folder",
                file=path,
            )


def segments_with(path: Path, begun: Mapping[str, Any] | None, steps: int, done: int) -> list[int]:
    """Where the segments of the run end, with the new one of an extension; refuses other steps by name."""
    if begun is None:
        return [steps]
    ends: list[int] = list(begun["segments"])
    last, other = ends[-1], "or choose another folder"
    if done > last:
        raise InputError(
            f"ends at {last}, and there is a checkpoint of step {done}: not of this run",
            file=path,
            field="segments",
        )
    if steps == last:
        return ends
    if done < last:
        raise InputError(
            f"`steps` is {steps} here, {last} in the run that was begun in this folder, of which {done} are done; "
            f"complete it with `steps` = {last} first, {other}",
            file=path,
        )
    if steps < last:
        raise InputError(
            f"`steps` is {steps} here, and {last} are done in this folder; ask for as many, for more, {other}",
            file=path,
        )
    return [*ends, steps]


def run_segments(folder: StrPath) -> list[int]:
    """The steps at which the segments of a run end: one, and one more for each time it was extended.

    Raises:
        InputError: The folder holds no run, or its config.json is not as it should be.
    """
    path = Path(folder) / "config.json"
    begun = read_config(path)
    if begun is None:
        raise InputError("does not exist: no run was begun in this folder", file=path)
    return list(begun["segments"])
