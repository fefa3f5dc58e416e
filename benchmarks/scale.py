"""The arithmetic of large runs: measured costs, and a discrete-event model of many workers that is fed by them.

    python benchmarks/scale.py measure --out scale.json     # a few minutes
    python benchmarks/scale.py simulate scale.json

`measure` states core-seconds (CPU time of all threads), which other jobs on the machine change less than they change the
time on the clock, and compares one and two workers in alternating rounds. `simulate` prints the cost of large runs, the
model beside the measured points, and its efficiency for up to 1,000 workers: shards, which are fixed parts, and an
engine that hands out chunks and whose driver writes all lines.
"""

import argparse
import heapq
import json
import pickle
import platform
import random
import statistics
import subprocess
import sys
import tempfile
import time
from pathlib import Path

from deggflow.app.cluster import AHEAD

CHUNK, SIZE, ROBOTS = 512, 8, 4
COMMAND = (sys.executable, "-m", "deggflow.app.start")
WORKERS = (1, 2, 4, 10, 100, 1000)


def cpu(call):
    """CPU time of a call in this process, all threads, s."""
    begin = time.process_time()
    call()
    return time.process_time() - begin


def peak_memory():
    """The most resident memory of this process so far, MB."""
    lines = Path("/proc/self/status").read_text().splitlines()
    return int(next(line for line in lines if line.startswith("VmHWM")).split()[1]) / 1024


def processor():
    """Name of the processor."""
    for line in Path("/proc/cpuinfo").read_text().splitlines():
        if line.startswith("model name"):
            return line.split(":")[1].strip()
    return platform.processor()


def scenes(chunks):
    """Core-seconds of each chunk of guided scenes as lines, and the bytes of a line."""
    from deggflow.tasks.tabletop.changes import random_conditions
    from deggflow.tasks.tabletop.field import load_field
    from deggflow.tasks.tabletop.task import scene_generator

    begin = time.process_time()
    generator = scene_generator(load_field())
    made = []

    def generate(first):
        conditions = random_conditions(SIZE, CHUNK, "changed", 0, first)
        scenes = generator.scenes(conditions, seed=0, first=first)
        made[:] = [json.dumps(scene.to_json()) for scene in scenes]

    generate(0)
    start = time.process_time() - begin
    times = [cpu(lambda k=k: generate(k * CHUNK)) for k in range(1, chunks + 1)]
    return {
        "start": start - statistics.median(times),
        "chunks": times,
        "driver": driver_time(made),
        "bytes": sum(len(each) for each in made) / CHUNK,
        "memory": peak_memory(),
    }


def driver_time(lines, repetitions=20):
    """Core-seconds that the driver of an engine takes for the lines of a chunk: to receive and to write them."""
    from deggflow.output import ResumableOutput, forget

    received = pickle.dumps("\n".join(lines))
    with (
        tempfile.TemporaryDirectory() as folder,
        ResumableOutput(Path(folder) / "x.jsonl", {}, on_row=forget) as output,
    ):

        def handle():
            output.append_lines(pickle.loads(received).split("\n"))

        times = [cpu(handle) for _ in range(repetitions)]
    return statistics.median(times)


def table_bytes(count=CHUNK):
    """Bytes of a scene in Parquet, and core-seconds of its export; None without pyarrow."""
    try:
        from deggflow.tables import write_rows
        from deggflow.tasks.tabletop.changes import random_conditions
        from deggflow.tasks.tabletop.field import load_field
        from deggflow.tasks.tabletop.lines import SceneLine
        from deggflow.tasks.tabletop.task import scene_generator

        made = scene_generator(load_field()).scenes(random_conditions(SIZE, count, "changed", 0))
        rows = [json.loads(json.dumps(scene.to_json())) for scene in made]
        with tempfile.TemporaryDirectory() as folder:
            path = Path(folder) / "x.parquet"
            seconds = cpu(lambda: write_rows(path, SceneLine, rows, {}))
            return path.stat().st_size / count, seconds / count
    except Exception as error:
        if "pyarrow" not in str(error):
            raise
        return None


def trials(count=32):
    """Core-seconds of a guided trial."""
    from deggflow.tasks.bridge.field import load_field
    from deggflow.tasks.bridge.scenes import random_conditions
    from deggflow.tasks.bridge.task import trial_generator

    generator = trial_generator(load_field())
    generator.trials(random_conditions(ROBOTS, count, 1), seed=1)
    return cpu(lambda: generator.trials(random_conditions(ROBOTS, count, 0), seed=0)) / count


def training(steps=20, batch=256):
    """Core-seconds of a training step of the shipped tabletop field's size, N = 8."""
    import jax

    from deggflow.tasks.tabletop.changes import random_conditions
    from deggflow.tasks.tabletop.condition import to_arrays
    from deggflow.tasks.tabletop.field import build_field
    from deggflow.train import Dataset, TrainingConfig, train

    arrays = to_arrays(random_conditions(SIZE, batch, "default", 0))
    z = jax.random.normal(jax.random.key(0), (batch, SIZE, 3))
    data = Dataset(z, arrays, arrays.mask)
    few = jax.tree.map(lambda leaf: leaf[:8], data)
    seen = []
    with tempfile.TemporaryDirectory() as folder:
        config = TrainingConfig(steps=3 * steps, batch=batch, validate_every=steps)
        field = build_field(jax.random.key(0))
        train(field, data, few, config, folder, on_progress=lambda c: seen.append(time.process_time()))  # fmt: skip
    return (seen[2] - seen[1]) / steps


def worker_rounds(rounds, chunks):
    """Time on the clock of one worker, and of two at once, each with so many chunks on a core of its own."""
    out = []
    with tempfile.TemporaryDirectory() as folder:
        for number in range(rounds):
            row = []
            for workers in (1, 2) if number % 2 else (2, 1):
                begin = time.perf_counter()
                running = [
                    subprocess.Popen(
                        [
                            *("taskset", "-c", str(k), *COMMAND, "tabletop", "generate"),
                            *("--size", str(SIZE), "--count", str(CHUNK * chunks * workers)),
                            *("--shard", f"{k + 1}/{workers}", "--seed", str(number)),
                            *("--out", f"{folder}/{number}-{workers}-{k}.jsonl"),
                        ],
                        stderr=subprocess.DEVNULL,
                    )
                    for k in range(workers)
                ]
                assert all(process.wait() == 0 for process in running)
                row.append((workers, time.perf_counter() - begin))
            out.append(dict(row))
            print(f"round {number + 1}: {out[-1]}", flush=True)
    return [[row[1], row[2]] for row in out]


def measure(chunks, rounds):
    """All measurements, as JSON values."""
    out = {"processor": processor(), "scene": scenes(chunks)}
    print(json.dumps(out), flush=True)
    out["table"] = table_bytes()
    out["trial"] = trials()
    out["step"] = training()
    print(json.dumps({k: out[k] for k in ("table", "trial", "step")}), flush=True)
    out["rounds"] = {"chunks": 2, "seconds": worker_rounds(rounds, 2)}
    return out


def simulate(times, start, count, workers, *, driver=None, lifetime=None, seed=0):
    """Time on the clock until all chunks are done by workers of one core each, s.

    Args:
        times: Measured times of a chunk, of which each chunk draws one.
        start: Time until a worker has imported and compiled everything.
        count: Number of chunks.
        workers: Number of workers.
        driver: None: every worker has a fixed share of the chunks. Else the driver's time for the lines of a chunk, all of
            which it writes.
        lifetime: Mean time until a worker dies; it starts again and repeats its chunk. None: none dies.
        seed: Of the draws.
    """
    rng = random.Random(seed)
    free = [(0.0, k) for k in range(workers)]
    fixed = [count * (k + 1) // workers - count * k // workers for k in range(workers)]
    deaths = [rng.expovariate(1 / lifetime) if lifetime else float("inf") for _ in range(workers)]
    ready = [False] * workers
    written = end = 0.0
    left = count
    heapq.heapify(free)
    while left:
        now, k = heapq.heappop(free)
        if driver is None and not fixed[k]:
            continue
        done = now + (0.0 if ready[k] else start) + rng.choice(times)
        ready[k] = True
        if done > deaths[k]:
            heapq.heappush(free, (deaths[k], k))
            ready[k], deaths[k] = False, deaths[k] + rng.expovariate(1 / lifetime)
            continue
        left -= 1
        fixed[k] -= 1
        if driver is not None:
            # Lines are written in order; so many chunks of each worker may wait for those before them.
            written = max(written, done) + driver
            heapq.heappush(free, (max(done, written - (AHEAD - 1) * statistics.fmean(times)), k))
            end = max(end, written)
        else:
            heapq.heappush(free, (done, k))
            end = max(end, done)
    return end


def report(data):
    """Prints costs, the check of the model and its efficiency."""
    scene, times = data["scene"], data["scene"]["chunks"]
    each = statistics.fmean(times) / CHUNK
    print(f"processor: {data['processor']}")
    print(
        f"guided scene, N = {SIZE}: {1000 * each:.1f} core-ms ({len(times)} chunks of {CHUNK}, {min(times):.2f} to {max(times):.2f} s)"
    )
    print(
        f"guided trial, N = {ROBOTS}: {data['trial']:.2f} core-s; training step, batch 256, N = {SIZE}: {1000 * data['step']:.0f} core-ms"
    )
    print(
        f"start of a worker: {scene['start']:.1f} core-s; memory of a worker: {scene['memory']:.0f} MB"
    )
    print(
        f"a line: {scene['bytes']:.0f} bytes, {1e6 * scene['driver'] / CHUNK:.1f} us of an engine's driver"
    )
    if data["table"]:
        print(
            f"a row of a table: {data['table'][0]:.0f} bytes, {1e6 * data['table'][1]:.0f} us to export"
        )
    print("\nscenes        core-hours   64 workers  1,000 workers   JSON Lines   Parquet")
    for count in (10**6, 10**8, 10**9):
        hours = [simulate(times, scene["start"], -(-count // CHUNK), w) / 3600 for w in (64, 1000)]
        sizes = [scene["bytes"], *(data["table"] or [])[:1]]
        print(
            f"{count:<13,} {count * each / 3600:>10,.1f} {hours[0]:>10.2f} h {hours[1]:>11.3f} h   "
            + "   ".join(f"{count * size / 1e9:,.1f} GB" for size in sizes)
        )
    rounds = data["rounds"]
    ratios = [one / two for one, two in rounds["seconds"]]
    model = [simulate(times, scene["start"], rounds["chunks"] * k, k) for k in (1, 2)]
    print(
        f"\ntwo workers against one, each with {rounds['chunks']} chunks: efficiency {statistics.median(ratios):.2f} "
        f"({min(ratios):.2f} to {max(ratios):.2f}) measured, {model[0] / model[1]:.2f} by the model"
    )
    print("\nefficiency    " + "".join(f"{w:>9,}" for w in WORKERS) + "  workers")
    settings = {
        "shards": {},
        "engine": {"driver": scene["driver"]},
        "shards, a death per worker and 10 h": {"lifetime": 36_000},
        "engine, the same": {"driver": scene["driver"], "lifetime": 36_000},
    }
    for count in (10**6, 10**8):
        chunks = -(-count // CHUNK)
        for name, options in settings.items():
            row = []
            for workers in WORKERS:
                spent = simulate(times, scene["start"], chunks, workers, **options)
                row.append(chunks * statistics.fmean(times) / workers / spent)
            print(f"{count:,} scenes, {name}: " + " ".join(f"{each:.3f}" for each in row))


def main():
    """Measures, or simulates from measurements."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    commands = parser.add_subparsers(dest="command", required=True)
    measuring = commands.add_parser("measure")
    measuring.add_argument("--out", type=Path, required=True)
    measuring.add_argument("--chunks", type=int, default=8)
    measuring.add_argument("--rounds", type=int, default=4)
    simulating = commands.add_parser("simulate")
    simulating.add_argument("file", type=Path)
    given = parser.parse_args()
    if given.command == "measure":
        given.out.write_text(json.dumps(measure(given.chunks, given.rounds), indent=1) + "\n")
    else:
        report(json.loads(given.file.read_text()))


if __name__ == "__main__":
    main()
