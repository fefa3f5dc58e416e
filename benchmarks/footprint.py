"""Install size and import time of wheels, each in a fresh environment; imports alternate.

    python benchmarks/footprint.py before=old.whl now=dist/deggflow-0.1.0-py3-none-any.whl

Wheels come from `python -m build --wheel`, of an older commit in a `git worktree`. Prints the packages that each installs,
their size on disk without pip and compiled Python, the size of deggflow itself, and the time of processes: an empty
program, `import deggflow`, which loads nothing yet, the import of a name, which loads JAX, and the commands' help.
"""

import argparse
import statistics
import subprocess
import sys
import tempfile
import time
import venv
from pathlib import Path

PROGRAMS = {
    "empty program": ["-c", "pass"],
    "import deggflow": ["-c", "import deggflow"],
    "from deggflow import sample": ["-c", "from deggflow import sample"],
    "deggflow --help": ["-m", "deggflow.app.start", "--help"],
}


def installed(wheel: str, folder: Path) -> Path:
    """The Python of a fresh environment in which the wheel is installed."""
    venv.create(folder, with_pip=True)
    python = folder / ("Scripts" if sys.platform == "win32" else "bin") / "python"
    pip = [str(python), "-m", "pip", "--quiet", "--disable-pip-version-check"]
    subprocess.run([*pip, "install", wheel], check=True)
    return python


def size(folder: Path) -> float:
    """MB of all files, without compiled Python, which pip may or may not have written."""
    files = (each for each in folder.rglob("*") if each.is_file() and each.suffix != ".pyc")
    return sum(each.lstat().st_size for each in files) / 1e6


def packages(python: Path) -> tuple[int, float, float]:
    """Number of packages without pip, their MB, and those of deggflow."""
    code = "import sysconfig; print(sysconfig.get_path('purelib'))"
    site = Path(subprocess.check_output([python, "-c", code], text=True).strip())
    names = [each for each in site.glob("*.dist-info") if not each.name.startswith(("pip-", "setuptools-"))]  # fmt: skip
    others = sum(size(each) for each in site.glob("pip*")) + sum(size(each) for each in site.glob("setuptools*"))  # fmt: skip
    return len(names), size(site) - others, size(site / "deggflow")


def seconds(python: Path, arguments: list[str]) -> float:
    """Time of one process on the clock."""
    start = time.perf_counter()
    subprocess.run([python, *arguments], check=True, stdout=subprocess.DEVNULL)
    return time.perf_counter() - start


def main() -> None:
    """Installs, measures, prints a table."""
    parser = argparse.ArgumentParser(description=__doc__.partition("\n")[0])
    parser.add_argument("wheels", nargs="+", metavar="LABEL=WHEEL")
    parser.add_argument("--rounds", type=int, default=15)
    options = parser.parse_args()
    wheels = dict(each.split("=", 1) for each in options.wheels)
    with tempfile.TemporaryDirectory() as folder:
        pythons = {
            label: installed(wheel, Path(folder) / str(k))
            for k, (label, wheel) in enumerate(wheels.items())
        }
        times = {(label, name): [] for label in pythons for name in PROGRAMS}
        for _ in range(options.rounds + 1):
            for label, name in times:
                times[label, name].append(seconds(pythons[label], PROGRAMS[name]))
        print("| | packages | all, MB | deggflow, MB | " + " | ".join(f"{name}, s" for name in PROGRAMS) + " |")  # fmt: skip
        print("|" + "---|" * (4 + len(PROGRAMS)))
        for label, python in pythons.items():
            count, everything, own = packages(python)
            medians = [statistics.median(times[label, name][1:]) for name in PROGRAMS]
            cells = [label, str(count), f"{everything:.0f}", f"{own:.1f}", *(f"{value:.2f}" for value in medians)]  # fmt: skip
            print("| " + " | ".join(cells) + " |")


if __name__ == "__main__":
    main()
