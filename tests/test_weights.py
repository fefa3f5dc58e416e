import re
from pathlib import Path

import equinox as eqx
import jax
import numpy as np
import pytest
from safetensors.numpy import load_file, save_file

from deggflow.jsonl import InputError
from deggflow.weights import load_card, load_weights, save_weights


def network(width=8, seed=0):
    return eqx.nn.MLP(3, 2, width, depth=2, key=jax.random.key(seed))


@pytest.mark.parametrize("kind", [str, Path])
def test_round_trip(tmp_path, kind):
    path, card = kind(tmp_path / "w.safetensors"), {"task": "test", "seed": 3}
    save_weights(path, network(), card)
    assert load_card(path) == card
    loaded = load_weights(path, network(seed=1))
    for a, b in zip(
        jax.tree.leaves(eqx.filter(loaded, eqx.is_array)),
        jax.tree.leaves(eqx.filter(network(), eqx.is_array)),
        strict=True,
    ):
        np.testing.assert_array_equal(a, b)


def test_other_shapes_and_names_are_refused(tmp_path):
    path = tmp_path / "w.safetensors"
    save_weights(path, network(), {})
    with pytest.raises(InputError, match=r"layers\[0\].weight has shape \(8, 3\), not \(9, 3\)"):
        load_weights(path, network(width=9))
    with pytest.raises(InputError, match=r"does not hold these arrays: .* has bias"):
        load_weights(path, eqx.nn.Linear(3, 2, key=jax.random.key(0)))


@pytest.mark.parametrize(
    ("content", "reason"),
    [
        (b"", "not JSON"),
        (b'{"task', "not JSON"),
        (b"\xff", "not UTF-8"),
        (b"[1]", r"must be a JSON object; got \[1\]"),
        (b"[" * 50_000, "nested too deeply"),
        (b'{"scale": 1e400}', "1e400 is not a finite number"),
        (b'{"a": 1, "a": 2}', "twice"),
    ],
)
def test_a_card_that_is_none_is_refused_with_its_name(tmp_path, content, reason):
    (tmp_path / "w.json").write_bytes(content)
    with pytest.raises(InputError, match=rf"w\.json.*{reason}"):
        load_card(tmp_path / "w.safetensors")


def test_weights_that_are_none_are_refused_with_their_name(tmp_path):
    path = tmp_path / "w.safetensors"
    for folder in (".", "..", "/"):
        with pytest.raises(InputError, match="is a folder; name a file"):
            load_card(folder)
    with pytest.raises(InputError, match=r"w\.json: there is no such card"):
        load_card(path)
    save_weights(path, network(), {})
    whole = path.read_bytes()
    for content in (b"", whole[:-1], whole[:7], b"\xff" * 100, b"[1]"):
        path.write_bytes(content)
        with pytest.raises(InputError, match=r"w\.safetensors: is no safetensors file"):
            load_weights(path, network())
    path.unlink()
    with pytest.raises(InputError, match=r"w\.safetensors: can't be read"):
        load_weights(path, network())


@pytest.mark.parametrize(
    ("change", "reason"),
    [
        (lambda leaf: leaf.at[(0,) * leaf.ndim].set(np.nan), "not finite"),
        (lambda leaf: leaf.astype(int), "must hold floats; got int32"),
    ],
)
def test_weights_are_finite_floats(tmp_path, change, reason):
    path, names = tmp_path / "w.safetensors", []
    save_weights(path, network(), {})
    stored = load_file(path)
    for name in stored:
        names.append(name)
        save_file({**stored, name: np.asarray(change(jax.numpy.asarray(stored[name])))}, path)
        with pytest.raises(InputError, match=f"{re.escape(name)} .*{reason}"):
            load_weights(path, network())
    assert len(names) == 6
