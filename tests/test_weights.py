from pathlib import Path

import equinox as eqx
import jax
import numpy as np
import pytest

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
    with pytest.raises(ValueError, match=r"layers\[0\].weight has shape \(8, 3\), .* \(9, 3\)"):
        load_weights(path, network(width=9))
    with pytest.raises(ValueError, match="does not hold this field's weights"):
        load_weights(path, eqx.nn.Linear(3, 2, key=jax.random.key(0)))


@pytest.mark.parametrize(
    ("content", "reason"),
    [(b"", "not JSON"), (b'{"task', "not JSON"), (b"\xff", "not JSON"), (b"[]", "got list")],
)
def test_a_card_that_is_none_is_refused_with_its_name(tmp_path, content, reason):
    (tmp_path / "w.json").write_bytes(content)
    with pytest.raises(ValueError, match=rf"w\.json: .*{reason}"):
        load_card(tmp_path / "w.safetensors")
