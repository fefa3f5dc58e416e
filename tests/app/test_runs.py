"""Conditions and results of long runs: in order, completed in whole chunks, counted."""

import json
import re
from dataclasses import asdict, dataclass

import pytest

from deggflow.app.runs import (
    ConditionSource,
    condition_source,
    generate_results,
    run_jobs,
    write_results,
)
from deggflow.app.session import progress
from deggflow.jsonl import InputError
from deggflow.output import ResumableOutput
from deggflow.task import AbstractGenerator, AbstractTask, Chunking, GenerateOptions


@dataclass
class Row:
    number: int
    chunk: int

    def to_json(self):
        return {"condition": {"is": self.number}, "number": self.number, "chunk": self.chunk}


class Number(int):
    """A condition."""

    def to_json(self):
        return {"is": int(self)}


class Rows(AbstractGenerator):
    """A result remembers in which chunk it was made, as batches of other sizes round differently."""

    def __init__(self, *, concurrent=False, pieces=2, fails_at=None):
        self.concurrent, self.pieces, self.fails_at = concurrent, pieces, fails_at

    def chunking(self, condition):
        return Chunking(4, self.concurrent)

    def generate(self, conditions, run, on_status):
        first = run.first
        assert conditions == list(range(first, first + len(conditions)))
        if first == self.fails_at:
            raise ValueError(f"chunk {first}")
        for start in range(0, len(conditions), self.pieces):
            yield [Row(number, first) for number in conditions[start : start + self.pieces]]


class Numbers(AbstractTask):
    """Conditions that are numbers: drawn from 0 on, or 7 to 9 in a file."""

    name, noun, sizes = "numbers", "number", (2, 8)

    def random_conditions(self, size, count, first, options):
        return [(size, k) for k in range(first, first + count)]

    def read_conditions(self, path):
        return numbers(7, 3)


Numbers.__abstractmethods__ = frozenset()  # of a task, only its conditions


def chunks(source, generator, first=0):
    with progress(hidden=True) as bars:
        return list(generate_results(generator, source, GenerateOptions(), first, bars))


def odd(row):
    return row["number"] % 2 == 1


def numbers(first, many):
    return [Number(k) for k in range(first, first + many)]


@pytest.fixture
def ten():
    return ConditionSource(10, 0, numbers)


def test_a_chunk_that_was_cut_is_made_again_whole_and_its_rest_is_kept(ten, tmp_path, capsys):
    whole, cut = tmp_path / "whole.jsonl", tmp_path / "cut.jsonl"

    def run(path):
        return write_results(
            path, {}, ten, "rows", odd,
            lambda first, bars: generate_results(Rows(), ten, GenerateOptions(), first, bars),
        )  # fmt: skip

    assert run(whole) == 5
    lines = whole.read_bytes().splitlines(keepends=True)
    assert [json.loads(line)["chunk"] for line in lines] == [0, 0, 0, 0, 4, 4, 4, 4, 8, 8]
    for size in range(0, len(whole.read_bytes()) + 1, 7):  # cut anywhere, also within a line
        cut.write_bytes(b"")
        ResumableOutput(cut, {}).__enter__().__exit__()
        cut.write_bytes(whole.read_bytes()[:size])
        assert run(cut) == 5
        assert cut.read_bytes() == whole.read_bytes()
    assert run(None) == 5
    assert capsys.readouterr().out.encode() == whole.read_bytes()


@pytest.mark.parametrize("count", [1, 4, 5, 9, 10, 30])
@pytest.mark.parametrize("pieces", [1, 3, 4])
def test_chunks_begun_ahead_come_in_order(count, pieces):
    source = ConditionSource(count, 0, numbers)
    for first in range(count):
        ahead = chunks(source, Rows(concurrent=True, pieces=pieces), first)
        assert ahead == chunks(source, Rows(pieces=pieces), first)
        assert [row.number for rows in ahead for row in rows] == list(range(first, count))


def test_an_error_in_a_chunk_begun_ahead_ends_the_run(ten):
    with progress(hidden=True) as bars:
        coming = generate_results(
            Rows(concurrent=True, pieces=4, fails_at=8), ten, GenerateOptions(), 0, bars
        )
        assert [row.number for row in next(coming) + next(coming)] == list(range(8))
        with pytest.raises(ValueError, match="chunk 8"):
            next(coming)


def test_conditions_come_from_a_file_or_are_drawn(tmp_path):
    task = Numbers()
    given = condition_source(task, GenerateOptions(conditions=tmp_path))
    assert (given.count, given.size, given.part(1, 2)) == (3, 0, [8, 9])
    drawn = condition_source(task, GenerateOptions(size=5))
    assert (drawn.count, drawn.size, drawn.part(0, 1)) == (1, 5, [(5, 0)])
    for options, hint in (
        (GenerateOptions(), "either"),
        (GenerateOptions(conditions=tmp_path, size=4), "either"),
        (GenerateOptions(conditions=tmp_path, count=4), "--count"),
        (GenerateOptions(size=9), "--size must lie in"),
        (GenerateOptions(size=4, count=0), "--count must lie in"),
    ):
        with pytest.raises(InputError, match=hint):
            condition_source(task, options)


@dataclass
class Count:
    number: int

    def to_json(self):
        return asdict(self)


def test_without_a_terminal_every_row_is_announced(capsys):
    run_jobs([lambda: Count(0), lambda: Count(1)], Count, {}, None)
    lines = capsys.readouterr().err.splitlines()
    assert [re.sub(r"in \d+ s", "in # s", line) for line in lines] == [
        "evaluated 1 of 2 rows in # s",
        "evaluated 2 of 2 rows in # s",
    ]


def test_jobs_that_are_done_are_not_run_again(tmp_path):
    done = []

    def job(number):
        def run():
            done.append(number)
            if number == 2 and done.count(2) == 1:
                raise KeyboardInterrupt
            return Count(number)

        return run

    jobs, out = [job(number) for number in range(4)], tmp_path / "rows.jsonl"
    with pytest.raises(KeyboardInterrupt):
        run_jobs(jobs, Count, {"seed": 0}, out)
    assert [row.number for row in run_jobs(jobs, Count, {"seed": 0}, out)] == [0, 1, 2, 3]
    assert done == [0, 1, 2, 2, 3]
    assert [row.number for row in run_jobs(jobs, Count, {"seed": 0}, None)] == [0, 1, 2, 3]
    out.write_text(out.read_text().replace('"number": 1', '"number": "1"'))
    before = out.read_bytes()
    with pytest.raises(
        InputError, match="line 2, field `number`: was damaged after it was written"
    ):
        run_jobs(jobs, Count, {"seed": 0}, out)
    assert out.read_bytes() == before
