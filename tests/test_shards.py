"""Shards of a run: together the bytes of the whole run; merged only if nothing is missing, double or changed."""

import json
import shutil
from contextlib import suppress

import pytest

from deggflow.app.runs import ConditionSource, generate_results, run_jobs, write_results
from deggflow.jsonl import InputError
from deggflow.merging import merge_shards
from deggflow.output import ResumableOutput
from deggflow.shards import Part, Shard
from deggflow.task import AbstractGenerator, Chunking, GenerateOptions

CHUNK, COUNT = 4, 18


class Number(int):
    """A condition, and its result."""

    def to_json(self):
        return {"is": int(self)}


class Row:
    """A result remembers its batch, as batches of other sizes round differently."""

    def __init__(self, number, batch):
        self.number, self.batch = number, batch

    def to_json(self):
        return {"condition": {"is": self.number}, "batch": self.batch}


class Rows(AbstractGenerator):
    def chunking(self, condition):
        return Chunking(CHUNK)

    def generate(self, conditions, run, on_status):
        batch = [run.first, len(conditions), run.seed]
        assert conditions[0] == run.first
        yield [Row(int(number), batch) for number in conditions]


def generate(path, shard=None, seed=0, stop=None):
    """A run, or one shard of it, as the command does it; ended after `stop` results."""
    whole = ConditionSource(COUNT, 0, lambda first, many: [Number(first + k) for k in range(many)])
    settings = {"command": "numbers generate", "seed": seed, "count": COUNT}
    source = whole
    if shard is not None:
        part = Shard.parse(shard).equal_part(COUNT, CHUNK)
        source, settings = whole.of_part(part), settings | Shard.parse(shard).settings(part)
    options = GenerateOptions(seed=seed)

    def chunks(first, bars):
        for number, some in enumerate(generate_results(Rows(), source, options, first, bars)):
            if number == stop:
                raise KeyboardInterrupt
            yield some

    write_results(path, settings, source, "rows", lambda row: False, chunks)


@pytest.mark.parametrize("of", [1, 2, 3, 5, 8])
def test_shards_together_are_the_bytes_of_one_run(of, tmp_path):
    """More shards than chunks too; whether interrupted or not; with the settings of the whole run."""
    generate(tmp_path / "whole.jsonl")
    files = [tmp_path / f"{k}.jsonl" for k in range(1, of + 1)]
    for k, file in enumerate(files, start=1):
        if k % 2:
            with suppress(KeyboardInterrupt):  # a shard of one chunk ends before it is interrupted
                generate(file, f"{k}/{of}", stop=1)
            with file.open("ab") as cut:
                cut.truncate(max(0, file.stat().st_size - 5))
        generate(file, f"{k}/{of}")
    assert merge_shards(files[::-1], tmp_path / "merged.jsonl") == COUNT
    for name in ("", ".run.json"):
        one, other = ((tmp_path / f"{each}.jsonl{name}") for each in ("whole", "merged"))
        assert one.read_bytes() == other.read_bytes()


def test_parts_are_whole_chunks_and_as_equal_as_these_allow():
    for count in (1, 3, 4, 5, 16, 18):
        for of in range(1, 9):
            parts = [Shard(k, of).equal_part(count, CHUNK) for k in range(1, of + 1)]
            assert parts == [
                Shard(k, of).part([min(CHUNK, count - j) for j in range(0, count, CHUNK)])
                for k in range(1, of + 1)
            ]
            assert sum(part.lines for part in parts) == count
            assert all(part.first % CHUNK == 0 or not part.lines for part in parts)
            assert max(p.lines for p in parts) - min(p.lines for p in parts) <= 2 * CHUNK - 1


@pytest.fixture(scope="module")
def shards(tmp_path_factory):
    """A folder with three shards of a run."""
    folder = tmp_path_factory.mktemp("shards")
    for k in (1, 2, 3):
        generate(folder / f"{k}.jsonl", f"{k}/3")
    return folder


def swap_lines(path):
    first, second, *rest = path.read_bytes().splitlines(keepends=True)
    path.write_bytes(b"".join([second, first, *rest]))


def edit(path, **settings):
    place = path.with_name(path.name + ".run.json")
    place.write_text(json.dumps(json.loads(place.read_text()) | settings))


DAMAGE = {
    "missing": (lambda path: path.unlink(), "2.jsonl"),
    "of another seed": (
        lambda path: (path.unlink(), generate(path, "2/3", seed=1)),
        "is of another run than .*1.jsonl: seed = 1, not 0",
    ),
    "of another number of shards": (
        lambda path: (path.unlink(), generate(path, "2/4")),
        "is of another run than .*: shards = 4, not 3",
    ),
    "double": (
        lambda path: (path.unlink(), generate(path, "1/3")),
        "holds shard 1/3, as .*2.jsonl does",
    ),
    "of no shard": (lambda path: (path.unlink(), generate(path)), "is no shard"),
    "of damaged settings": (lambda path: edit(path, part={}), "field `part.first`: is missing"),
    "of other lines": (lambda path: edit(path, part=Part(8, 8, 18)._asdict()), "begins with line"),
    "shortened": (lambda path: path.write_bytes(path.read_bytes()[:-9]), "was changed after"),
    "in another order": (swap_lines, "its digest does not match"),
    "without settings": (
        lambda path: path.with_name(path.name + ".run.json").unlink(),
        "its settings are missing",
    ),
}


@pytest.mark.parametrize("kind", DAMAGE)
def test_what_is_not_the_whole_run_is_refused_and_nothing_written(kind, shards, tmp_path):
    folder = tmp_path / "copy"
    shutil.copytree(shards, folder)
    change, reason = DAMAGE[kind]
    change(folder / "2.jsonl")
    with pytest.raises((InputError, OSError), match=reason):
        merge_shards([folder / f"{k}.jsonl" for k in (3, 2, 1)], tmp_path / "merged.jsonl")
    assert [path.name for path in tmp_path.iterdir()] == ["copy"]


def test_a_missing_shard_is_named_and_an_unfinished_one_too(shards, tmp_path):
    out = tmp_path / "merged.jsonl"
    with pytest.raises(InputError, match="2 of 3 shards are missing: 1, 3"):
        merge_shards([shards / "2.jsonl"], out)
    with pytest.raises(KeyboardInterrupt):
        generate(tmp_path / "1.jsonl", "1/3", stop=0)
    with pytest.raises(InputError, match="is not finished; rerun its command"):
        merge_shards([tmp_path / "1.jsonl", shards / "2.jsonl", shards / "3.jsonl"], out)
    out.write_text("mine")
    with pytest.raises(InputError, match="exists; choose another --out"):
        merge_shards([shards / f"{k}.jsonl" for k in (1, 2, 3)], out)


def test_a_whole_run_does_not_continue_a_shard(shards, tmp_path):
    for name in ("1.jsonl", "1.jsonl.run.json"):
        shutil.copy(shards / name, tmp_path / name)
    for shard, hint in ((None, "shard = 1/3, not null"), ("1/2", "shard = 1/3, not 1/2")):
        with pytest.raises(InputError, match=hint):
            generate(tmp_path / "1.jsonl", shard)


def test_rows_of_an_evaluation_are_shared_out(tmp_path):
    jobs = [lambda k=k: Row(k, []) for k in range(5)]
    for k in (1, 2):
        rows = run_jobs(jobs, Row, {"seed": 0}, tmp_path / f"{k}.jsonl", Shard(k, 2))
        assert [row.number for row in rows] == [[0, 1], [2, 3, 4]][k - 1]
    merged = tmp_path / "merged.jsonl"
    assert merge_shards([tmp_path / "2.jsonl", tmp_path / "1.jsonl"], merged) == 5
    with ResumableOutput(merged, {"seed": 0}, count=5) as lines:
        assert [row["condition"]["is"] for row in lines.finished] == list(range(5))


@pytest.mark.parametrize("text", ["0/3", "4/3", "1", "1/0", "-1/3", "1/3/5", "a/b", "1/9999999"])
def test_shards_that_do_not_exist_are_refused(text):
    with pytest.raises(InputError, match="--shard must be k/n"):
        Shard.parse(text)
