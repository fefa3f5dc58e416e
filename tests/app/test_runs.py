"""Conditions and results of long runs: in order, completed in whole chunks, counted."""

import json
from dataclasses import asdict, dataclass

import pytest

from deggflow.app import runs
from deggflow.app.runs import ConditionSource, run_jobs, wanted, write_results
from deggflow.jsonl import InputError
from deggflow.output import ResumableOutput


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


def make(conditions, first):
    """A result remembers in which chunk it was made, as batches of other sizes round differently."""
    assert conditions == list(range(first, first + len(conditions)))
    return [Row(number, first) for number in conditions]


def odd(row):
    return row["number"] % 2 == 1


def numbers(first, many):
    return [Number(k) for k in range(first, first + many)]


@pytest.fixture
def ten(monkeypatch):
    monkeypatch.setattr(runs, "CHUNK", 4)
    return ConditionSource(10, 0, numbers)


def test_a_chunk_that_was_cut_is_made_again_whole_and_its_rest_is_kept(ten, tmp_path, capsys):
    whole, cut = tmp_path / "whole.jsonl", tmp_path / "cut.jsonl"

    def run(path):
        return write_results(path, {}, ten, "rows", odd, lambda first, _: ten.chunks(make, first))

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
def test_chunks_begun_ahead_come_in_order(ten, count):
    wanted = ConditionSource(count, 0, ten.part)
    for first in range(count + 1):
        ahead = [row for rows in wanted.chunks(make, first, ahead=True) for row in rows]
        assert ahead == [row for rows in wanted.chunks(make, first) for row in rows]
        assert [row.number for row in ahead] == list(range(first, count))


def test_an_error_in_a_chunk_begun_ahead_ends_the_run(ten):
    def fail(conditions, first):
        if first == 8:
            raise ValueError("chunk 8")
        return make(conditions, first)

    chunks = ten.chunks(fail, 0, ahead=True)
    assert [row.number for row in next(chunks) + next(chunks)] == list(range(8))
    with pytest.raises(ValueError, match="chunk 8"):
        next(chunks)


def test_conditions_come_from_a_file_or_are_drawn(tmp_path):
    ways = {
        "sizes": (2, 8),
        "read": lambda path: numbers(7, 3),
        "draw": lambda size, first, many: [(size, k) for k in range(first, first + many)],
    }
    given = wanted(tmp_path, None, None, **ways)
    assert (given.count, given.size, given.part(1, 2)) == (3, 0, [8, 9])
    drawn = wanted(None, 5, None, **ways)
    assert (drawn.count, drawn.size, drawn.part(0, 1)) == (1, 5, [(5, 0)])
    for arguments, hint in (
        ((None, None, None), "either"),
        ((tmp_path, 4, None), "either"),
        ((tmp_path, None, 4), "--count"),
        ((None, 9, None), "--size must lie in"),
        ((None, 4, 0), "--count must lie in"),
    ):
        with pytest.raises(InputError, match=hint):
            wanted(*arguments, **ways)


@dataclass
class Count:
    number: int

    def to_json(self):
        return asdict(self)


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
