"""Runs every command of README and docs as it is printed, page by page, each page in a fresh folder.

A command that takes longer than the limit is interrupted, as by Ctrl-C, which every command of deggflow must survive
without a traceback; then the same command with few results makes the files that the page goes on with.

Run: python benchmarks/docs_commands.py [--limit 60] [--only README.md bridge.md], in the environment of `make test`
"""

import argparse
import json
import os
import re
import shlex
import shutil
import signal
import subprocess
import sys
import tempfile
import time
from collections import Counter
from collections.abc import Container
from pathlib import Path
from typing import NamedTuple

ROOT = Path(__file__).parents[1]
PAGES = [ROOT / "README.md", ROOT / "CONTRIBUTING.md", *sorted((ROOT / "docs").glob("*.md"))]
BLOCK = re.compile(r"^```(sh|console|bash)\n(.*?)^```", re.DOTALL | re.MULTILINE)
HERE = ("sh", "console")  # bash: scripts of other machines
# Set-up, machines, devices and wheels of one's own, or the task of extending.md, which has a test of its own:
ELSEWHERE = re.compile(
    r"^(make|pip|git|cd|deggflow drones) |10\.0\.0\.|\.local:|\.whl|--devices [2-9]"
)
COMMENT = re.compile(r"(^|\s+)#.*|\s+$")
NUMBER = re.compile(r"--(count|cases|trials|hard|modes) ([0-9]+)")
GRACE = 120  # s that an interrupted command may take to end on a busy machine

# What a page's commands read and other pages' commands write.
SCENES = "deggflow tabletop generate --size 8 --count 20 --out scenes.jsonl"
TRIALS = "deggflow bridge generate --size 4 --count 2 --out trials.jsonl"
DATA = "deggflow tabletop data --training 600 --validation 60 --out data"
TABLES = "deggflow export data --out before"
MEASURED = "python benchmarks/scale.py measure --chunks 1 --rounds 1 --out scale.json"
READ = {
    "certify.md": (SCENES, TRIALS),
    "scale.md": (TRIALS, DATA, f"{TABLES} && cp before/training.parquet big.parquet", MEASURED),
}  # fmt: skip


class Ended(NamedTuple):
    """How a command ended."""

    how: str
    seconds: float
    output: str = ""

    @property
    def last(self) -> str:
        """Line of its output."""
        return self.output.strip().rpartition("\n")[2]


def commands_of(page: Path, kinds: Container[str] = HERE) -> list[str]:
    """The lines of the page's shell blocks, without prompts and comments."""
    blocks = [
        text.replace("\\\n", " ") for kind, text in BLOCK.findall(page.read_text()) if kind in kinds
    ]
    lines = [COMMENT.sub("", line) for block in blocks for line in block.splitlines()]
    return list(dict.fromkeys(line.removeprefix("$ ") for line in lines if line))


def run(command: str, folder: Path, limit: float) -> Ended:
    """Runs a command in a folder, and interrupts it after `limit` seconds."""
    line = command.replace("python benchmarks/", f"python {ROOT}/benchmarks/")
    path = f"{Path(sys.executable).parent}{os.pathsep}{os.environ['PATH']}"
    begin = time.monotonic()
    with tempfile.TemporaryFile("w+") as output:
        process = subprocess.Popen(
            line, shell=True, executable="/bin/bash", cwd=folder, env={**os.environ, "PATH": path},
            stdout=output, stderr=subprocess.STDOUT, stdin=subprocess.DEVNULL, start_new_session=True,
        )  # fmt: skip
        stopped = False
        try:
            process.wait(limit)
        except subprocess.TimeoutExpired:
            stopped = True
            os.killpg(process.pid, signal.SIGINT)
            try:
                process.wait(GRACE)
            except subprocess.TimeoutExpired:
                os.killpg(process.pid, signal.SIGKILL)
                process.wait()
                return Ended("FAILED: does not end on Ctrl-C", time.monotonic() - begin)
        output.seek(0)
        text = output.read()
    code = process.returncode
    good = {0: "finished", 3: "finished, not all satisfied"}
    ended = Ended(good.get(code, f"FAILED: exit code {code}"), time.monotonic() - begin, text)
    script = stopped and command.startswith("python ") and ended.last == "KeyboardInterrupt"
    if "Traceback" in text and not script:
        return ended._replace(how="FAILED: traceback")
    if stopped:
        return ended._replace(how="interrupted")
    if code == 2 and "pip install" in text:
        return ended._replace(how="needs an extra")
    return ended


def _few(option: re.Match[str]) -> str:
    """A hundredth of the results."""
    return f"--{option[1]} {max(2, int(option[2]) // 100)}"


def write_requested(command: str, folder: Path) -> None:
    """The conditions that `certify --conditions FILE` compares with: those of the file of results itself."""
    words = shlex.split(command)
    if "certify" in words and "--conditions" in words:
        lines = (folder / words[words.index("certify") + 1]).read_text().splitlines()
        asked = [json.dumps(json.loads(line)["condition"]) + "\n" for line in lines]
        (folder / words[words.index("--conditions") + 1]).write_text("".join(asked))


def run_page(page: Path, limit: float, totals: Counter[str]) -> None:
    """Runs the commands of a page in order."""
    with tempfile.TemporaryDirectory() as name:
        folder, before = Path(name) / "now", Path(name) / "before"
        folder.mkdir()
        for command in READ.get(page.name, ()):
            run(command, folder, 600)
        for command in commands_of(page):
            if ELSEWHERE.search(command):
                ended = Ended("not run: set-up, other machines, or another task", 0)
            else:
                write_requested(command, folder)
                shutil.rmtree(before, ignore_errors=True)
                shutil.copytree(folder, before)
                ended = run(command, folder, limit)
            if ended.how == "interrupted" and NUMBER.search(command):
                shutil.rmtree(folder)
                shutil.copytree(before, folder)
                run(NUMBER.sub(_few, command), folder, 600)
            totals[ended.how.partition(":")[0]] += 1
            note = f" - {ended.last[:100]}" if ended.how.startswith(("FAILED", "needs")) else ""
            print(f"{page.name}: {command}: {ended.how} ({ended.seconds:.0f} s){note}", flush=True)


def main() -> int:
    """Runs all pages; exit code 1 if a command failed."""
    parser = argparse.ArgumentParser(description=(__doc__ or "").partition("\n")[0])
    parser.add_argument("--limit", type=float, default=60, help="seconds of each command")
    parser.add_argument("--only", nargs="*", default=[], help="names of pages")
    arguments, totals = parser.parse_args(), Counter[str]()
    # A shell that runs this in the background has it ignore Ctrl-C, and so would every command.
    if signal.getsignal(signal.SIGINT) is signal.SIG_IGN:
        signal.signal(signal.SIGINT, signal.default_int_handler)
    for page in PAGES:
        if not arguments.only or page.name in arguments.only:
            run_page(page, arguments.limit, totals)
    print("; ".join(f"{how}: {count}" for how, count in sorted(totals.items())))
    return 1 if totals["FAILED"] else 0


if __name__ == "__main__":
    sys.exit(main())
