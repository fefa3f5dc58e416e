"""Shards: one run divided among many machines, each of which writes one part of its lines."""

import re
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any, NamedTuple, TypeVar

from .jsonl import InputError

MOST = 1_000_000  # shards of a run
T = TypeVar("T")
_TEXT = re.compile(r"([0-9]{1,7})/([0-9]{1,7})")


class Part(NamedTuple):
    """The lines of a run that one shard writes.

    Attributes:
        first: Number of its first line in the run, from 0.
        lines: Its number of lines; 0 if there are more shards than chunks.
        total: Number of lines of the whole run.
    """

    first: int
    lines: int
    total: int


@dataclass(frozen=True)
class Shard:
    """One of several equal parts of a run.

    A run consists of chunks, which are computed as a whole, as a batch of another size rounds differently. A shard is a
    sequence of consecutive chunks, so the lines of all shards in order are the bytes of the whole run.

    Attributes:
        number: Number of the shard, from 1.
        of: Number of shards.

    Example:
        >>> from deggflow.shards import Shard
        >>> [Shard(k, 3).part([512, 512, 512, 100]) for k in (1, 2, 3)]
        [Part(first=0, lines=512, total=1636), Part(first=512, lines=512, total=1636), Part(first=1024, lines=612, total=1636)]
    """

    number: int
    of: int

    @classmethod
    def parse(cls, text: str) -> "Shard":
        """The shard that the option --shard names, as "2/8".

        Raises:
            InputError: The text is of another form, or there is no such shard.
        """
        form = _TEXT.fullmatch(text)
        if form is not None and 1 <= int(form[1]) <= int(form[2]) <= MOST:
            return cls(int(form[1]), int(form[2]))
        raise InputError(
            f"--shard must be k/n, shard number k of n, with 1 <= k <= n <= {MOST}; got {text!r}"
        )

    def __str__(self) -> str:
        return f"{self.number}/{self.of}"

    def chunks(self, count: int) -> range:
        """Numbers of the shard's chunks, from 0, of `count` in all."""
        return range((self.number - 1) * count // self.of, self.number * count // self.of)

    def of_chunks(self, chunks: Sequence[T]) -> Sequence[T]:
        """The shard's chunks, of all those of the run."""
        mine = self.chunks(len(chunks))
        return chunks[mine.start : mine.stop]

    def part(self, lines: Sequence[int]) -> Part:
        """The shard's part of a run. Args: lines: the number of lines of each chunk of the run."""
        mine = self.chunks(len(lines))
        return Part(sum(lines[: mine.start]), sum(lines[mine.start : mine.stop]), sum(lines))

    def equal_part(self, count: int, chunk: int) -> Part:
        """The shard's part of a run of `count` lines in chunks of `chunk` lines, of which the last may be shorter."""
        mine = self.chunks(-(-count // chunk))
        first = min(mine.start * chunk, count)
        return Part(first, min(mine.stop * chunk, count) - first, count)

    def settings(self, part: Part) -> dict[str, Any]:
        """JSON values that identify the shard beside its lines."""
        return {"shard": str(self), "part": part._asdict()}


def parse_shard(text: str | None, out: Path | None = Path()) -> Shard | None:
    """The shard that the option --shard names; None without the option.

    Raises:
        InputError: There is no such shard, or `out` is None: rows that are only printed can't be merged.
    """
    if text is None:
        return None
    if out is None:
        raise InputError("--shard goes with --out: `deggflow merge` joins the files of all shards")
    return Shard.parse(text)
