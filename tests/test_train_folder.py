"""Folders of training runs: another run, a file that is damaged or missing, and a second run at the same time are refused."""

import json
import shutil
from functools import partial

import equinox as eqx
import jax
import numpy as np
import pytest
from small_training import Number, dataset, layers, number, shorter, target, train_number

from deggflow.jsonl import InputError
from deggflow.train import Curve, checkpoints, read_curves, run_segments, train

IDENTITY = {"identity": {"size": {"width": 8}, "sizes": (4, 5)}}


@pytest.fixture(scope="module")
def begun(tmp_path_factory):
    """A folder with a finished run."""
    folder = tmp_path_factory.mktemp("train") / "run"
    train_number(folder, 10, **IDENTITY)
    return folder


def other_loss(field, tau, x0, x1, condition, mask):
    return field.weight


def flip(key, x1, condition):
    return -x1


@pytest.mark.parametrize(
    ("given", "reason"),
    [
        ({"samples": (9, 4)}, "`training.z` is float32 (9, 3, 2) here, float32 (8, 3, 2) in the"),
        ({"samples": (8, 5)}, "`validation.z` is float32 (5, 3, 2) here, float32 (4, 3, 2) in"),
        ({"field": number([1.0])}, "`field.weight` is float32 (1,) here, float32 () in the run"),
        (
            {"field": number(layers=layers(8))},
            "`field.layers[0].weight` is float32 (8, 3) here, float32 (4, 3) in the run that was",
        ),
        (
            {"field": number(layers=(*layers(4), eqx.nn.Identity()))},
            "`field.layers[1]` is equinox.nn.Identity here, absent in the run",
        ),
        ({"field": number(np.float16(1))}, "`field.weight` is float16 () here, float32 () in"),
        ({"field": number(table=np.arange(1, 3))}, "`field.table` holds other values here than in"),
        ({"field": number(scales=(1.0, 3.0))}, "`field.scales[1]` is 3.0 here, 2.0 in the run"),
        ({"field": number(scales=(1.0,))}, "`field.scales[1]` is absent here, 2.0 in the run"),
        ({"field": number(act=jax.numpy.tanh)}, "`field.act` is jax.numpy.tanh here, jax.silu in"),
        (
            {"loss": other_loss},
            f"`loss` is {__name__}.other_loss here, {target.__module__}.target in the",
        ),
        (
            {"loss": partial(target, aim=3.0)},
            f"`loss` is functools.partial here, {target.__module__}.t",
        ),
        ({"augment": flip}, f"`augment` is {__name__}.flip here, None in the run"),
        ({"config": shorter(10, batch=5)}, "`batch` is 5 here, 4 in the run that was begun in"),
        ({"config": shorter(10, seed=1)}, "`seed` is 1 here, 0 in the run that was begun in this"),
        ({"identity": {"size": {"width": 9}, "sizes": (4, 5)}}, "`size.width` is 9 here, 8 in the"),
        ({"identity": {"size": {"width": 8}, "sizes": (4,)}}, "`sizes` is [4] here, [4, 5] in the"),
        ({"identity": {"sizes": (4, 5)}}, "`size.width` is absent here, 8 in the run"),
    ],
)
def test_what_differs_from_the_run_in_a_folder_is_refused_by_name(begun, given, reason):
    before = (begun / "config.json").read_text()
    with pytest.raises(InputError) as caught:
        train_number(begun, 10, **{**IDENTITY, **given})
    assert str(caught.value).startswith(f"{begun / 'config.json'}: {reason}")
    assert (begun / "config.json").read_text() == before


def test_what_is_the_same_is_taken_and_initial_weights_do_not_count(begun):
    field, _ = train_number(begun, 10, **IDENTITY)
    other, _ = train_number(begun, 10, field=number(7.0), **IDENTITY)
    assert float(field.weight) == float(other.weight)


def test_data_of_the_same_shapes_are_told_apart_by_content(begun):
    data = dataset(0, 8)
    data.z[3, 1, 0] = np.nextafter(data.z[3, 1, 0], np.float32(2))
    with pytest.raises(InputError, match=r"`training\.z` holds other values here than in the run"):
        train(
            number(),
            data,
            dataset(1, 4),
            shorter(10),
            begun,
            loss=target,
            **IDENTITY,
        )


def test_functions_are_named_alike_in_every_process(begun):
    """Neither addresses in memory nor private modules, which move between releases."""
    field = json.loads((begun / "config.json").read_text())["field"]
    assert field["field"] == f"{Number.__module__}.Number"
    assert field["field.act"] == "jax.silu"
    assert field["field.leaky"] == "functools.partial"
    assert field["field.leaky.func"] == "jax.leaky_relu"
    assert field["field.leaky.keywords['negative_slope']"] == "0.2"


OLD = {"steps": 40, "batch": 4, "average": 0.9, "validate_every": 10}


@pytest.mark.parametrize(
    ("content", "reason"),
    [
        (b"", "not JSON"),
        (b'{"version": 3, "segm', "not JSON"),
        (b"\xff\xfe{}", "not UTF-8"),
        (b"[" * 100_000, "nested too deeply"),
        (b"[]", "must be a JSON object; got []"),
        (b"5", "must be a JSON object; got 5"),
        (b"null", "must be a JSON object; got null"),
        (b"{}", "field `version`: is missing"),
        (b'{"name": "package"}', "field `version`: is missing"),
        (json.dumps(OLD).encode(), "was begun by an older version of deggflow"),
        (b'{"version": 2}', "field `version`: must be 3; got 2: another version"),
        (b'{"version": 3}', "field `segments`: is missing"),
        (("segments", 40), "field `segments`: must be a list; got 40"),
        (("segments", []), "field `segments`: must not be empty"),
        (("segments", [10, 10]), "field `segments[1]`: must lie in [11, "),
        (("segments", [5]), "field `segments`: ends at 5, but there is a checkpoint of step 10"),
        (("data", None), "field `data`: must be a JSON object; got null"),
        (("field", {}), f"`field` is {Number.__module__}.Number here, absent in the run"),
        (("extra", 1), "field `extra`: unknown key"),
    ],
)
def test_a_config_that_is_none_is_refused_with_its_reason(begun, content, reason):
    path = begun / "config.json"
    before = path.read_text()
    if isinstance(content, tuple):
        content = json.dumps({**json.loads(before), content[0]: content[1]}).encode()
    path.write_bytes(content)
    try:
        with pytest.raises(InputError) as caught:
            train_number(begun, 10, **IDENTITY)
        assert str(caught.value).startswith(str(path))
        assert reason in str(caught.value)
        assert path.read_bytes() == content
    finally:
        path.write_text(before)


@pytest.mark.parametrize("when", ["before", "after"])
def test_a_run_whose_folder_is_removed_stops_and_can_begin_anew(tmp_path, monkeypatch, when):
    """Removed between two checkpoints, or in the middle of writing one."""
    folder, whole = tmp_path / "run", tmp_path / "whole"
    trained = train_number(whole, 30, **IDENTITY)[0]

    def gone(curve):
        if when == "before" and curve.step == 10:
            shutil.rmtree(folder)

    save = checkpoints.save

    def saved(place, step, *rest):
        if when == "after" and step == 20:
            shutil.rmtree(folder)
        save(place, step, *rest)

    monkeypatch.setattr(checkpoints, "save", saved)
    with pytest.raises(
        InputError, match=r"run/config\.json: was removed or replaced while the run was writing"
    ):
        train_number(folder, 30, on_progress=gone, **IDENTITY)
    monkeypatch.setattr(checkpoints, "save", save)
    again = train_number(folder, 30, **IDENTITY)[0]
    assert again.weight == trained.weight


def test_a_second_run_in_a_folder_is_refused_while_the_first_one_trains(tmp_path):
    refusals = []

    def again(curve):
        with pytest.raises(InputError, match=r"run/config\.json: another run is writing it"):
            train_number(tmp_path / "run")
        refusals.append(curve.step)

    train_number(tmp_path / "run", on_progress=again)
    assert refusals == [10, 20, 30, 40]
    train_number(tmp_path / "run")  # it is free again


@pytest.mark.parametrize("step", [10, 30])
def test_a_run_stops_where_another_one_took_its_folder(tmp_path, step):
    """The folder was removed and a second run, which could not see the first, began in its place."""
    folder = tmp_path / "run"

    def usurped(curve):
        if curve.step == step:
            shutil.rmtree(folder)
            train_number(folder)

    with pytest.raises(InputError, match="was removed or replaced while"):
        train_number(folder, on_progress=usurped)
    assert [curve.step for curve in train_number(folder)[1]] == [10, 20, 30, 40]


def test_checkpoints_without_their_config_are_refused(begun):
    path = begun / "config.json"
    before = path.read_text()
    path.unlink()
    try:
        with pytest.raises(InputError, match=r"config\.json: does not exist, and there are check"):
            train_number(begun, 10)
        with pytest.raises(InputError, match=r"config\.json: does not exist: no run was begun"):
            run_segments(begun)
    finally:
        path.write_text(before)


HEADER = "step,training,validation\n"


@pytest.mark.parametrize(
    ("content", "reason"),
    [
        (
            b"",
            "line 1: is not a file of training curves: its header must be step,training,validation; got ''",
        ),
        (b"step,training\n1,2\n", "line 1: is not a file of training curves"),
        (b"[]", "line 1: is not a file of training curves"),
        (b"\xff\xfe", "is not a file of training curves: not UTF-8 text"),
        ((HEADER + "10,1.0,2.").encode(), "line 2: must end with a line break"),
        ((HEADER + "10,1.0\n").encode(), "line 2: must be a whole number and two numbers"),
        ((HEADER + "10,1.0,2.0\n1e1,1,2\n").encode(), "line 3: must be a whole number and two"),
        ((HEADER + "10,1.0,2.0\n\n").encode(), "line 3: must be a whole number and two numbers"),
        ((HEADER + "10,1,2\n10,1,2\n").encode(), "line 3: `step` must grow from line to line"),
    ],
)
def test_curves_that_are_none_are_refused_with_line_and_reason(tmp_path, begun, content, reason):
    path = tmp_path / "curves.csv"
    path.write_bytes(content)
    with pytest.raises(InputError) as caught:
        read_curves(path)
    assert str(caught.value).startswith(str(path))
    assert reason in str(caught.value)


def test_curves_are_read_as_they_were_written(tmp_path):
    path = tmp_path / "curves.csv"
    assert read_curves(str(path)) == []
    path.write_text(HEADER)
    assert read_curves(str(path)) == []
    path.write_text(HEADER + "10,0.1,inf\r\n20,3e-05,nan\n")
    first, second = read_curves(str(path))
    assert first == Curve(10, 0.1, float("inf"))
    assert second[:2] == (20, 3e-05)
    with pytest.raises(InputError, match="can't be read"):
        read_curves(tmp_path)


@pytest.mark.parametrize("content", [None, HEADER, HEADER + "500,1.0,2.0\n", "text"])
def test_a_run_is_not_continued_without_its_curves(tmp_path, begun, content):
    folder = shutil.copytree(begun, tmp_path / "copy")
    if content is None:
        (folder / "curves.csv").unlink()
    else:
        (folder / "curves.csv").write_text(content)
    with pytest.raises(InputError, match=r"curves\.csv"):
        train_number(folder, 20, **IDENTITY)
    assert run_segments(folder) == [10]


@pytest.mark.parametrize("how", ["cut", "empty", "a bit", "another run's", "another step's"])
def test_a_damaged_or_foreign_checkpoint_is_named(tmp_path, begun, how):
    folder = shutil.copytree(begun, tmp_path / "copy")
    path = folder / "checkpoints/10.safetensors"
    whole = path.read_bytes()
    if how == "another run's":
        train_number(tmp_path / "other", 10, identity={"of": "another"})
        shutil.copy(tmp_path / "other/checkpoints/10.safetensors", path)
    elif how == "another step's":
        train_number(folder, 20, **IDENTITY)
        path = folder / "checkpoints/20.safetensors"
        shutil.copy(folder / "checkpoints/10.safetensors", path)
    else:
        kinds = {"cut": whole[:-5], "empty": b"", "a bit": whole[:-1] + bytes([whole[-1] ^ 1])}
        path.write_bytes(kinds[how])
    reason = "belongs to something else" if how.startswith("another") else "damaged|no safetensors"
    with pytest.raises(
        InputError, match=rf"{path}: .*({reason}).*; remove it to resume from"
    ) as caught:
        train_number(folder, 20, **IDENTITY)
    assert caught.value.file == path
    path.unlink()
    if how == "another step's":  # what advice it gives works
        assert train_number(folder, 20, **IDENTITY)[1][-1].step == 20
