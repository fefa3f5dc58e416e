"""The certificate game: random problems are generated and certified by deggflow, and judged by NumPy in float64.

Every requirement is given twice, as JAX functions to the library and by other formulas to the judge (game/truth.py,
which shares no code with either). A sample that is said to be satisfied although a requirement is broken, or a
generation whose hypotheses are said to hold although they do not, makes the run fail.

"hypotheses hold" is judged at the points of the grid, by values and limits of the judge's own, with the tolerance that float32
needs (`above_limits`), and for single private requirements and plain Euler steps by every agent's rows (`steepest_row`).

Run: python benchmarks/certificate_game.py [--samples 100000] [--seed 0], about 15 minutes on 2 cores.
One case again: --only KIND --case N with the same --seed and --batch.
"""

import argparse
import gc
import sys
import time
import warnings
from collections.abc import Callable
from dataclasses import dataclass
from typing import Any

import jax
from game import altered, generated
from game.generated import Case
from game.tally import BARS, REFUSALS, Tally
from game.wirings import play_wirings

BATCH = 512
SHOWN = 12  # incidents of one sort and kind that are printed


PROGRAMS = 30  # cases after which compiled programs are thrown away


@dataclass(frozen=True)
class Kind:
    """How problems of one kind are made and played."""

    share: float  # of all samples
    structures: int  # programs that are compiled for it
    problem: Callable[[str, int], Any]
    play: Callable[..., None]
    batch: float = 1.0  # of the samples of a case


KINDS = {
    "private": Kind(20, 8, generated.private, generated.play_batch),
    "waypoints": Kind(6, 4, generated.waypoints, generated.play_batch),
    "walls": Kind(6, 4, generated.walls, generated.play_batch),
    "hinges": Kind(2, 2, generated.hinges, generated.play_batch, 0.25),
    "shared": Kind(12, 8, generated.shared, generated.play_batch),
    "both": Kind(12, 6, generated.both, generated.play_batch),
    "limits": Kind(8, 6, generated.limits, generated.play_batch),
    "padded": Kind(8, 6, generated.padded, generated.play_batch),
    "double": Kind(8, 6, generated.double, generated.play_batch),
    "nominal": Kind(4, 2, generated.nominal, generated.play_batch),
    "boundary": Kind(5, 2, generated.boundary, generated.play_boundary),
    "sample": Kind(3, 3, generated.sampled, generated.play_sample, 0.25),
    "tampered": Kind(5, 4, altered.tampered, altered.play_tampered),
    "trajectories": Kind(1, 4, altered.trajectories, altered.play_trajectories, 0.25),
    "single": Kind(0.2, 4, generated.both, generated.play_single, 0.05),
}
WIRINGS_EVERY = 50_000  # samples; all wrong wirings once


def play(kind, number, seed, batch, tally):
    """One case."""
    spec = KINDS[kind]
    case = Case(seed, kind, number, max(2, round(batch * spec.batch)))
    try:
        spec.play(case, spec.problem(kind, number % spec.structures), tally)
    except Exception as error:  # a right wiring is not to be refused
        said = f"{type(error).__name__}: {str(error)[:200]}"
        tally.note("errors not called for", case=case, said=said)
    return case.batch


def cases(samples, batch):
    """(kind, number) of all cases, the kinds in turn as their shares have it."""
    whole = sum(each.share for each in KINDS.values())
    wanted = {
        name: max(1, round(samples * each.share / whole / max(2, round(batch * each.batch))))
        for name, each in KINDS.items()
    }
    order = [((k + 0.5) / count, name, k) for name, count in wanted.items() for k in range(count)]
    return [(name, k) for _, name, k in sorted(order)]


COLUMNS = ("judged", "satisfied", "false satisfied", "hold", "false refusals", "ties", "hypotheses hold", "rows worked out",
           "false hypotheses", "margins off", "broken promises", "errors raised", "errors missing", "errors not called for")  # fmt: skip


def table(tallies):
    """One line for each kind, and one for all."""
    total = Tally()
    for each in tallies.values():
        total.merge(each)
    rows = [("kind", *COLUMNS)]
    for name, each in [*tallies.items(), ("all", total)]:
        rows.append((name, *(str(each.counts[column]) for column in COLUMNS)))
    wide = [max(len(row[k].split(" ")[0]) for row in rows) for k in range(len(rows[0]))]
    wide = [max(w, *(len(word) for word in rows[0][k].split(" "))) for k, w in enumerate(wide)]
    lines = []
    deep = max(len(name.split(" ")) for name in rows[0])
    for level in range(deep):
        words = [([""] * deep + name.split(" "))[-deep:][level] for name in rows[0]]
        lines.append("  ".join(word.rjust(w) for word, w in zip(words, wide, strict=True)))
    lines += ["  ".join(v.rjust(w) for v, w in zip(row, wide, strict=True)) for row in rows[1:]]
    return "\n".join(lines), total


def incidents(tallies):
    """What has to be explained, a line each."""
    lines = []
    for name, each in tallies.items():
        shown = {}
        for what, details in each.notes:
            shown[what] = shown.get(what, 0) + 1
            if shown[what] <= SHOWN:
                text = ", ".join(f"{key} {value}" for key, value in details.items())
                lines.append(f"{what} ({name}): {text}")
        lines += [f"{what} ({name}): {n} in all" for what, n in shown.items() if n > SHOWN]
    return lines


def run(samples, seed, batch, *, progress=lambda text: None, wirings=True, only=None, number=None):
    """Plays; tallies of every kind by name."""
    tallies = {name: Tally() for name in KINDS}
    begun, done = time.perf_counter(), 0
    if only == "wirings":
        chosen = []
    elif only is not None:
        chosen = [(k, n) for k, n in cases(samples, batch) if k == only]
        chosen = chosen if number is None else [(only, number)]
    else:
        chosen = cases(samples, batch)
    for at, (kind, case) in enumerate(chosen):
        if at % PROGRAMS == PROGRAMS - 1:
            jax.clear_caches()  # a process may hold so many pieces of memory and no more
            gc.collect()
        done += play(kind, case, seed, batch, tallies[kind])
        took = time.perf_counter() - begun
        progress(f"{at + 1} of {len(chosen)} cases, {done} samples, {took:.0f} s, {kind} {case}")
    if wirings and only in (None, "wirings"):
        tallies["wirings"] = Tally()
        for k in range(max(1, round(samples / WIRINGS_EVERY))):
            progress(f"wrong wirings {k}, {time.perf_counter() - begun:.0f} s")
            play_wirings(Case(seed, "wirings", k, 1), tallies["wirings"])
    return {name: each for name, each in tallies.items() if each.counts}


def main():
    parser = argparse.ArgumentParser(description=__doc__.split("\n")[0])
    parser.add_argument("--samples", type=int, default=100_000)
    parser.add_argument("--seed", type=int, default=0)
    parser.add_argument("--batch", type=int, default=BATCH)
    parser.add_argument(
        "--only", choices=[*KINDS, "wirings"], metavar="KIND", help=f"{[*KINDS, 'wirings']}"
    )
    parser.add_argument("--case", type=int, metavar="N", help="of this kind")
    options = parser.parse_args()

    def progress(text):
        end = "" if sys.stderr.isatty() else "\n"
        print(f"\r\033[K{text}" if not end else text, end=end, file=sys.stderr, flush=True)

    begun = time.perf_counter()
    with warnings.catch_warnings(record=True) as heard:
        warnings.simplefilter("always")
        tallies = run(
            options.samples, options.seed, options.batch,
            progress=progress, only=options.only, number=options.case,
        )  # fmt: skip
    text, total = table(tallies)
    print(
        f"\nseed {options.seed}, batches of {options.batch}, {time.perf_counter() - begun:.0f} s\n{text}"
    )
    for line in incidents(tallies):
        print(line)
    for each in sorted({f"{w.filename}:{w.lineno}: {w.message}" for w in heard}):
        print(f"warning: {each}")
    refused = total.counts["false refusals"] / max(total.counts["hold"], 1)
    print(f"false refusals: {100 * refused:.4f}% of those that hold (bar {100 * REFUSALS:g}%)")
    print(
        f"bars missed: {', '.join(total.missed) or 'none'} (of {', '.join(BARS)}, false refusals)"
    )
    sys.exit(bool(total.missed))


if __name__ == "__main__":
    main()
