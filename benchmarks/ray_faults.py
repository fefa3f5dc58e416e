"""Generates scenes on a real Ray cluster of two nodes while workers, a node and the driver are killed.

    python benchmarks/ray_faults.py --count 100000 --size 8 --folder ray-faults

The nodes are processes of this machine (ray.cluster_utils). At set fractions of the finished lines, a worker is killed,
a node is killed and another one joins, the driver is killed and started again, and another worker is killed. Then the
lines are compared with those of a run without Ray, exported to Parquet, and certified. The exit code is 0 if there are
as many unique rows as were asked for, all bytes agree, and every certificate is confirmed.
"""

import argparse
import os
import signal
import subprocess
import sys
import time
from pathlib import Path

from ray.cluster_utils import Cluster

COMMAND = (sys.executable, "-m", "deggflow.app.start")
FAULTS = {0.15: "worker", 0.35: "node", 0.55: "driver", 0.75: "worker"}


def lines(path):
    """Number of finished lines."""
    return path.read_bytes().count(b"\n") if path.exists() else 0


def workers(cluster):
    """Processes of the cluster's workers that are generating a chunk, by parent."""
    raylets = {
        each.process.pid for node in cluster.list_all_nodes() for each in node.all_processes["raylet"]
    }  # fmt: skip
    found = []
    for folder in Path("/proc").glob("[0-9]*"):
        try:
            name = (folder / "cmdline").read_bytes()
            parent = int((folder / "stat").read_text().rsplit(")", 1)[1].split()[1])
        except OSError:
            continue  # it ended meanwhile
        if name.startswith(b"ray::generate_chunk") and parent in raylets:
            found.append(int(folder.name))
    return found


class Run:
    """A cluster with a driver."""

    def __init__(self, folder, arguments, cpus):
        self.out, self.cpus = folder / "ray.jsonl", cpus
        self.cluster = Cluster(initialize_head=True, head_node_args={"num_cpus": cpus})
        self.node = self.cluster.add_node(num_cpus=cpus)
        self.command = [*COMMAND, *arguments, "--out", self.out, "--engine", "ray"]
        self.command += ["--address", self.cluster.address, "--cpus", cpus]
        self.start()

    def start(self):
        """Starts the driver, or starts it again."""
        self.driver = subprocess.Popen(list(map(str, self.command)))

    def strike(self, what):
        """Kills a worker, a node or the driver; says whether there was one."""
        if what == "worker":
            pids = workers(self.cluster)
            if not pids:
                return False
            os.kill(pids[0], signal.SIGKILL)
        elif what == "node":
            self.cluster.remove_node(self.node, allow_graceful=False)
            self.node = self.cluster.add_node(num_cpus=self.cpus)
        else:
            self.driver.kill()
            self.driver.wait()
            self.start()
        return True

    def finish(self, count):
        """Waits for the driver, and strikes on the way; returns its exit code."""
        faults = sorted(FAULTS.items())
        while self.driver.poll() is None:
            if faults and lines(self.out) >= faults[0][0] * count and self.strike(faults[0][1]):
                print(f"{lines(self.out)} lines: killed a {faults.pop(0)[1]}", flush=True)
            time.sleep(0.2)
        print(f"faults that were not reached: {len(faults)}", flush=True)
        return self.driver.returncode


def deggflow(*arguments):
    return subprocess.run([*COMMAND, *map(str, arguments)], check=False, stdout=subprocess.PIPE)


def main():
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--count", type=int, default=100_000)
    parser.add_argument("--size", type=int, default=8)
    parser.add_argument("--seed", type=int, default=0)
    parser.add_argument("--cpus", type=int, default=1, help="of each node and task")
    parser.add_argument("--folder", type=Path, required=True)
    given = parser.parse_args()
    given.folder.mkdir(parents=True, exist_ok=True)
    arguments = ["tabletop", "generate", "--size", given.size, "--count", given.count]
    arguments += ["--seed", given.seed]
    begin = time.perf_counter()
    run = Run(given.folder, arguments, given.cpus)
    code = run.finish(given.count)
    print(f"driver: exit code {code} after {time.perf_counter() - begin:.0f} s", flush=True)
    run.cluster.shutdown()
    begin, whole = time.perf_counter(), given.folder / "whole.jsonl"
    deggflow(*arguments, "--out", whole)
    print(f"without Ray: {time.perf_counter() - begin:.0f} s", flush=True)
    same = whole.read_bytes() == run.out.read_bytes()
    table = given.folder / "scenes.parquet"
    table.unlink(missing_ok=True)
    deggflow("export", run.out, "--out", table)
    import pyarrow.parquet as pq

    unique = len(set(pq.read_table(table, columns=["row"])["row"].to_pylist()))
    certified = deggflow("tabletop", "certify", table, "--quiet")
    print(certified.stdout.decode().strip())
    print(f"{unique} unique rows; the bytes {'agree' if same else 'DIFFER'}")
    sys.exit(not (same and unique == given.count and code == 0 == certified.returncode))


if __name__ == "__main__":
    main()
