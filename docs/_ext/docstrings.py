"""Docstrings have the little Markdown that people type; Sphinx reads reStructuredText. Code spans become literals, and
characters that would mean something else, as in |u_i|, are escaped.
"""

import re

from sphinx.application import Sphinx

CODE = re.compile(r"(``.+?``|`[^`]+`)", re.DOTALL)


def _text(block: str) -> str:
    if block.lstrip().startswith(">>>"):
        return block
    parts = CODE.split(block)
    for k, part in enumerate(parts):
        if k % 2:
            inner = re.sub(r"\s+", " ", part.strip("`")) if "\n" not in part else part.strip("`")
            joined = bool(parts[k + 1]) and not parts[k + 1][0].isspace()
            parts[k] = f"``{inner}``" + "\\ " * joined
        else:
            parts[k] = re.sub(r"(?<!\\)[|*]|(?<=\w)_(?!\w)", r"\\\g<0>", part)
    return "".join(parts)


def _as_text(
    app: Sphinx, what: str, name: str, obj: object, options: object, lines: list[str]
) -> None:
    lines[:] = re.sub(
        r"(?:(?!\n[ ]*\n).)+", lambda block: _text(block.group()), "\n".join(lines), flags=re.DOTALL
    ).split("\n")


def _signature(
    app: Sphinx, what: str, name: str, obj: object, options: object, signature: str, result: str
) -> tuple[str | None, str | None]:
    """Arrays have the name by which users know them."""
    return tuple(
        text and re.sub(r"jaxlib\._jax\.Array", "Array", text) for text in (signature, result)
    )


def _skip(
    app: Sphinx, what: str, name: str, obj: object, skip: bool, options: object
) -> bool | None:
    """Leaves out fields of tuples and dataclasses: they are described under their class."""
    if type(obj).__name__ in ("_tuplegetter", "member_descriptor"):
        return True
    return None


def setup(app: Sphinx) -> dict[str, bool]:
    """Connects the extension, in front of the one that reads sections of docstrings."""
    app.connect("autodoc-process-docstring", _as_text, priority=400)
    app.connect("autodoc-process-signature", _signature)
    app.connect("autodoc-skip-member", _skip)
    return {"parallel_read_safe": True, "parallel_write_safe": True}
