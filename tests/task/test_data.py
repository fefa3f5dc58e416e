"""Demonstrations on disk, whatever the task: resumed by chunk, refused by name, and there when the call returns."""

import json
from dataclasses import dataclass

import pytest

from deggflow.jsonl import InputError
from deggflow.merging import merge_shards
from deggflow.shards import Shard
from deggflow.task import AbstractModel, Recipe, write_data


@dataclass(frozen=True)
class Lines(Recipe):
    training: int = 7
    validation: int = 3
    sizes: tuple[int, ...] = (2, 5)


class LineModel(AbstractModel):
    """A demonstration remembers in which chunk it was made."""

    task, noun, sizes, chunk, loss_text = "lines", "lines", (1, 8), 3, ""
    on_chunk = staticmethod(lambda: None)

    def demonstrate(self, size, first, count, recipe, seed):
        self.on_chunk()
        return [
            {"size": size, "number": first + k, "chunk": [first, count], "seed": seed}
            for k in range(count)
        ]

    def describe(self, folder):
        return ()

    def load_data(self, training, validation, scratch=None):
        raise AssertionError

    def build(self, key, data, architecture):
        raise AssertionError

    def load(self, path=None):
        raise AssertionError


def rows(folder, name):
    return [json.loads(line) for line in (folder / f"{name}.jsonl").read_text().splitlines()]


def test_every_size_has_chunks_of_its_own(tmp_path):
    told = []
    write_data(LineModel(), tmp_path, Lines(seed=4), lambda done, total: told.append((done, total)))
    assert [(r["size"], r["number"], r["chunk"]) for r in rows(tmp_path, "training")] == [
        (size, number, [number // 3 * 3, min(3, 7 - number // 3 * 3)])
        for size in (2, 5)
        for number in range(7)
    ]
    assert {r["seed"] for r in rows(tmp_path, "training")} == {8}
    assert {r["seed"] for r in rows(tmp_path, "validation")} == {9}
    assert told[-1] == (20, 20)
    assert [done for done, _ in told] == sorted(done for done, _ in told)


def test_cut_anywhere_it_is_completed_to_the_same_bytes(tmp_path):
    whole, cut = tmp_path / "whole", tmp_path / "cut"
    write_data(LineModel(), whole, Lines())
    content = (whole / "training.jsonl").read_bytes()
    for size in range(0, len(content) + 1, 37):
        write_data(LineModel(), cut, Lines())
        (cut / "training.jsonl").write_bytes(content[:size])
        (cut / "validation.jsonl").unlink()
        write_data(LineModel(), cut, Lines())
        for name in ("training.jsonl", "validation.jsonl"):
            assert (cut / name).read_bytes() == (whole / name).read_bytes()


@pytest.mark.parametrize("chunk", range(8))
def test_a_file_that_is_removed_meanwhile_is_missed(tmp_path, chunk):
    """Also the first file while the second is written."""
    model, begun = LineModel(), []

    def remove():
        begun.append(1)
        if len(begun) == chunk + 1:
            (tmp_path / "training.jsonl").unlink()

    model.on_chunk = remove
    with pytest.raises(InputError, match=r"training\.jsonl: was removed while"):
        write_data(model, tmp_path, Lines())
    model.on_chunk = lambda: None
    write_data(model, tmp_path, Lines())
    assert len(rows(tmp_path, "training")) == 14


@pytest.mark.parametrize(
    ("recipe", "hint"),
    [
        ({"training": 0}, "--training must lie in"),
        ({"validation": 2_000_000}, "--validation must lie in"),
        ({"seed": -1}, "--seed must lie in"),
        ({"sizes": ()}, "--sizes must be one size or several different ones"),
        ({"sizes": (3, 3)}, "--sizes must be one size or several different ones"),
        ({"sizes": (2, 9)}, "--sizes must lie in"),
    ],
)
def test_bad_recipes_are_refused_by_the_name_of_their_option(tmp_path, recipe, hint):
    with pytest.raises(InputError, match=hint):
        write_data(LineModel(), tmp_path / "new", Lines(**recipe))
    assert not (tmp_path / "new").exists()


@pytest.mark.parametrize("of", [1, 2, 4, 9])
def test_shards_make_the_same_files_together(of, tmp_path):
    write_data(LineModel(), tmp_path / "whole", Lines())
    folders = [tmp_path / str(k) for k in range(1, of + 1)]
    for k, folder in enumerate(folders, start=1):
        write_data(LineModel(), folder, Lines(), shard=Shard(k, of))
        with (folder / "training.jsonl").open("ab") as file:
            file.truncate((folder / "training.jsonl").stat().st_size // 2)
        write_data(LineModel(), folder, Lines(), shard=Shard(k, of))
    for name in ("training.jsonl", "validation.jsonl"):
        merge_shards([folder / name for folder in folders], tmp_path / name)
        for file in (name, f"{name}.run.json"):
            assert (tmp_path / file).read_bytes() == (tmp_path / "whole" / file).read_bytes()
