"""Training scenes: valid by an independent check, written so that a kill loses nothing, read back as they are."""

import json
import math
from dataclasses import replace

import numpy as np
import pytest

from deggflow.jsonl import InputError
from deggflow.task import write_data
from deggflow.tasks.tabletop.data import load_dataset, make_scenes
from deggflow.tasks.tabletop.formats import read_scenes
from deggflow.tasks.tabletop.model import TabletopModel
from deggflow.tasks.tabletop.options import SceneRecipe
from deggflow.tasks.tabletop.oracle import least_margin

MODEL = TabletopModel()
SIZES, COUNT = (5, 6), 17
# So many of a size that what a kill leaves to be made fits into a smaller compiled batch than the whole.
RECIPE = SceneRecipe(sizes=SIZES, training=COUNT, validation=COUNT)
PARTS = ("training", "validation")


@pytest.fixture(scope="module")
def folder(tmp_path_factory):
    path = tmp_path_factory.mktemp("data")
    write_data(MODEL, path, RECIPE)
    return path


def test_as_many_scenes_of_each_size_as_asked_for(folder):
    for name in PARTS:
        sizes = [len(scene.condition.objects) for scene in read_scenes(folder / f"{name}.jsonl")]
        assert sizes == [size for size in SIZES for _ in range(COUNT)]


def test_scenes_hold_with_room_to_spare(folder):
    """The default requirements, by Shapely; the certificate says by how much."""
    for name in PARTS:
        for scene in read_scenes(folder / f"{name}.jsonl"):
            assert scene.condition.requirements == {}
            margin = least_margin(scene.condition, scene.poses)
            assert margin >= RECIPE.spare - 1e-9
            assert scene.certificate.satisfied
            assert scene.certificate.min_margin == pytest.approx(margin, abs=1e-9)
            assert np.all(np.abs(scene.poses[:, 2]) <= math.pi + 1e-6)


def test_a_scene_without_enough_room_is_drawn_again():
    """Where more room is asked for than the relaxation aims at, until an arrangement happens to have it."""
    greedy = replace(RECIPE, spare=RECIPE.clearance + 0.02)
    scenes = [make_scenes(1, number, 1, greedy, 0)[0] for number in range(6)]
    assert all(least_margin(s.condition, s.poses) >= greedy.spare - 1e-9 for s in scenes)
    assert max(s.certificate.draws for s in scenes) > 1


def test_training_and_validation_differ(folder):
    training, validation = (
        {json.dumps(scene.to_json()["objects"]) for scene in read_scenes(folder / f"{name}.jsonl")}
        for name in PARTS
    )
    assert len(training | validation) == 4 * COUNT


@pytest.mark.parametrize("finished", [8, COUNT, COUNT + 9])
def test_a_killed_file_is_completed_to_the_same_bytes(folder, tmp_path, finished):
    """Cut in the middle of the line after the finished ones."""
    for path in folder.iterdir():
        (tmp_path / path.name).write_bytes(path.read_bytes())
    whole = (folder / "training.jsonl").read_bytes()
    lines = whole.splitlines(keepends=True)
    started = b"".join(lines[:finished]) + lines[finished][:100]
    (tmp_path / "training.jsonl").write_bytes(started)
    write_data(MODEL, tmp_path, RECIPE)
    assert (tmp_path / "training.jsonl").read_bytes() == whole


def test_a_finished_folder_is_left_as_it_is(folder):
    before = {path.name: path.read_bytes() for path in folder.iterdir()}
    told = []
    write_data(MODEL, folder, RECIPE, lambda done, total: told.append((done, total)))
    assert {path.name: path.read_bytes() for path in folder.iterdir()} == before
    assert told[-1] == (4 * COUNT, 4 * COUNT)


def test_another_recipe_is_not_mixed_in(folder):
    before = (folder / "training.jsonl").read_bytes()
    with pytest.raises(InputError, match="seed"):
        write_data(MODEL, folder, replace(RECIPE, seed=1))
    assert (folder / "training.jsonl").read_bytes() == before


def test_a_scene_depends_on_its_own_number(folder):
    """Up to rounding, whatever it is made together with."""
    whole = [s for s in read_scenes(folder / "training.jsonl") if len(s.poses) == SIZES[1]]
    for alone, together in zip(make_scenes(SIZES[1], 3, COUNT, RECIPE, 0), whole[3:], strict=False):
        assert alone.condition == together.condition
        np.testing.assert_allclose(alone.poses, together.poses, atol=1e-4)


def test_dataset_decodes_to_the_scenes(folder):
    """z = diag(0.70, 0.47, 1.35)^-1 [p, theta] for the objects that are there (paper, App. Task 2)."""
    scenes, dataset = (
        read_scenes(folder / "training.jsonl"),
        load_dataset(folder / "training.jsonl"),
    )
    assert dataset.z.shape == (2 * COUNT, 6, 3)
    np.testing.assert_array_equal(dataset.mask.sum(axis=1), [len(s.poses) for s in scenes])
    scale = np.array([[0.70, 0.47, 1.35]])
    for z, mask, scene in zip(np.asarray(dataset.z), dataset.mask, scenes, strict=True):
        np.testing.assert_allclose(z[mask] * scale, scene.poses, atol=1e-6)
        assert np.isfinite(z).all()


def test_a_bad_data_file_is_refused(tmp_path):
    path = tmp_path / "training.jsonl"
    path.write_text('{"objects": ["laptop"]}\n')
    with pytest.raises(InputError, match="condition"):
        load_dataset(path)


def test_what_cannot_be_arranged_is_refused(tmp_path):
    impossible = SceneRecipe(sizes=(1,), training=1, validation=1, spare=1.0)
    with pytest.raises(InputError, match="no arrangement of 1 objects"):
        write_data(MODEL, tmp_path, impossible)
