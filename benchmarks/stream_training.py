"""Makes a large table of training scenes by repetition, trains on it and prints the most memory that was resident.

    python benchmarks/stream_training.py scenes.parquet --gigabytes 20 --folder big --steps 1000

The table's row groups are those of the given one, over and over. Training runs in a process of its own, whose memory is
read from /proc (Linux). Options after `--` go to `deggflow tabletop train`.
"""

import argparse
import subprocess
import sys
import time
from pathlib import Path

import pyarrow.parquet as pq

_GROUP = 16_384  # rows


def repeat(source, out, size):
    """Writes the table's rows over and over until the file has `size` bytes."""
    import pyarrow

    table = pq.read_table(source)
    group = pyarrow.concat_tables([table] * max(1, _GROUP // len(table)))
    rows = 0
    # Repeated rows would compress away.
    plain = {"compression": "none", "use_dictionary": False}
    with pq.ParquetWriter(out, table.schema, **plain, write_page_checksum=True) as file:
        while not out.exists() or out.stat().st_size < size:
            file.write_table(group)
            rows += len(group)
    return rows


def peak(process):
    """The most resident memory of a running process so far, in bytes, and its part that is backed by no file; 0 once it ended."""
    try:
        lines = Path(f"/proc/{process.pid}/status").read_text().splitlines()
    except OSError:
        return 0, 0
    values = {line.split(":")[0]: line.split()[1] for line in lines if line.endswith("kB")}
    return 1024 * int(values.get("VmHWM", 0)), 1024 * int(values.get("RssAnon", 0))


def main():
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("scenes", type=Path)
    parser.add_argument("--gigabytes", type=float, default=20.0)
    parser.add_argument("--folder", type=Path, required=True)
    parser.add_argument("--steps", type=int, default=1000)
    arguments, rest = parser.parse_known_args()
    folder = arguments.folder
    folder.mkdir(parents=True, exist_ok=True)
    table = folder / "training.parquet"
    if not table.exists():
        begin = time.perf_counter()
        repeat(arguments.scenes, table, arguments.gigabytes * 1e9)
        print(f"written in {time.perf_counter() - begin:.0f} s", flush=True)
    rows = pq.read_metadata(table).num_rows
    print(f"{table}: {table.stat().st_size / 1e9:.2f} GB, {rows} rows", flush=True)
    command = [
        *(sys.executable, "-m", "deggflow.app.start", "tabletop", "train"),
        *("--data", table, "--validation", arguments.scenes, "--out", folder / "run"),
        *("--steps", str(arguments.steps), *(each for each in rest if each != "--")),
    ]
    begin, most, anonymous = time.perf_counter(), 0, 0
    process = subprocess.Popen(list(map(str, command)))
    while process.poll() is None:
        resident, own = peak(process)
        most, anonymous = max(most, resident), max(anonymous, own)
        time.sleep(0.2)
    records = folder / "run" / "encoded" / "training.records"
    print(
        f"exit code {process.returncode}; {time.perf_counter() - begin:.0f} s; most resident {most / 1e9:.2f} GB, "
        f"of which not backed by files {anonymous / 1e9:.2f} GB; encoded {records.stat().st_size / 1e9:.2f} GB",
        flush=True,
    )


if __name__ == "__main__":
    main()
