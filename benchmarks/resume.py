"""A long run is killed and resumed near its end: how long it takes to go on, and whether memory stays flat.

The first chunk is generated; the lines up to the place of the kill are copies of it, but for the last, which has the
condition of its number, as the command checks it.

Run: python benchmarks/resume.py [--lines 900000] [--count 1000000], about two minutes
"""

import argparse
import json
import subprocess
import sys
import tempfile
import time
from pathlib import Path

from deggflow.tasks.tabletop.changes import random_conditions

SIZE, SEED = 4, 0


def until_it_grows(command: list[str], path: Path) -> tuple[float, float]:
    """Starts a command and kills it once its file has grown: seconds until then, and MB of memory at the most."""
    before, begun = path.stat().st_size if path.exists() else 0, time.monotonic()
    process = subprocess.Popen(command, stderr=subprocess.DEVNULL)
    while process.poll() is None and (not path.exists() or path.stat().st_size <= before):
        time.sleep(0.05)
    took = time.monotonic() - begun
    status = Path(f"/proc/{process.pid}/status").read_text()
    process.kill()
    process.wait()
    peak = next(line for line in status.splitlines() if line.startswith("VmHWM"))
    return took, int(peak.split()[1]) / 1024


def main() -> None:
    """Prints times and memory."""
    parser = argparse.ArgumentParser(description="Resume a long run near its end.")
    parser.add_argument("--lines", type=int, default=900_000)
    parser.add_argument("--count", type=int, default=1_000_000)
    given = parser.parse_args()
    with tempfile.TemporaryDirectory() as folder:
        path = Path(folder) / "scenes.jsonl"
        options = {"--size": SIZE, "--count": given.count, "--seed": SEED, "--out": path}
        words = [str(word) for pair in options.items() for word in pair]
        command = [sys.executable, "-m", "deggflow.app.start", "tabletop", "generate", *words]
        until_it_grows(command, path)  # compiles
        took, fresh = until_it_grows(command, path)
        print(f"resumed after the first chunk: {took:.1f} s until more is written, {fresh:.0f} MB")
        chunk = path.read_bytes().splitlines(keepends=True)[:512]
        (last,) = random_conditions(SIZE, 1, "changed", SEED, given.lines - 1)
        with path.open("wb") as file:
            for start in range(0, given.lines - 1, len(chunk)):
                file.writelines(chunk[: given.lines - 1 - start])
            line = {**json.loads(chunk[0]), "condition": last.to_json()}
            file.write(json.dumps(line).encode() + b"\n")
        size = path.stat().st_size / 1e9
        took, resumed = until_it_grows(command, path)
        print(
            f"resumed after {given.lines:,} lines ({size:.2f} GB): {took:.1f} s, {resumed:.0f} MB"
        )
        print(f"{resumed / fresh:.2f} times the memory")


if __name__ == "__main__":
    main()
