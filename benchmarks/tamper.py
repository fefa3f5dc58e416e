"""Every field of a scene's and of a trial's line is changed in turn, and `certify`'s checks are asked what they say.

A change that no check finds, in a field that is not among those `certify` names as not to be verified, makes the run fail.

Run: python benchmarks/tamper.py [--most 40] > table.md, about two minutes. docs/certify.md has the tables.
"""

import argparse
import copy
import json
import sys
from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass, field
from typing import Any, NamedTuple

from deggflow.consistency import Unverified
from deggflow.jsonl import InputError, shorten
from deggflow.task import Formats
from deggflow.tasks.bridge import consistency as trials
from deggflow.tasks.bridge.formats import parse_trial
from deggflow.tasks.bridge.oracle import refutation
from deggflow.tasks.bridge.task import BridgeTask
from deggflow.tasks.tabletop import consistency as scenes
from deggflow.tasks.tabletop.task import TabletopTask

Path = tuple[str | int, ...]
GONE = object()  # stands for a field that is left out
SHOWN = 110  # letters of a sentence in the table


class Kind(NamedTuple):
    """A sort of line, and how `certify` looks at it."""

    name: str
    find: Callable[[Any], list[str]]  # what is wrong in a line; `InputError` where it is malformed
    differ: Callable[[Any, Any], str | None]  # in what a line's condition is not the one asked for
    unverified: Unverified


def _of_scene(line: Any) -> list[str]:
    return [str(wrong) for wrong in scenes.contradictions(line)]


def _of_trial(line: Any) -> list[str]:
    parse_trial(line)
    replayed = refutation(line)
    found = [str(wrong) for wrong in trials.contradictions(line)]
    return found if replayed is None else [f"the replay finds that {replayed}", *found]


def _differ(formats: Formats[Any, Any]) -> Callable[[Any, Any], str | None]:
    def differ(asked: Any, line: Any) -> str | None:
        wrong = formats.difference(formats.condition(asked, ""), formats.result(line).condition)
        return None if wrong is None else str(wrong)

    return differ


SCENES, TRIALS = TabletopTask.formats, BridgeTask.formats
SCENE = Kind("scene", _of_scene, _differ(SCENES), SCENES.unverified)
TRIAL = Kind("trial", _of_trial, _differ(TRIALS), TRIALS.unverified)


@dataclass
class Row:
    """One field, whatever the numbers of the lists it is in."""

    field: str
    changes: int = 0
    refused: int = 0  # malformed: exit code 2
    wrong: int = 0  # found wrong: exit code 3
    asked: int = 0  # found only beside the conditions that were asked for
    says: str = ""  # of the first change that was found
    unfound: list[str] = field(default_factory=list)  # changes that nobody finds

    @property
    def found(self) -> int:
        """Changes that `certify FILE` finds."""
        return self.refused + self.wrong


def pattern(path: Path) -> str:
    """A field's name as it is shown: without the numbers of lists and the names of objects."""
    out = ""
    for before, key in zip(("", *path), path, strict=False):
        name = "*" if before == "requirements" else key
        out += "[]" if isinstance(key, int) else f".{name}" if out else str(key)
    return out


def fields(value: Any, path: Path = ()) -> Iterator[Path]:
    """Every field of a line, objects and lists before what is in them."""
    if path:
        yield path
    inside = (
        value if isinstance(value, dict) else range(len(value) if isinstance(value, list) else 0)
    )
    for key in inside:
        yield from fields(value[key], (*path, key))


def changes(value: Any) -> list[Any]:
    """Other values for a field, of the same sort and of none."""
    if isinstance(value, bool):
        return [not value]
    if isinstance(value, int):
        return [value + 1, value - 1]
    if isinstance(value, float):
        return [value + max(0.01, 0.01 * abs(value)), value * 0.5 if abs(value) > 1e-6 else -0.01]
    if isinstance(value, str):
        return [None, value + "!"]
    if isinstance(value, list):
        return [value[:-1], value + value[-1:], []] if value else [[0.5]]
    return [] if isinstance(value, dict) else ["because", 0.5]


def changed(line: Any, path: Path, new: Any) -> Any:
    """A copy of a line with one field changed or left out."""
    out = copy.deepcopy(line)
    *way, last = path
    place = out
    for key in way:
        place = place[key]
    if new is GONE:
        del place[last]
    else:
        place[last] = new
    return out


def some(paths: Sequence[Path], most: int) -> list[Path]:
    """At most so many of the paths, evenly spread, the first and the last among them."""
    if len(paths) <= most:
        return list(paths)
    last = len(paths) - 1
    return [paths[round(k * last / max(most - 1, 1))] for k in range(most)]


def tamper(kind: Kind, line: Any, most: int) -> list[Row]:
    """Changes every field of a line, at most so many of a name, and asks the checks.

    Args:
        kind: What the line is.
        line: As it stands in a file; nothing is wrong with it.
        most: Fields of one name that are changed, as of poses.
    """
    assert kind.find(line) == [], kind.find(line)
    together: dict[str, list[Path]] = {}
    for path in fields(line):
        together.setdefault(pattern(path), []).append(path)
    rows = []
    for name, paths in together.items():
        row = Row(name)
        for path in some(paths, most):
            _try_all(kind, line, path, row)
        rows += [row] if row.changes else []
    return rows


def _try_all(kind: Kind, line: Any, path: Path, row: Row) -> None:
    value: Any = line
    for key in path:
        value = value[key]
    gone = [GONE] if isinstance(path[-1], str) else []
    for new in [*changes(value), *gone]:
        row.changes += 1
        text = "left out" if new is GONE else f"{shorten(value, 40)} -> {shorten(new, 40)}"
        _try(kind, line, changed(line, path, new), row, f"{json.dumps(path)}: {text}")


def _try(kind: Kind, line: Any, bad: Any, row: Row, what: str) -> None:
    try:
        found = kind.find(bad)
        differs = kind.differ(line["condition"], bad)
    except InputError as error:
        row.refused += 1
        row.says = row.says or str(error)
        return
    if found:
        if not row.wrong:
            row.says = found[0]
        row.wrong += 1
    elif differs:
        row.asked += 1
        row.says = row.says or differs
    else:
        row.unfound.append(what)


def is_named(name: str, unverified: Unverified) -> bool:
    """Whether a field is among those that are said not to be verified, or inside one of which no part is named."""

    def inside(one: str, other: str) -> bool:
        return one.startswith((f"{other}.", f"{other}["))

    whole = [each for each in unverified if not any(inside(other, each) for other in unverified)]
    return name in unverified or any(inside(name, each) for each in whole)


def passing(kind: Kind, rows: Sequence[Row]) -> list[str]:
    """Changes that `certify` should have found or should have named, without conditions."""
    out = []
    for row in rows:
        if not is_named(row.field, kind.unverified):
            out += [f"{kind.name}: {text}" for text in row.unfound]
            out += [f"{kind.name}: {row.field} is found with conditions only"] * bool(row.asked)
    return out


def table(kind: Kind, rows: Sequence[Row]) -> list[str]:
    """The rows in Markdown."""
    head = f"| field of a {kind.name} | changes | exit 2 | exit 3 | with `--conditions` | not found | the first that is found says |"
    lines = [head, "|---|---|---|---|---|---|---|"]
    for row in rows:
        counts = (row.changes, row.refused, row.wrong, row.asked, len(row.unfound))
        says = shorten(row.says, SHOWN).replace("|", "\\|").replace("<", "&lt;")
        lines.append(f"| `{row.field}` | {' | '.join(map(str, counts))} | {says or 'nothing'} |")
    return lines


def a_scene() -> Any:
    """A guided scene with a trace and a shared requirement, as it stands in a file."""
    from deggflow.tasks.tabletop.changes import random_conditions
    from deggflow.tasks.tabletop.field import load_field
    from deggflow.tasks.tabletop.task import scene_generator

    condition = random_conditions(5, 1, "balanced", 1, 0)
    (scene,) = scene_generator(load_field()).scenes(condition, seed=1, keep_trace=True)
    return json.loads(json.dumps(scene.to_json()))


def a_trial() -> Any:
    """A guided trial with a speed limit, as it stands in a file."""
    from deggflow.tasks.bridge.field import load_field
    from deggflow.tasks.bridge.scenes import random_conditions
    from deggflow.tasks.bridge.task import trial_generator

    generator = trial_generator(load_field(), speed_limit=0.3)
    (trial,) = generator.trials(random_conditions(4, 1, 1, 0), seed=1)
    return json.loads(json.dumps(trial.to_json()))


def main() -> int:
    """Prints both tables; 1 where a change passes that is not named."""
    parser = argparse.ArgumentParser(description="Change every field; see what certify says.")
    parser.add_argument("--most", type=int, default=12, help="fields of one name that are changed")
    most, passed = parser.parse_args().most, []
    for kind, line in ((SCENE, a_scene()), (TRIAL, a_trial())):
        rows = tamper(kind, line, most)
        print("\n".join([*table(kind, rows), ""]), flush=True)
        passed += passing(kind, rows)
        told = sum(row.changes for row in rows), sum(row.found for row in rows)
        unfound = sum(len(row.unfound) for row in rows)
        counts = f"{told[0]} changes of a {kind.name}: {told[1]} found, {unfound} not found"
        print(f"{counts}; {len(passing(kind, rows))} of these not named.", file=sys.stderr)
    print("\n".join(passed), file=sys.stderr)
    return 1 if passed else 0


if __name__ == "__main__":
    sys.exit(main())
