"""Every file that the program reads, mutated: it is read, or refused in one line; nothing else may happen.

Bytes are flipped, cut, doubled and thrown in; JSON values are replaced by what nobody expects, left out, doubled, nested.
An exception other than `InputError`, an exit code other than 0, 2 and 3, a refusal of several lines, and 10 s without an
answer are failures; the mutated file of each is kept.

Run: python benchmarks/fuzz.py [--mutations 10000] [--only weights] [--keep failures], about a minute
"""

import argparse
import contextlib
import io
import json
import random
import shutil
import signal
import sys
import tempfile
import time
import traceback
from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from deggflow.jsonl import InputError

LIMIT = 10.0  # s, within which a file is read or refused
NASTY: tuple[Any, ...] = (
    None, True, False, 0, 1, -1, 7, 2**31, 10**40, -0.0, 0.5, 1e-300, 1e300, float("inf"), float("nan"),
    "", "x", "8", "a\0b", "\ud800", "<script>", "é" * 3, "x" * 5000, [], [1], [[]], {}, {"": 0}, {"a": {"b": []}},
)  # fmt: skip


def _places(value: Any, place: tuple[Any, ...] = ()) -> Iterator[tuple[Any, ...]]:
    yield place
    if isinstance(value, dict | list):
        for key, inner in value.items() if isinstance(value, dict) else enumerate(value):
            yield from _places(inner, (*place, key))


def mutate_json(value: Any, draw: random.Random) -> str:
    """A JSON value with one thing changed, as text; it need not be strict JSON any more."""
    value = json.loads(json.dumps(value))
    place = draw.choice(list(_places(value)))
    if not place:
        return json.dumps(draw.choice(NASTY))
    holder = value
    for key in place[:-1]:
        holder = holder[key]
    key = place[-1]
    how = draw.randrange(6)
    if how == 0:
        del holder[key]
    elif how == 1 and isinstance(holder, dict):
        holder[draw.choice(["", "x", f"{key} ", str(key).upper()])] = holder.pop(key)
    elif how == 2 and isinstance(holder, list):
        holder.insert(draw.randrange(len(holder) + 1), draw.choice([*holder, *NASTY]))
    elif how == 3:
        holder[key] = [holder[key]] if draw.random() < 0.5 else {"x": holder[key]}
    elif how == 4 and isinstance(holder, dict):
        text = json.dumps(value)
        name = json.dumps(key)
        return text.replace(f"{name}:", f"{name}: {json.dumps(draw.choice(NASTY))}, {name}:", 1)
    else:
        holder[key] = draw.choice(NASTY)
    text = json.dumps(value)
    if draw.random() < 0.05:
        text = text.replace("0", draw.choice(["1e400", "0" * 400, "9" * 5000, "-", "0x1"]), 1)
    if draw.random() < 0.02:
        text = "[" * 100_000
    return text


def mutate_bytes(content: bytes, draw: random.Random) -> bytes:
    """Some bytes changed."""
    made = bytearray(content)
    for _ in range(draw.choice([1, 1, 1, 3, 20])):
        # Beginnings are where a format says what it is.
        end = draw.choice([len(made), min(len(made), 200), min(len(made), 16)])
        at = draw.randrange(end + 1)
        how = draw.randrange(6)
        if how == 0 and at < len(made):
            made[at] ^= 1 << draw.randrange(8)
        elif how == 1 and at < len(made):
            made[at] = draw.choice(b'\0\xff\n\r "{}[],:9-e')
        elif how == 2:
            made[at:at] = draw.choice(
                [b"\0", b"\xff\xfe", b"\xef\xbb\xbf", b"\n", b"\n\n", b"{", b"[" * 50]
            )
        elif how == 3:
            del made[at : at + draw.choice([1, 8, 100, len(made)])]
        elif how == 4:
            made[at:at] = made[at : at + draw.choice([1, 8, 100])]
        else:
            made[at : at + 8] = draw.randbytes(8)
    return bytes(made)


def mutate(content: bytes, draw: random.Random) -> bytes:
    """A file's content with something changed, in its JSON where it has some."""
    if draw.random() < 0.35:
        return mutate_bytes(content, draw)
    try:
        values = [json.loads(content)]
    except ValueError:
        try:
            values = [json.loads(line) for line in content.splitlines()]
        except ValueError:
            return mutate_bytes(content, draw)
    at = draw.randrange(len(values))
    lines = [json.dumps(value) for value in values]
    lines[at] = mutate_json(values[at], draw)
    return ("\n".join(lines) + "\n").encode("utf-8", "surrogatepass")


@dataclass(frozen=True)
class Kind:
    """One kind of file."""

    name: str
    path: Path  # of a good one; it is put back after each mutation
    read: Callable[[], object]  # what the program does with it
    share: float = 1.0  # of the mutations


def command(*arguments: object) -> None:
    """A command in this process; raises what a failure is."""
    from deggflow.app.cli import main

    told = io.StringIO()
    try:
        with contextlib.redirect_stdout(io.StringIO()), contextlib.redirect_stderr(told):
            main([str(argument) for argument in arguments])
    except SystemExit as ended:
        lines = told.getvalue().strip().splitlines()
        if ended.code == 2 and len(lines) == 1 and lines[0].startswith("deggflow: "):
            raise InputError(lines[0]) from None
        if ended.code not in (0, 3):
            raise AssertionError(f"exit code {ended.code}: {told.getvalue()}") from None


class HangError(Exception):
    """It took longer than `LIMIT`."""


@contextlib.contextmanager
def limited() -> Iterator[None]:
    """Stops what takes longer than `LIMIT`."""

    def stop(*_: object) -> None:
        raise HangError(f"no answer after {LIMIT:.0f} s")

    before = signal.signal(signal.SIGALRM, stop)
    signal.setitimer(signal.ITIMER_REAL, LIMIT)
    start = time.monotonic()
    try:
        yield
    finally:
        signal.setitimer(signal.ITIMER_REAL, 0)
        signal.signal(signal.SIGALRM, before)
    if time.monotonic() - start > LIMIT:  # in a call that no signal interrupts
        raise HangError(f"an answer after {time.monotonic() - start:.0f} s")


@dataclass
class Tally:
    """What became of the mutations of a kind."""

    name: str
    read: int = 0
    refused: int = 0
    slowest: float = 0.0  # s
    failures: tuple[str, ...] = ()


def fuzz(kind: Kind, mutations: int, seed: int, keep: Path | None = None) -> Tally:
    """Mutations of one kind of file, each from a seed of its own."""
    good, tally = kind.path.read_bytes(), Tally(kind.name)
    kind.read()  # the good one is read
    for number in range(mutations):
        draw = random.Random(f"{kind.name} {seed} {number}")
        kind.path.write_bytes(mutate(good, draw))
        start = time.monotonic()
        try:
            with limited():
                kind.read()
            tally.read += 1
        except InputError as error:
            tally.refused += 1
            if "\n" in str(error):
                tally.failures += (f"{number}: several lines: {error!s:.200}",)
        except Exception:
            last = traceback.format_exc().strip().splitlines()
            tally.failures += (f"{number}: {' | '.join(last[-3:])[:400]}",)
            if keep is not None:
                keep.mkdir(parents=True, exist_ok=True)
                shutil.copy(kind.path, keep / f"{kind.name.replace(' ', '-')}-{number}")
        tally.slowest = max(tally.slowest, time.monotonic() - start)
    kind.path.write_bytes(good)
    return tally


def tabletop_kinds(home: Path) -> list[Kind]:
    """Files of the tabletop."""
    from deggflow.tasks.tabletop.condition import to_arrays
    from deggflow.tasks.tabletop.data import load_dataset
    from deggflow.tasks.tabletop.field import SHIPPED, load_field
    from deggflow.tasks.tabletop.formats import read_conditions

    conditions, scenes, data = home / "conditions.jsonl", home / "scenes.jsonl", home / "data"
    lines = [
        {"objects": ["laptop", "teacup", "laptop#2"]},
        {"objects": ["scissors"], "table": {"width": 1.4, "depth": 0.94}},
        {
            "objects": ["laptop", "desk_lamp"],
            "requirements": {"laptop": {"offset_scale": 1.2, "radius_scale": 0.9, "direction": 3.14}},
            "balance": {"x": 0, "y": 0.01, "radius": 0.05},
        },
    ]  # fmt: skip
    conditions.write_text("".join(json.dumps(line) + "\n" for line in lines))
    command("tabletop", "generate", "--size", 3, "--count", 2, "--requirements", "balanced", "--trace",
            "--max-draws", 1, "--out", scenes)  # fmt: skip
    command("tabletop", "data", "--out", data, "--training", 2, "--validation", 1)
    weights = home / "tabletop.safetensors"
    for ending in (".safetensors", ".json"):
        shutil.copy(SHIPPED.with_suffix(ending), weights.with_suffix(ending))
    return [
        Kind("tabletop conditions", conditions, lambda: to_arrays(read_conditions(conditions))),
        Kind("scenes", scenes, lambda: command("tabletop", "certify", scenes, "--quiet")),
        Kind("training scenes", data / "training.jsonl", lambda: load_dataset(data / "training.jsonl"), 0.5),
        Kind("tabletop card", weights.with_suffix(".json"), lambda: load_field(weights), 0.5),
        Kind("tabletop weights", weights, lambda: load_field(weights), 0.5),
    ]  # fmt: skip


def bridge_kinds(home: Path) -> list[Kind]:
    """Files of the bridge."""
    from deggflow.tasks.bridge.data import load_dataset
    from deggflow.tasks.bridge.field import SHIPPED, load_field
    from deggflow.tasks.bridge.formats import read_conditions

    conditions, trials, data = home / "starts.jsonl", home / "trials.jsonl", home / "demonstrations"
    start = {
        "plank": {"x": -1.2, "y": 0.0, "theta": 0.1},
        "goal": {"x": -0.2, "y": 0.0, "theta": 0.0},
        "contacts": [[-2.4, 0.36], [-2.4, -0.36], [-1.0, 0.36]],
    }
    conditions.write_text(json.dumps(start) + "\n")
    options = ("--speed-limit", 0.3, "--seed", 5)
    command("bridge", "generate", "--conditions", conditions, *options, "--out", trials)
    command("bridge", "data", "--out", data, "--training", 1, "--validation", 1)
    demonstrations = data / "training.jsonl"
    weights = home / "bridge.safetensors"
    for ending in (".safetensors", ".json"):
        shutil.copy(SHIPPED.with_suffix(ending), weights.with_suffix(ending))
    return [
        Kind("bridge conditions", conditions, lambda: read_conditions(conditions)),
        Kind("trials", trials, lambda: command("bridge", "certify", trials, "--quiet")),
        Kind("demonstrations", demonstrations, lambda: load_dataset(demonstrations, None, perturb=True), 0.5),
        Kind("bridge card", weights.with_suffix(".json"), lambda: load_field(weights), 0.5),
        Kind("bridge weights", weights, lambda: load_field(weights), 0.5),
    ]  # fmt: skip


def team_kinds(home: Path) -> list[Kind]:
    """Files of a task that is not the package's own."""
    from fuzz_team import team_files

    return [Kind(name, path, read, 0.5) for name, path, read in team_files(home)]


def run_kinds(home: Path) -> list[Kind]:
    """Files that runs keep: settings, lines and rows to be completed, results."""
    from deggflow.app.reproduce.experiment import Settings
    from deggflow.app.reproduce.run import Entry, measure_result, read_result, result_path
    from deggflow.app.runs import resumed_rows
    from deggflow.output import ResumableOutput, run_settings
    from deggflow.tasks.tabletop.evaluate import Evaluation

    settings = {"command": "fuzz", "seed": 0, "sizes": [4, 5], "weights": None}
    lines, rows = home / "lines.jsonl", home / "rows.jsonl"
    with ResumableOutput(lines, settings) as output:
        output.append([{"condition": {"objects": ["teacup"]}, "k": k} for k in range(3)])

    def resume() -> None:
        with ResumableOutput(lines, settings, count=3, belongs=lambda k, row: row.get("k") == k):
            pass

    row = Evaluation(4, "changed", 10, 5, 4, 10, 10, 1, 0.02, 0, 10, 0, (101.0, 101.0, 101.0), 0)
    resumed_rows([lambda: row] * 2, Evaluation, settings, rows)

    class Small:
        name = "small"

        def measure(self, settings: Settings, say: Callable[[str], None]) -> dict[str, Any]:
            return {"rows": [row.to_json()], "cases": 10, "text": "a < b"}

        def present(self, result: Any, settings: Settings) -> Any:
            raise NotImplementedError

    def quiet(text: str) -> None:
        pass

    entry = Entry(Small())
    measure_result(home, entry, Settings(), quiet)
    jobs = [lambda: row] * 2
    return [
        Kind("settings of a run", home / "lines.jsonl.run.json", resume),
        Kind("lines to be completed", lines, resume),
        Kind("rows to be completed", rows, lambda: resumed_rows(jobs, Evaluation, settings, rows)),
        Kind("settings of data", home / "lines.jsonl.run.json", lambda: run_settings(lines), 0.5),
        Kind(
            "results",
            result_path(home, "small"),
            lambda: read_result(home, entry, Settings(), quiet),
        ),
    ]


def training_kinds(home: Path) -> list[Kind]:
    """Files of a training run, read when it goes on."""
    import equinox as eqx
    import jax
    import jax.numpy as jnp

    from deggflow.train import Dataset, TrainingConfig, read_curves, train

    class Tiny(eqx.Module):
        weight: jax.Array

        def __call__(self, tau: jax.Array, z: jax.Array, condition: None) -> jax.Array:
            return self.weight * z

    data = Dataset(jnp.ones((4, 2, 2)), None, jnp.ones((4, 2), bool))
    config = TrainingConfig(steps=10, batch=2, warmup=1, validate_every=5)
    run = home / "run"

    def go_on() -> None:
        train(Tiny(jnp.ones(())), data, data, config, run)

    go_on()
    curves, checkpoint = run / "curves.csv", run / "checkpoints" / "10.safetensors"
    return [
        Kind("configuration of a training run", run / "config.json", go_on),
        Kind("training curves", curves, lambda: read_curves(curves)),
        Kind("checkpoint", checkpoint, go_on),
    ]


MAKERS: dict[str, Callable[[Path], list[Kind]]] = {
    "tabletop": tabletop_kinds,
    "bridge": bridge_kinds,
    "team": team_kinds,
    "runs": run_kinds,
    "training": training_kinds,
}


def shares(kinds: Sequence[Kind], mutations: int) -> list[int]:
    """How many mutations each kind gets."""
    whole = sum(kind.share for kind in kinds)
    return [max(1, round(mutations * kind.share / whole)) for kind in kinds]


def main() -> int:
    """Prints what became of the mutations; 1 where one failed."""
    parser = argparse.ArgumentParser(description="Mutate every file that the program reads.")
    parser.add_argument("--mutations", type=int, default=10_000)
    parser.add_argument("--seed", type=int, default=1)
    parser.add_argument("--only", help="kinds whose name holds this text")
    parser.add_argument("--keep", type=Path, help="folder that receives the files that failed")
    given = parser.parse_args()
    failures: list[str] = []
    total = 0
    print(f"{'file':42} {'mutations':>9} {'read':>6} {'refused':>8} {'slowest':>8}  failures")
    with tempfile.TemporaryDirectory() as folder:
        kinds = [kind for maker in MAKERS.values() for kind in maker(Path(folder))]
        kinds = [kind for kind in kinds if not given.only or given.only in kind.name]
        for kind, count in zip(kinds, shares(kinds, given.mutations), strict=True):
            tally = fuzz(kind, count, given.seed, given.keep)
            numbers = f"{count:9,} {tally.read:6,} {tally.refused:8,} {tally.slowest:7.2f}s"
            print(f"{kind.name:42} {numbers}  {len(tally.failures)}", flush=True)
            failures += [f"{kind.name} {text}" for text in tally.failures]
            total += count
    print(f"{total:,} mutations, {len(failures)} failures")
    print("\n".join(failures[:50]), file=sys.stderr)
    return 1 if failures else 0


if __name__ == "__main__":
    sys.exit(main())
