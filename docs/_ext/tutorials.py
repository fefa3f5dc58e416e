"""Runs the tutorials and turns them into pages with their output and their pictures.

A tutorial is a script in examples/tutorials. Its docstring is the page's beginning. `# %%` begins a cell: the comment
lines after it are Markdown, and the lines up to the next `# %%` are code.
"""

import contextlib
import io
import re
from pathlib import Path
from typing import NamedTuple

ROOT = Path(__file__).parents[2]
SCRIPTS = ROOT / "examples" / "tutorials"


class Cell(NamedTuple):
    """Text of a page in Markdown, the code after it, and the code's first line in the script."""

    text: str
    code: str
    line: int


def cells(script: str) -> list[Cell]:
    """The cells of a script; the first is its docstring, which has no code."""
    head, *rest = re.split(r"^# %%\n", script, flags=re.MULTILINE)
    out, line = [Cell(head.strip().strip('"').strip(), "", 1)], head.count("\n") + 2
    for cell in rest:
        lines = cell.splitlines()
        count = next((k for k, each in enumerate(lines) if not each.startswith("#")), len(lines))
        text = "\n".join(each.removeprefix("#").removeprefix(" ") for each in lines[:count])
        out.append(Cell(text, "\n".join(lines[count:]).strip("\n"), line + count))
        line += cell.count("\n") + 1
    return out


def page(path: Path, pictures: Path) -> str:
    """Runs a script; returns its page, and writes the pictures that it draws into a folder."""
    import matplotlib

    matplotlib.use("Agg")
    from matplotlib import pyplot

    parts, names, count = [], {"__name__": path.stem, "__file__": str(path)}, 0
    for cell in cells(path.read_text()):
        parts.append(cell.text)
        if not cell.code:
            continue
        printed = io.StringIO()
        with contextlib.redirect_stdout(printed):
            exec(compile("\n" * cell.line + cell.code, str(path), "exec"), names)
        parts.append(f"```python\n{cell.code}\n```")
        if printed.getvalue():
            parts.append(f"```text\n{printed.getvalue().rstrip()}\n```")
        for number in pyplot.get_fignums():
            count += 1
            name = f"{path.stem}_{count}.png"
            pyplot.figure(number).savefig(pictures / name, dpi=110, bbox_inches="tight")
            parts.append(f"![Picture {count} of this tutorial]({name})")
        pyplot.close("all")
    return "\n\n".join(parts) + "\n"


def write_pages(app: object) -> None:
    """Writes docs/tutorials, which git ignores, before Sphinx looks for pages."""
    folder = ROOT / "docs" / "tutorials"
    folder.mkdir(exist_ok=True)
    for path in sorted(SCRIPTS.glob("*.py")):
        target = folder / f"{path.stem}.md"
        target.write_text(page(path, folder))


def setup(app: object) -> dict[str, bool]:
    """Connects the extension."""
    app.connect("builder-inited", write_pages)
    return {"parallel_read_safe": True, "parallel_write_safe": True}
