"""What a page may ask of any task, and how it is answered."""

import base64
import json
import shlex
from collections.abc import Callable, Mapping
from dataclasses import dataclass
from io import BytesIO
from typing import Any, NamedTuple, TypeVar

from deggflow.jsonl import InputError, expect_choice, parse_lines

MAX_ROWS = 200  # of a file that is opened


@dataclass(frozen=True)
class Nothing:
    """A message without fields."""


@dataclass(frozen=True)
class Open:
    """A file's results or conditions are to be read.

    Attributes:
        name: Of the file, for messages.
        text: Its content.
    """

    name: str
    text: str

    def rows(
        self, parse: Callable[[Any], dict[str, Any]], what: str, check: Callable[[], None]
    ) -> dict[str, Any]:
        """The file's rows, parsed.

        Args:
            parse: Makes of a line's value what the page is told.
            what: The lines hold, for messages.
            check: Called before each line; may raise to stop.

        Raises:
            InputError: A line is invalid, or there are more than `MAX_ROWS`.
        """

        def parsed(value: Any) -> dict[str, Any]:
            check()
            return parse(value)

        content = BytesIO(self.text.encode("utf-8", "surrogatepass"))
        rows = parse_lines(content, self.name, parsed, what)
        if len(rows) > MAX_ROWS:
            raise InputError(
                f"has {len(rows)} lines; the studio opens at most {MAX_ROWS}", file=self.name
            )
        return {"rows": rows}


T = TypeVar("T")


@dataclass(frozen=True)
class AbstractWrite:
    """A file is asked for.

    Attributes:
        kind: A key of the task's exports.
    """

    kind: str

    def of(self, exports: Mapping[str, T]) -> T:
        """The export of this kind.

        Raises:
            InputError: There is none.
        """
        return exports[expect_choice(self.kind, "kind", exports)]


class Export(NamedTuple):
    """A file, made in memory.

    Attributes:
        name: Suggested to the user.
        type: Its media type.
        content: What it holds.
    """

    name: str
    type: str
    content: bytes

    def to_json(self) -> dict[str, Any]:
        """The file as a page is sent it: its content in base64."""
        content = base64.b64encode(self.content).decode()
        return {"name": self.name, "type": self.type, "content": content}


def command(
    task: str, condition: Any, seed: int, options: Mapping[str, int | float | None], out: str
) -> str:
    """The command that makes a result, for a POSIX shell.

    Args:
        task: Its name on the command line.
        condition: As in a file.
        seed: As of the command.
        options: Further options by their names without dashes; those with None are left out.
        out: Name of the file that the command writes.
    """
    given = "".join(f" --{name} {value!r}" for name, value in options.items() if value is not None)
    return (
        f"echo {shlex.quote(json.dumps(condition))} > condition.jsonl\n"
        f"deggflow {task} generate --conditions condition.jsonl --seed {seed}{given} --out {out}"
    )
