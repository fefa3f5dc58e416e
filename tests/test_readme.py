"""What the README shows runs as it stands there."""

import re
import subprocess
import sys
from pathlib import Path

README = Path(__file__).parent.parent / "README.md"


def blocks(language):
    return re.findall(rf"```{language}\n(.*?)```", README.read_text(), re.DOTALL)


def without_numbers(text):
    return re.sub(r"[-+.e\d]+", "#", re.sub(r" +", " ", text)).split()


def test_your_own_problem(tmp_path):
    (program,) = blocks("python")
    found = subprocess.run(
        [sys.executable, "-W", "error", "-c", program],
        capture_output=True,
        text=True,
        cwd=tmp_path,
        check=True,
    )
    (shown,) = blocks("text")
    # Digits may differ from machine to machine, what is said does not.
    assert without_numbers(found.stdout) == without_numbers(shown)


def test_it_fits_into_thirty_lines():
    """Counting what a user writes for a problem of their own: code, not blank lines or imports."""
    (program,) = blocks("python")
    lines = [line for line in program.splitlines() if line.strip() and "import" not in line]
    assert len(lines) <= 30
