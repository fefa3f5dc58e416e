"""What the suite finds: rows, the table they are printed in, and the file they are written to."""

import json
import statistics
from collections.abc import Mapping, Sequence
from dataclasses import asdict, dataclass, field
from pathlib import Path
from typing import Any

from deggflow.files import write_atomically

Times = Mapping[str, Sequence[float]]
"""Seconds of each way, round by round; all ways have the same rounds."""


@dataclass(frozen=True)
class Way:
    """One of the things that are compared: what it is, and against which other its ratio is taken."""

    what: str
    samples: int = 1  # that one call makes
    reference: str | None = None
    note: str = ""


@dataclass(frozen=True)
class Spread:
    """A ratio, round by round, in three numbers."""

    median: float
    least: float
    most: float


@dataclass(frozen=True)
class Row:
    """One line of the table."""

    name: str
    what: str
    ms: float | None = None  # median of a call; None where nothing was timed
    samples: int = 1
    reference: str | None = None  # name of the row that the ratio is taken to
    ratio: Spread | None = None
    note: str = ""
    figures: Mapping[str, float] = field(default_factory=dict)  # what isn't a time, by name

    @property
    def per_sample(self) -> float | None:
        """Milliseconds of one sample."""
        return None if self.ms is None else self.ms / self.samples


def spread(seconds: Sequence[float], reference: Sequence[float], share: float = 1.0) -> Spread:
    """Ratio of two ways in each round, times `share`: a round's noise hits both alike."""
    ratios = [share * a / b for a, b in zip(seconds, reference, strict=True)]
    return Spread(statistics.median(ratios), min(ratios), max(ratios))


def rows_of(
    ways: Mapping[str, Way],
    times: Times,
    figures: Mapping[str, Mapping[str, float]] | None = None,
) -> list[Row]:
    """A row of each way; ratios are of a sample's time where the two ways make different numbers of them."""
    rows = []
    for name, way in ways.items():
        ratio = None
        if way.reference is not None:
            share = ways[way.reference].samples / way.samples
            ratio = spread(times[name], times[way.reference], share)
        ms = 1000 * statistics.median(times[name])
        more = (figures or {}).get(name, {})
        rows.append(Row(name, way.what, ms, way.samples, way.reference, ratio, way.note, more))
    return rows


def number(value: float | None) -> str:
    """Three digits that matter, or nothing."""
    if value is None:
        return ""
    return f"{value:.0f}" if abs(value) >= 100 else f"{value:.3g}"


def told(row: Row) -> str:
    """Figures and note of a row in words."""
    said = [f"{name} {number(value)}" for name, value in row.figures.items()]
    return "; ".join([*said, row.note] if row.note else said)


HEADINGS = ("name", "what", "median ms", "per sample", "ratio", "min", "max", "")


def table(rows: Sequence[Row]) -> str:
    """All rows as text, in columns; numbers to the right."""
    lines: list[tuple[str, ...]] = [HEADINGS]
    for row in rows:
        r = row.ratio
        ratios = ("",) * 3 if r is None else tuple(map(number, (r.median, r.least, r.most)))
        lines.append(
            (row.name, row.what, number(row.ms), number(row.per_sample), *ratios, told(row))
        )
    widths = [max(len(line[k]) for line in lines) for k in range(len(HEADINGS))]
    return "\n".join(
        "  ".join(
            text.rjust(width) if 2 <= k < 7 else text.ljust(width)
            for k, (text, width) in enumerate(zip(line, widths, strict=True))
        ).rstrip()
        for line in lines
    )


def write(path: Path, about: Mapping[str, Any], rows: Sequence[Row]) -> None:
    """Everything as JSON, all of it or nothing."""
    found = [{**asdict(row), "per_sample": row.per_sample} for row in rows]
    write_atomically(path, json.dumps({**about, "rows": found}, indent=2) + "\n")
