"""Training: averages without bias, runs that are killed and extended, and folders that hold other runs."""

import json
import shutil
import signal
import subprocess
import sys
import time
from dataclasses import replace
from functools import partial
from pathlib import Path

import equinox as eqx
import jax
import numpy as np
import pytest
from safetensors.numpy import load_file

from deggflow.jsonl import InputError
from deggflow.train import (
    Curve,
    Dataset,
    TrainingConfig,
    checkpoints,
    read_curves,
    run_segments,
    train,
)

PROGRAM = """
import sys
from pathlib import Path
sys.path.insert(0, {root!r})
from {module} import run
run(Path(sys.argv[1]), lambda curve: print(curve.step, flush=True))
"""
CONFIG = TrainingConfig(steps=400, batch=16, warmup=20, validate_every=20, average=0.9, seed=3)


class Shift(eqx.Module):
    """A small field for a small problem."""

    network: eqx.nn.MLP

    def __call__(self, tau, z, condition):
        return jax.vmap(lambda row: self.network(jax.numpy.append(row, tau)))(z)


def dataset(seed, samples):
    rng = np.random.default_rng(seed)
    z = (np.array([1.0, -1.0]) + 0.1 * rng.normal(size=(samples, 3, 2))).astype(np.float32)
    return Dataset(z, np.zeros(samples, np.float32), np.ones((samples, 3), bool))


def run(folder, on_progress=lambda curve: None):
    from deggflow.weights import save_weights

    field = Shift(eqx.nn.MLP(3, 2, 32, depth=2, key=jax.random.key(0)))
    trained, curves = train(
        field, dataset(0, 200), dataset(1, 50), CONFIG, folder, on_progress=on_progress
    )
    save_weights(folder / "end.safetensors", trained, {})
    return curves


def layers(width):
    return (eqx.nn.Linear(3, width, key=jax.random.key(0)),)


class Number(eqx.Module):
    """One weight, and whatever else tells fields apart."""

    weight: jax.Array
    table: jax.Array = eqx.field(default_factory=lambda: np.arange(2))
    scales: tuple = eqx.field(static=True, default=(1.0, 2.0))
    act: object = jax.nn.silu
    leaky: object = partial(jax.nn.leaky_relu, negative_slope=0.2)
    layers: tuple = eqx.field(default_factory=lambda: layers(4))

    def __call__(self, tau, z, condition):
        return self.weight * z


def number(value=5.0, **parts):
    return Number(jax.numpy.asarray(value), **parts)


def its_weight(field, tau, x0, x1, condition, mask):
    """A loss of gradient one that tells the weight itself."""
    return field.weight


def target(field, tau, x0, x1, condition, mask, aim=2.0):
    """Settles nowhere, as the noise is drawn anew at each step."""
    return jax.numpy.sum((field.weight - aim - x0) ** 2)


def shorter(steps=40, **settings):
    given = {"batch": 4, "learning_rate": 0.3, "warmup": 5, "average": 0.9, "validate_every": 10}
    return TrainingConfig(steps=steps, **{**given, **settings})


def train_number(folder, steps=40, *, field=None, samples=(8, 4), loss=target, **settings):
    config = settings.pop("config", None) or shorter(steps)
    sets = [dataset(k, count) for k, count in enumerate(samples)]
    return train(field or number(), *sets, config, folder, loss=loss, **settings)


class KilledError(Exception):
    pass


def killed_at(step):
    """Stops a run at a point of its curves, whose checkpoint is written."""

    def on_progress(curve):
        if curve.step == step:
            raise KilledError

    return on_progress


@pytest.mark.parametrize("step", [{"steps": 1234}, {"steps": 0}, {"steps": -500}])
def test_config_refuses_steps_without_a_checkpoint_at_the_end(step):
    with pytest.raises(ValueError, match="`steps` must be a positive multiple"):
        TrainingConfig(**step)


@pytest.mark.parametrize(
    ("name", "value"),
    [
        ("validate_every", 0),
        ("batch", 0),
        ("warmup", -1),
        ("seed", -1),
        ("seed", 2**31),
        ("learning_rate", 0.0),
        ("learning_rate", float("nan")),
        ("weight_decay", -1.0),
        ("average", 1.0),
        ("average", -0.1),
    ],
)
def test_config_names_the_setting_that_is_out_of_range(name, value):
    with pytest.raises(ValueError, match=rf"`{name}` must .*; got {value}\."):
        TrainingConfig(**{name: value})


@pytest.mark.parametrize("decay", [0.0, 0.999])
def test_averaged_weights_hold_no_share_of_the_initial_ones(tmp_path, decay):
    """The curves of this loss are the weight before a step and the average after it; its mean is taken in float64."""
    steps = 30
    config = shorter(steps, learning_rate=0.5, average=decay, validate_every=1)
    field, curves = train_number(tmp_path, config=config, field=number(20.0), loss=its_weight)
    before = np.array([curve.training for curve in curves])
    assert before[0] == 20.0
    for done in range(1, steps):
        after = before[1 : done + 1].astype(np.float64)
        share = decay ** np.arange(done - 1, -1, -1, dtype=np.float64)
        expected = np.sum(share * after) / np.sum(share)
        assert curves[done - 1].validation == pytest.approx(expected, rel=2e-6)
    assert np.ptp(before) > 5  # the weights do move, and their mean is not any one of them
    assert float(field.weight) == curves[-1].validation


def test_the_average_goes_on_through_an_extension(tmp_path):
    config = shorter(10, learning_rate=0.5, average=0.8, validate_every=1)
    train_number(tmp_path, config=config, loss=its_weight)
    _, curves = train_number(tmp_path, config=replace(config, steps=20), loss=its_weight)
    after = np.array([curve.training for curve in curves], np.float64)[1:]
    share = 0.8 ** np.arange(18, -1, -1)
    assert curves[18].validation == pytest.approx(np.sum(share * after) / np.sum(share), rel=1e-6)


def test_steps_that_are_added_have_a_warm_up_and_a_cosine_of_their_own(tmp_path):
    """Of a constant gradient Adam makes steps of the learning rate."""
    config = shorter(40, learning_rate=0.5, validate_every=1, weight_decay=0.0)
    train_number(tmp_path, config=config, loss=its_weight)
    _, curves = train_number(tmp_path, config=replace(config, steps=100), loss=its_weight)
    rates = -np.diff([curve.training for curve in curves])

    def rate(step, steps):
        warmup = min(5, steps // 10)
        if step < warmup:
            return 0.5 * step / warmup
        return 0.25 * (1 + np.cos(np.pi * (step - warmup) / (steps - warmup)))

    expected = [*(rate(k, 40) for k in range(40)), *(rate(k, 60) for k in range(59))]
    np.testing.assert_allclose(rates, expected, atol=1e-5)


def test_an_extension_is_the_same_killed_or_not(tmp_path):
    """Killed before its first checkpoint, and between two; to the bit."""
    weights = []
    for kills in ((), (40, 60)):
        folder = tmp_path / str(kills)
        first, _ = train_number(folder)
        for step in kills:
            with pytest.raises(KilledError):
                train_number(folder, 80, on_progress=killed_at(step))
        field, curves = train_number(folder, 80)
        assert [curve.step for curve in curves] == list(range(10, 81, 10))
        assert run_segments(folder) == [40, 80]
        assert float(first.weight) != float(field.weight)
        weights.append(float(field.weight))
        again, same = train_number(folder, 80)
        assert (float(again.weight), same) == (weights[-1], curves)
    assert weights[0] == weights[1]
    one, other = ((tmp_path / str(kills)) for kills in ((), (40, 60)))
    for name in ("config.json", "curves.csv"):
        assert (one / name).read_text() == (other / name).read_text()


def test_a_run_is_extended_again_and_what_it_returned_may_be_given(tmp_path):
    initial = number()
    field, _ = train_number(tmp_path, 10, field=initial)
    field, _ = train_number(tmp_path, 20, field=field)
    _, curves = train_number(str(tmp_path), 50, field=initial)
    assert len(curves) == 5
    assert float(initial.weight) == 5.0  # left as it was
    assert run_segments(str(tmp_path)) == [10, 20, 50]


def test_other_steps_are_refused_unless_they_extend_a_finished_run(tmp_path):
    with pytest.raises(KilledError):
        train_number(tmp_path, on_progress=killed_at(20))
    for steps in (10, 30, 80):
        with pytest.raises(InputError, match=f"`steps` is {steps} here, 40 in .* 20 are done"):
            train_number(tmp_path, steps)
    train_number(tmp_path)
    with pytest.raises(InputError, match="`steps` is 30 here, but 40 are done in this folder"):
        train_number(tmp_path, 30)
    with pytest.raises(KilledError):  # an extension is not finished either
        train_number(tmp_path, 80, on_progress=killed_at(60))
    for steps in (40, 120):
        with pytest.raises(InputError, match=f"`steps` is {steps} here, 80 in .* 60 are done"):
            train_number(tmp_path, steps)
    assert run_segments(tmp_path) == [40, 80]


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
        ({"loss": other_loss}, f"`loss` is {__name__}.other_loss here, {__name__}.target in the"),
        ({"loss": partial(target, aim=3.0)}, f"`loss` is functools.partial here, {__name__}.t"),
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
    assert field["field"] == f"{__name__}.Number"
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
        (("field", {}), f"`field` is {__name__}.Number here, absent in the run"),
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


def test_data_whose_parts_differ_in_length_are_refused_by_name(tmp_path):
    data, config = dataset(0, 8), shorter(10)
    with pytest.raises(ValueError, match=r"`training.condition` must have 8 samples .* \(7,\)"):
        train(number(), data._replace(condition=data.condition[:7]), data, config, tmp_path)
    with pytest.raises(ValueError, match="`validation` must hold at least one sample"):
        train(number(), data, dataset(0, 0), config, tmp_path)


def test_identities_are_what_json_has(tmp_path):
    with pytest.raises(ValueError, match="`identity` must hold values that JSON can represent"):
        train_number(tmp_path, 10, identity={"width": object()})


def test_the_loss_falls(tmp_path):
    curves = run(tmp_path)
    assert [curve.step for curve in curves] == list(range(20, 401, 20))
    assert curves[-1].validation < 0.6 * curves[0].validation
    assert read_curves(tmp_path / "curves.csv") == curves
    config = json.loads((tmp_path / "config.json").read_text())
    assert config["settings"]["batch"] == 16
    assert config["functions"] == {"loss": "deggflow.flow.mac_loss", "augment": "None"}


@pytest.mark.slow
def test_killed_training_resumes_to_the_same_weights(tmp_path):
    """SIGKILL three times at random moments, then to the end."""
    program = PROGRAM.format(root=str(Path(__file__).parents[1]), module=__name__)
    rng = np.random.default_rng(0)

    def start(folder):
        return subprocess.Popen(
            [sys.executable, "-c", program, str(folder)],
            stdout=subprocess.PIPE,
            stderr=subprocess.DEVNULL,
            text=True,
        )

    whole = start(tmp_path / "whole")
    assert whole.communicate()[0].split()[-1] == "400"
    folder, reached = tmp_path / "killed", 0
    for _ in range(3):
        process = start(folder)
        step = int(process.stdout.readline())
        assert step >= reached  # what was checkpointed is not trained again
        for _ in range(int(rng.integers(1, 4))):
            step = int(process.stdout.readline())
        time.sleep(rng.uniform(0, 0.1))
        process.send_signal(signal.SIGKILL)
        process.communicate()
        reached = step
    last = start(folder)
    last.communicate()
    assert last.returncode == 0
    one, other = (load_file(tmp_path / name / "end.safetensors") for name in ("whole", "killed"))
    for name, value in one.items():
        np.testing.assert_array_equal(value, other[name])
    assert (tmp_path / "whole/curves.csv").read_text() == (folder / "curves.csv").read_text()
