"""Pictures, tables, loggers and folders of one's own problem."""

import doctest
import json
import os
import subprocess
import sys

import equinox as eqx
import jax
import jax.numpy as jnp
import matplotlib as mpl
import numpy as np
import pytest
from hub_server import hub_server

import deggflow
from deggflow import frames, loggers, plotting, pretrained
from deggflow.field import MessagePassingField, TeamFeatures
from deggflow.jsonl import InputError
from deggflow.sampling import Progress
from deggflow.train import Curve
from deggflow.weights import load_weights

mpl.use("Agg")


def field(tau, z, condition):
    return -z


def far(z, condition):
    return deggflow.distances(z).clip(max=5.0) - 0.3


APART = deggflow.PrivateRequirement(far, 0.02, name="apart")
GUIDANCE = deggflow.DecoupledGuidance((APART,))
GRID = deggflow.refined_grid(20)


@pytest.fixture(scope="module")
def result():
    return deggflow.sample(
        field, (APART,), key=jax.random.key(0), count=12, shape=(3, 2), grid=GRID, keep_trace=True
    )


@pytest.fixture(scope="module")
def generation():
    z0 = jax.random.normal(jax.random.key(0), (3, 2))
    program = eqx.filter_jit(deggflow.generate)
    return program(field, GUIDANCE, z0, None, grid=GRID, keep_path=True)


@pytest.fixture(autouse=True)
def closed():
    yield
    from matplotlib import pyplot

    pyplot.close("all")


def titles(figure):
    return [axes.get_title() for axes in figure.axes]


def test_pictures_show_what_results_hold(result, generation):
    figure = deggflow.plot(generation, names=["apart"])
    assert titles(figure) == ["apart", "inputs", "paths"]
    value, bound, limit = (line.get_ydata() for line in figure.axes[0].lines)
    trace = generation.trace
    np.testing.assert_allclose(value, np.maximum(trace.value[:, 0], 1e-12), rtol=1e-6)
    np.testing.assert_allclose(bound, np.maximum(trace.bound[:, 0], 1e-12), rtol=1e-6)
    np.testing.assert_allclose(limit, trace.limit[:, 0], rtol=1e-6)
    ends = [line.get_xydata()[-1] for line in figure.axes[2].lines[::3]]
    np.testing.assert_allclose(ends, generation.z, rtol=1e-6)
    assert titles(deggflow.plot(result.certificates[0])) == ["satisfied", "apart"]
    least, states = deggflow.plot(result).axes
    shown = np.concatenate([each.get_offsets() for each in states.collections])
    np.testing.assert_allclose(np.asarray(shown).reshape(result.z.shape), result.z, rtol=1e-6)
    [points] = least.collections
    margins = sorted(each.min_margin for each in result.certificates)
    np.testing.assert_allclose(points.get_offsets()[:, 1], margins)


def test_what_can_not_be_drawn_is_named(generation):
    with pytest.raises(ValueError, match="`names` must be 1 names"):
        deggflow.plot(generation, names=["a", "b"])
    with pytest.raises(ValueError, match="keep_trace=True"):
        deggflow.plot(generation._replace(trace=None, path=None))
    with pytest.raises(ValueError, match="one sample"):
        deggflow.plot(jax.tree.map(lambda leaf: leaf[None], generation))


def test_tables_of_pandas(result):
    pytest.importorskip("pandas")
    table = deggflow.to_pandas(result)
    assert list(table["satisfied"]) == list(result.satisfied)
    assert list(table["margin of apart"]) == [each.min_margin for each in result.certificates]
    long = deggflow.to_pandas(result.certificates, by="requirement")
    assert list(long["excess"]) == [
        each.generation.requirements[0].excess for each in result.certificates
    ]


def test_loggers_tell_what_they_are_told(tmp_path, capsys, monkeypatch):
    told = []

    class Stored:
        def add_scalar(self, tag, scalar_value, global_step):
            told.append((tag, scalar_value, global_step))

        def log(self, data, step):
            told.extend((name, value, step) for name, value in data.items())

    both = loggers.together(loggers.to_tensorboard(Stored()), loggers.to_run(Stored()))
    both(Curve(20, 0.5, 0.25))
    losses = [("training/loss", 0.5, 20), ("validation/loss", 0.25, 20)]
    assert told == losses * 2
    with loggers.bar(
        40, "samples"
    ) as on_progress:  # no terminal: one line, as the next is too soon
        on_progress(Progress(1, 20, 40, 10, 40))
        on_progress(Progress(1, 40, 40, 20, 40))
    assert (
        capsys.readouterr().err
        == "step 20: sample/draw 1, sample/completed 20, sample/satisfied 0.25\n"
    )
    monkeypatch.setattr(sys.stderr, "isatty", lambda: True)
    with loggers.bar(40, "training") as on_progress:
        on_progress(Curve(40, 0.5, 0.25))
    assert "validation/loss 0.25" in capsys.readouterr().err


# Folders


def featurise(z, condition):
    offset = z[:, None] - z[None]
    return TeamFeatures(z, offset, jnp.ones(len(z), bool))


CARD = deggflow.ModelCard(
    name="ring", summary="Agents on a ring.", data="1,000 rings.", seeds={"data": 0},
    figures={"validation loss": 0.31}, intended_use="Tests.", limits="Three agents.",
)  # fmt: skip


@pytest.fixture
def trained():
    return MessagePassingField(
        featurise, node_size=2, pair_size=2, spread=(1.0, 0.5), width=8, rounds=1, head_width=8,
        key=jax.random.key(1),
    )  # fmt: skip


def test_a_folder_brings_back_the_field_and_its_card(tmp_path, trained):
    deggflow.save_pretrained(trained, tmp_path / "ring", CARD)
    again, card = deggflow.from_pretrained(tmp_path / "ring", featurise)
    assert eqx.tree_equal(trained, again)
    assert card["figures"] == {"validation loss": 0.31}
    text = (tmp_path / "ring" / "README.md").read_text()
    assert text.startswith("---\nlibrary_name: deggflow\nlicense: apache-2.0\n")
    assert "| validation loss | 0.31 |" in text
    built, _ = deggflow.from_pretrained(
        tmp_path / "ring", build=lambda card: eqx.filter_eval_shape(lambda: trained)
    )
    assert eqx.tree_equal(trained, built)


READER = """
import sys
import jax.numpy as jnp
from deggflow import from_pretrained
from deggflow.field import TeamFeatures
from deggflow.weights import save_weights

def featurise(z, condition):
    offset = z[:, None] - z[None]
    return TeamFeatures(z, offset, jnp.ones(len(z), bool))

for name in sys.argv[2:]:
    try:
        field, card = from_pretrained(name, featurise)
    except OSError as error:
        print(name, type(error).__name__)
    else:
        save_weights(sys.argv[1], field, {"name": card["name"]})
        print(name, card["name"])
"""


@pytest.fixture
def hub(tmp_path, trained):
    """A server on this machine that answers as the Hub does for the one repository team/ring."""
    deggflow.save_pretrained(trained, tmp_path / "ring", CARD)
    files = {path.name: path.read_bytes() for path in (tmp_path / "ring").iterdir()}
    with hub_server("team/ring", {**files, "harmful.pkl": b"not asked for"}) as server:
        yield server


def test_the_hub_is_read_and_read_again_offline(tmp_path, trained, hub):
    """By huggingface_hub itself: it downloads into a cache of its own making, which its offline mode reads alone."""
    pytest.importorskip("huggingface_hub")

    def read(*names, **environment):
        cache = {"HF_HOME": str(tmp_path / "home"), "HF_HUB_DISABLE_TELEMETRY": "1"}
        return subprocess.run(
            [sys.executable, "-c", READER, str(tmp_path / "again.safetensors"), *names],
            env={**os.environ, **cache, **environment}, capture_output=True, text=True, check=True,
        ).stdout.splitlines()  # fmt: skip

    assert read("team/ring", HF_ENDPOINT=hub.url) == ["team/ring ring"]
    assert sorted(hub.downloaded) == ["README.md", "field.json", "field.safetensors"]
    (tmp_path / "again.safetensors").unlink()
    offline = read("team/ring", "team/other", HF_HUB_OFFLINE="1", HF_ENDPOINT="http://127.0.0.1:9")
    assert offline == ["team/ring ring", "team/other LocalEntryNotFoundError"]
    again = load_weights(tmp_path / "again.safetensors", trained)
    assert eqx.tree_equal(trained, again)


def test_bad_folders_and_cards_are_named(tmp_path, trained):
    with pytest.raises(InputError, match="no repository of the form"):
        deggflow.from_pretrained(tmp_path / "none", featurise)
    with pytest.raises(ValueError, match="one of `featurise` and `build`"):
        deggflow.from_pretrained(tmp_path)
    with pytest.raises(ValueError, match="`architecture` must say"):
        deggflow.save_pretrained(eqx.nn.Linear(1, 1, key=jax.random.key(0)), tmp_path, CARD)
    with pytest.raises(ValueError, match="JSON"):
        deggflow.save_pretrained(trained, tmp_path, CARD, architecture={"a": float("nan")})
    with pytest.raises(ValueError, match="`limits` must be a text"):
        deggflow.ModelCard("ring", "s", "d", {}, {}, "u", " ")
    deggflow.save_pretrained(trained, tmp_path, CARD)
    card = json.loads((tmp_path / "field.json").read_text())
    for name, value in (("width", -1), ("width", 4), ("spread", [])):
        changed = {**card, "architecture": {**card["architecture"], name: value}}
        (tmp_path / "field.json").write_text(json.dumps(changed))
        with pytest.raises(InputError):
            deggflow.from_pretrained(tmp_path, featurise)


@pytest.mark.parametrize(
    "module", [loggers, plotting, pretrained, frames], ids=lambda m: m.__name__
)
def test_examples_run(module, tmp_path, trained, result):
    if module is frames:
        pytest.importorskip("pandas")
    names = {
        **vars(deggflow.generation), **vars(module), "field": field, "guidance": GUIDANCE, "condition": None,
        "z0": jax.random.normal(jax.random.key(0), (3, 2)), "eqx": eqx, "trained": trained, "card": CARD,
        "folder": tmp_path, "featurise": featurise, "result": result,
    }  # fmt: skip
    if module is frames:
        names["result"] = deggflow.Samples(
            np.repeat(result.z, 43, axis=0)[:512], (result.certificates * 43)[:512]
        )
    tests = [each for each in doctest.DocTestFinder().find(module, globs=names) if each.examples]
    assert tests
    for test in tests:
        assert doctest.DocTestRunner().run(test).failed == 0, test.name
