"""The benchmark suite's helpers: rows, ratios, KKT residuals, and the script in PyTorch doing the same maths. No timings."""

import json
from dataclasses import replace

import jax
import jax.numpy as jnp
import numpy as np
import pytest
from suite import qp
from suite.clock import Patience, in_turn, seconds_of
from suite.kkt import kkt_residual
from suite.rows import Row, Spread, Way, number, rows_of, spread, table, write

from deggflow.guidance import min_norm_input
from deggflow.tasks.tabletop.changes import random_conditions
from deggflow.tasks.tabletop.condition import to_arrays
from deggflow.tasks.tabletop.margins import TABLETOP
from deggflow.tasks.tabletop.requirements import OWN, POOLED, tabletop_guidance
from deggflow.tasks.tabletop.verdict import BUFFER


def test_ratios_are_taken_round_by_round():
    assert spread([2.0, 6.0, 3.0], [1.0, 2.0, 3.0]) == Spread(2.0, 1.0, 3.0)


def test_ways_that_make_different_numbers_of_samples_are_compared_by_the_sample():
    ways = {"many": Way("many", 10), "one": Way("one", 1, "many")}
    many, one = rows_of(ways, {"many": [1.0, 1.0, 1.0], "one": [0.5, 0.5, 0.5]})
    assert (many.ms, many.per_sample, many.ratio) == (1000.0, 100.0, None)
    assert one.ratio == Spread(5.0, 5.0, 5.0)


def test_every_round_calls_each_way_once_and_the_first_is_not_counted():
    called = []
    ways = {name: lambda name=name: called.append(name) for name in "ab"}
    times = in_turn(ways, Patience(seconds=0.0, least=2, most=9, turn=0.0))
    assert called == ["a", "b"] * 3
    assert [len(each) for each in times.values()] == [2, 2]


def test_short_calls_are_repeated_within_their_turn():
    called = []
    assert 0 < seconds_of(lambda: called.append(1), turn=0.01) < 0.01
    assert len(called) > 1


def test_numbers_have_three_digits():
    assert [number(v) for v in (None, 0.012345, 1.5, 99.96, 1234.5)] == [
        "", "0.0123", "1.5", "100", "1234",
    ]  # fmt: skip


def test_the_table_has_a_line_for_every_row_and_aligned_columns():
    rows = [
        Row("a/reference", "the first", 12.0, 4),
        Row("a/other", "the second", 6.0, 4, "a/reference", Spread(0.5, 0.4, 0.6), "padded"),
        Row("a/missing", "a peer", note="not installed"),
    ]
    head, first, second, missing = table(rows).splitlines()
    assert second.split() == ["a/other", "the", "second", "6", "1.5", "0.5", "0.4", "0.6", "padded"]
    assert first.index("12") + 2 == second.index("  6 ") + 3 == head.index("median ms") + 9
    assert missing.split()[-2:] == ["not", "installed"]


def test_rows_are_written_as_json(tmp_path):
    path = tmp_path / "new" / "results.json"
    write(path, {"cores": 2}, [Row("a", "one", 3.0, 2, figures={"MB": 5.0})])
    found = json.loads(path.read_text())
    assert found["cores"] == 2
    assert found["rows"][0]["per_sample"] == 1.5
    assert found["rows"][0]["figures"] == {"MB": 5.0}
    assert [file.name for file in path.parent.iterdir()] == ["results.json"]


WALL = np.array([[2.0, 0.0, 0.0], [0.0, 1.0, 0.0]]), np.array([2.0, -5.0])
"""u_x <= -1, and u_y <= 5, which doesn't bind: the solution is (-1, 0, 0)."""


def test_the_residual_of_a_solution_is_zero():
    assert kkt_residual(*WALL, np.array([-1.0, 0.0, 0.0])) < 1e-15


@pytest.mark.parametrize(
    ("u", "least"),
    [
        ([-0.9, 0.0, 0.0], 0.09 / 1.9),  # violates a row by 0.1
        ([-1.0, 0.0, 0.5], 0.5 / 2.2),  # no row asks for it
        ([-2.0, 0.0, 0.0], 0.3),  # more than is asked for
        ([np.nan, 0.0, 0.0], np.inf),
    ],
)
def test_the_residual_of_anything_else_is_not(u, least):
    assert kkt_residual(*WALL, np.array(u)) >= least


@pytest.mark.parametrize("rows", qp.ROWS)
def test_instances_have_solutions_that_are_not_trivial(rows):
    ell, b = qp.instances(rows, 64, seed=0)
    with jax.enable_x64(True):
        u, feasible = jax.jit(jax.vmap(min_norm_input))(jnp.asarray(ell), jnp.asarray(b))
    assert feasible.all()
    assert np.mean(np.linalg.norm(u, axis=1) > 0) > 0.5
    assert max(kkt_residual(*one) for one in zip(ell, b, np.asarray(u), strict=True)) < 1e-12


def test_a_peer_that_is_missing_or_broken_has_a_row_that_says_so(monkeypatch):
    def broken(ell, b):
        raise RuntimeError("not with this JAX")

    def zeros(ell, b):
        return lambda: np.zeros((len(ell), 3))

    ours = qp.Peer("ours", zeros, instances=8, reference=None)
    missing = qp.Peer("one", zeros, "no_such_module", 8, "ours")
    peers = {"ours": ours, "missing": missing, "broken": replace(ours, make=broken)}
    monkeypatch.setattr(qp, "PEERS", peers)
    rows = list(qp.agents(Patience(0.0, 1, 1, 0.0), quick=True))
    notes = {row.name: row.note for row in rows}
    assert notes["qp/2/missing"] == "not installed"
    assert "not with this JAX" in notes["qp/6/broken"]
    assert notes["qp/2/ours"] == ""


@pytest.fixture
def scene():
    """A crowded scene, as arrays with an axis of scenes and as the state of all of its objects."""
    conditions = to_arrays(random_conditions(8, 1, "changed", seed=3))
    z = np.random.default_rng(3).normal(scale=0.4, size=(1, 8, 3)).astype(np.float32)
    return conditions, z


def test_the_script_in_pytorch_has_our_violations_and_their_gradient(scene):
    torch = pytest.importorskip("torch")
    import plain_torch

    conditions, z = scene
    one = jax.tree.map(lambda leaf: jnp.asarray(leaf[0]), conditions)

    def total(z):
        each = TABLETOP.violation(z, one, BUFFER)
        return jnp.sum(each), each

    (_, ours), slope = jax.jit(jax.value_and_grad(total, has_aux=True))(jnp.asarray(z[0]))
    state = torch.from_numpy(z).requires_grad_()
    theirs = plain_torch.violations(state, plain_torch.scenes_of(conditions))
    (gradient,) = torch.autograd.grad(theirs.sum(), state)
    assert np.abs(ours).max() > 1e-3
    np.testing.assert_allclose(theirs.detach()[0], ours, rtol=1e-4, atol=1e-7)
    np.testing.assert_allclose(gradient[0], slope, rtol=1e-4, atol=1e-6)


@pytest.mark.parametrize("pooled", [True, False])
def test_the_script_in_pytorch_has_our_inputs(scene, pooled):
    torch = pytest.importorskip("torch")
    import plain_torch

    conditions, z = scene
    one = jax.tree.map(lambda leaf: jnp.asarray(leaf[0]), conditions)
    guidance = tabletop_guidance(POOLED if pooled else OWN, reanchored=False)
    drift = np.random.default_rng(4).normal(size=z.shape).astype(np.float32)

    @jax.jit
    def ours(z, drift):
        return guidance(guidance.init(z, one), jnp.asarray(0.3), z, drift, one)[1]

    scenes, state = plain_torch.scenes_of(conditions), torch.from_numpy(z)
    gain = plain_torch.first_gain(state, scenes)
    theirs = plain_torch.correction(state, torch.from_numpy(drift), 0.3, gain, scenes, pooled)
    u = ours(jnp.asarray(z[0]), jnp.asarray(drift[0]))
    np.testing.assert_allclose(theirs[0], u, rtol=1e-3, atol=1e-4 * np.abs(u).max())
