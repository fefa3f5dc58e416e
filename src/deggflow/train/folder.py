"""The folder of a training run: its description (config.json), its progress and its curves (curves.csv)."""

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

VERSION = 3  # of config.json and checkpoints; up to 1, averages included the initial weights


def read_curves(path: StrPath) -> list[Curve]:
    """The training curves of a run; empty if the file does not exist.

    Raises:
        InputError: The file can't be read or does not have the format that `train` writes; with file, line and reason.
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
        raise InputError("is not a file of training curves: not UTF-8 text", file=path) from None
    if lines[0].strip() != header:
        raise InputError(
            f"is not a file of training curves: its header must be {header}; got {shorten(lines[0])!r}",
            file=path,
            line=1,
        )
    if lines.pop():
        raise InputError(
            "must end with a line break; the last line is incomplete",
            file=path,
            line=len(lines) + 1,
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


def curves_until(path: Path, last_step: int, every: int) -> list[Curve]:
    """The points of the curves up to a checkpoint.

    Raises:
        InputError: A point is missing.
    """
    # If the run was killed between curve and checkpoint, the last point will be computed again.
    curves = [curve for curve in read_curves(path) if curve.step <= last_step]
    if [curve.step for curve in curves] != list(range(every, last_step + 1, every)):
        raise InputError(
            f"must have a point at every {every} steps up to {last_step}, where the last checkpoint is; "
            f"got {len(curves)} of {last_step // every}",
            file=path,
        )
    return curves


def write_curves(path: Path, curves: list[Curve]) -> None:
    """Writes a file for `read_curves`, atomically."""
    lines = [
        ",".join(Curve._fields),
        *(f"{c.step},{c.training!r},{c.validation!r}" for c in curves),
    ]
    write_atomically(path, "\n".join(lines) + "\n")


def read_config(path: Path) -> dict[str, Any] | None:
    """The config.json of a run, or None if there is no file.

    Raises:
        InputError: The file is not a config.json of this version.
    """
    try:
        config = read_json(path)
    except FileNotFoundError:
        return None
    try:
        keys = ("version", "segments", *SECTIONS)
        if "version" not in config and "validate_every" in config:
            raise InputError(
                "the run in this folder was begun by an older version of deggflow, whose averaged weights include "
                "the initial weights; complete it with that version or choose another folder"
            )
        expect_object(config, "", tuple(config), ("version",))
        if config["version"] != VERSION:
            raise InputError(
                f"must be {VERSION}; got {quoted(config['version'])}: another version of deggflow began this run",
                field="version",
            )
        expect_object(config, "", keys, keys)
        ends = expect_list(config["segments"], "segments")
        if not ends:
            raise InputError("must not be empty", field="segments")
        for k, end in enumerate(ends):
            expect_integer(end, f"segments[{k}]", ends[k - 1] + 1 if k else 1, 2**31 - 1)
        for name in SECTIONS:
            section = config[name]
            expect_object(section, name, tuple(section) if isinstance(section, dict) else ())
    except InputError as error:
        raise InputError(error.reason, file=path, field=error.field) from None
    return config


class ConfigFile(NamedTuple):
    """The config.json of a run in progress, distinguished from any file that replaces it.

    Attributes:
        path: Its path.
        device: Its device number.
        inode: Its inode number on that device.
    """

    path: Path
    device: int
    inode: int

    def check(self) -> None:
        """Checks that the file is still the same, as a checkpoint without its config.json belongs to no run.

        Raises:
            InputError: The file was removed or replaced.
        """
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


def check_same_run(path: Path, stored: Mapping[str, Any], requested: Mapping[str, Any]) -> None:
    """Checks that the requested run is the one that was begun in the folder.

    Raises:
        InputError: A setting or a part differs; the error names it.
    """
    for section in SECTIONS:
        here, there = requested[section], stored[section]
        for name in dict.fromkeys((*here, *there)):
            if name in here and name in there and here[name] == there[name]:
                continue
            now, then = (shorten(of[name]) if name in of else "absent" for of in (here, there))
            now, then = (text.split(CONTENT)[0] for text in (now, then))
            difference = f"is {now} here, {then} in"
            if now == then:
                difference = "holds other values here than in"
            raise InputError(
                f"`{name}` {difference} the run that was begun in this folder; resume it with its original settings, "
                "or choose another folder",
                file=path,
            )


def segments_with(
    path: Path, stored: Mapping[str, Any] | None, steps: int, last_step: int
) -> list[int]:
    """The steps at which the segments of the run end, including the new segment of an extension.

    Raises:
        InputError: `steps` neither completes nor extends the run.
    """
    if stored is None:
        return [steps]
    ends: list[int] = list(stored["segments"])
    last, other = ends[-1], "or choose another folder"
    if last_step > last:
        raise InputError(
            f"ends at {last}, but there is a checkpoint of step {last_step}, which belongs to another run",
            file=path,
            field="segments",
        )
    if steps == last:
        return ends
    if last_step < last:
        raise InputError(
            f"`steps` is {steps} here, {last} in the run that was begun in this folder, of which {last_step} are done; "
            f"complete it with `steps` = {last} first, {other}",
            file=path,
        )
    if steps < last:
        raise InputError(
            f"`steps` is {steps} here, but {last} are done in this folder; set at least {last}, {other}",
            file=path,
        )
    return [*ends, steps]


def run_segments(folder: StrPath) -> list[int]:
    """The steps at which the segments of a run end: one segment, and one more for each extension.

    Raises:
        InputError: The folder holds no run, or its config.json is invalid.
    """
    path = Path(folder) / "config.json"
    stored = read_config(path)
    if stored is None:
        raise InputError("does not exist: no run was begun in this folder", file=path)
    return list(stored["segments"])
