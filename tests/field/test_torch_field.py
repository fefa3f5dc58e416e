"""PyTorch modules as fields: forms of call, errors, what users read; the tabletop's field in PyTorch."""

import re
import runpy
from itertools import pairwise
from pathlib import Path

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
import pytest

from deggflow import (
    DecoupledGuidance,
    EveryStep,
    Extrapolated,
    NoGuidance,
    PrivateRequirement,
    distances,
    generate_batch,
    refined_grid,
)
from deggflow.field import MessagePassingField, TeamFeatures
from deggflow.tasks.tabletop.changes import random_conditions
from deggflow.tasks.tabletop.condition import to_arrays
from deggflow.tasks.tabletop.field import load_field
from deggflow.tasks.tabletop.generator import TabletopGenerator, initial_noise
from deggflow.tasks.tabletop.requirements import tabletop_guidance
from deggflow.tasks.tabletop.verdict import judge

torch = pytest.importorskip("torch")

from deggflow.field.foreign import time_state  # noqa: E402
from deggflow.field.torch import TorchField, at_one_time, joined  # noqa: E402
from deggflow.field.torch_export import export  # noqa: E402
from deggflow.tasks.tabletop.torch_field import load_torch_field, scene_arrays  # noqa: E402

ROOT = Path(__file__).parents[2]
pytestmark = pytest.mark.usefixtures("one_thread")

PULL = np.array([[0.0, -1.0, 0.5], [1.0, 0.2, 0.0], [0.3, 0.0, -0.4]], np.float32)


def plain(tau, z, push):
    """Three agents in 2-D, each drawn by the others."""
    return PULL @ z + tau * push


class Wrapped(torch.nn.Module):
    """Of flow_matching's kind: `forward(x, t, **extras)`, t a vector of as many entries as x has samples."""

    def __init__(self):
        super().__init__()
        self.pull = torch.nn.Parameter(torch.from_numpy(PULL.copy()))

    def forward(self, x, t, push):
        assert x.shape[1:] == (3, 2)
        assert t.shape == x.shape[:1] == push.shape[:1]
        return self.pull @ x + t[:, None, None] * push


class Joint(torch.nn.Module):
    """Of torchcfm's kind: reads cat([x, t])."""

    def __init__(self):
        super().__init__()
        self.net = torch.nn.Linear(7, 6, bias=False)
        push = np.ones((6, 1))
        matrix = np.concatenate([np.kron(PULL, np.eye(2)), push], axis=1)
        self.net.weight = torch.nn.Parameter(torch.from_numpy(matrix.astype(np.float32)))

    def forward(self, joint):
        return self.net(joint)


class OneTime(torch.nn.Module):
    """Of torchdyn's kind, as torchcfm wraps its models: t is one number for all samples."""

    def __init__(self):
        super().__init__()
        self.model = Joint()

    def forward(self, t, x):
        return self.model(torch.cat([x, t.repeat(x.shape[0])[:, None]], 1))


FORMS = {
    "x, t, extras": TorchField(Wrapped().eval(), extras=lambda c: {"push": c}),
    "t, x": TorchField(lambda t, x: Wrapped()(x, t, torch.ones_like(x)), time_state),
    "joined": TorchField(Joint().eval(), joined, flat=True),
    "one time": TorchField(OneTime().eval(), at_one_time, flat=True),
    "of one's own": TorchField(
        Joint().eval(),
        lambda m, x, t: m(torch.cat([x.flatten(1), t[:, None]], 1)).view_as(x),
    ),
    "lent": TorchField(Wrapped().eval(), extras=lambda c: {"push": c}, lend=True),
}


@pytest.mark.parametrize("form", FORMS)
def test_every_form_is_the_same_field(form, key):
    z, push = jax.random.normal(key, (5, 3, 2)), jnp.ones((5, 3, 2))
    tau = jnp.array([0.0, 0.3, 0.3, 1.0, 0.1])
    np.testing.assert_allclose(
        jax.jit(jax.vmap(FORMS[form]))(tau, z, push), jax.vmap(plain)(tau, z, push), atol=1e-5
    )


def test_a_batch_is_one_call_whatever_is_mapped(key):
    calls = []

    def model(x, t, push):
        calls.append((x.shape, t.shape, push.shape))
        return x * t[:, None, None] + push

    field = TorchField(model, extras=lambda c: {"push": c})
    z, tau, push = jax.random.normal(key, (5, 3, 2)), jnp.arange(4.0), jnp.ones((3, 2))
    of_times = jax.vmap(field, in_axes=(0, None, None))
    found = jax.vmap(of_times, in_axes=(None, 0, None))(tau, z, push)
    assert calls == [((20, 3, 2), (20,), (20, 3, 2))]
    wanted = z[:, None] * tau[None, :, None, None] + push[None, None]
    np.testing.assert_allclose(found, wanted, atol=1e-6)


def test_a_drift_of_few_evaluations_calls_the_module_so_often(key):
    calls = []

    def model(x, t, push):
        calls.append(len(t))
        return push - x

    field = TorchField(model, extras=lambda c: {"push": c})
    apart = PrivateRequirement(lambda z, condition: distances(z) - 0.3, 0.02, name="apart")
    z0, push = jax.random.normal(key, (20, 3, 2)), jnp.ones((20, 3, 2))
    run = jax.jit(
        lambda z0, push: generate_batch(
            field, DecoupledGuidance((apart,)), z0, push, drift=Extrapolated(6)
        )
    )
    work = jax.block_until_ready(run(z0, push)).work
    assert calls == [20] * 6
    np.testing.assert_array_equal(work.field_evaluations, 6)


def test_generates_what_the_same_field_in_jax_generates(key):
    z0, push = jax.random.normal(key, (3, 3, 2)), jnp.ones((3, 3, 2))
    wanted, found = (
        generate_batch(field, NoGuidance(), z0, push, grid=refined_grid(20)).z
        for field in (plain, FORMS["x, t, extras"])
    )
    np.testing.assert_allclose(found, wanted, atol=1e-5)


def test_programs_under_way_at_once_all_finish():
    field = TorchField(lambda x, t: -x)
    step = jax.jit(
        lambda z: jax.lax.fori_loop(0, 10, lambda _, z: z + field(jnp.zeros(()), z, None) / 10, z)
    )
    made = [step(jnp.full((20_000, 3), float(k))) for k in range(8)]
    np.testing.assert_allclose([one[0, 0] for one in made], 0.9**10 * np.arange(8), rtol=1e-5)


# Errors


class Half(torch.nn.Module):
    def forward(self, x, t):
        return x[..., :1]


@pytest.mark.parametrize(
    ("field", "message"),
    [
        (
            TorchField(Half().eval()),
            r"`Half` .* shape \(1, 3, 1\); .* \(1, 3, 2\), .*: \(samples, agents",
        ),
        (
            TorchField(Half().eval(), flat=True),
            r"shape \(1, 1\); .* \(1, 6\), .*: \(samples, agents \*",
        ),
        (TorchField(lambda x, t: (x, t)), "`<lambda>` returned an object of type tuple"),
        (TorchField(lambda x, t: None), "an object of type NoneType"),
        (TorchField(lambda x, t: x.numpy()), "an object of type ndarray; expected"),
        (TorchField(lambda x, t: x.int()), "type torch.int32; a velocity has floating"),
        (TorchField(lambda x, t: x + 1j), "type torch.complex64; a velocity has floating"),
        (
            TorchField(Joint().eval(), joined),
            r"`Joint` failed on x \(1, 3, 2\) float32, t \(1,\) float32. RuntimeError: Tensors must",
        ),
        (TorchField(Wrapped().eval()), "missing 1 required positional argument: 'push'"),
    ],
)
def test_errors_name_the_module_and_what_was_expected(field, message):
    with pytest.raises(jax.errors.JaxRuntimeError, match=message):
        jax.block_until_ready(jax.jit(field)(jnp.zeros(()), jnp.ones((3, 2)), None))


# What users read


def test_what_the_page_shows_runs_as_it_stands_there():
    page = (ROOT / "docs" / "foreign.md").read_text()
    program = "\n".join(re.findall(r"```python\n(.*?)```", page, re.DOTALL))
    shown = {}
    exec(compile(program, "foreign.md", "exec"), shown)
    assert shown["velocity"].shape == (3, 2)
    forward, z = shown["field"](jnp.asarray(0.8), jnp.ones((3, 2)), None), jnp.ones((3, 2))
    np.testing.assert_allclose(shown["turned"](jnp.asarray(0.2), z, None), -forward, rtol=1e-6)


def test_the_example_trains_a_model_and_keeps_what_is_asked(capsys):
    runpy.run_path(str(ROOT / "examples" / "torch_model.py"))["main"](samples=60, steps=300)
    text = capsys.readouterr().out
    nominal, guided = re.findall(r"(\d+) of 60 within the cable", text)
    assert int(nominal) < 50
    assert int(guided) == 60
    assert "satisfied; least margin" in text
    assert "hypotheses hold at all " in text


# Networks of ours in PyTorch


def test_an_exported_network_is_the_same_function(key):
    def featurise(z, condition):
        offset = z[:, None] - z[None, :]
        return TeamFeatures(jnp.sin(z), jnp.concatenate([offset, offset**2], -1), condition)

    skeleton = eqx.filter_eval_shape(
        MessagePassingField, featurise, node_size=2, pair_size=4, spread=(0.5, 1.5), width=16, rounds=3,
        head_width=24, key=key,
    )  # fmt: skip
    random = np.random.default_rng(0)

    def filled(leaf):
        shape = isinstance(leaf, jax.ShapeDtypeStruct)
        return random.normal(0, 0.2, leaf.shape).astype(np.float32) if shape else leaf

    field = jax.tree.map(filled, skeleton)
    z, tau = jax.random.normal(key, (6, 5, 2)), jnp.linspace(0.0, 1.0, 6)
    mask = jnp.arange(5)[None] < jnp.array([1, 2, 3, 4, 5, 5])[:, None]
    features = jax.vmap(featurise)(z, mask)
    with torch.no_grad():
        given = [torch.from_numpy(np.array(one)) for one in (z, tau, *features[:3])]
        found = export(field)(*given)
    wanted = eqx.filter_jit(lambda field, *given: jax.vmap(field)(*given))(field, tau, z, mask)
    np.testing.assert_allclose(found.numpy(), wanted, atol=1e-5)
    assert sum(one.numel() for one in export(field).parameters()) == sum(
        leaf.size for leaf in jax.tree.leaves(eqx.filter(field, eqx.is_inexact_array))
    )


@pytest.fixture(scope="module")
def scenes():
    """Scenes of different sizes, with their z(0)."""
    conditions = [one for size in (4, 6, 9, 12) for one in random_conditions(size, 3, "changed", 5)]
    return conditions, initial_noise(2, np.arange(len(conditions)), 0)


def test_the_tabletop_field_in_pytorch_generates_the_same_scenes(scenes):
    conditions, noise = scenes
    arrays = to_arrays(conditions)
    nominal = TabletopGenerator(load_field(), drift=EveryStep()).batch(noise, conditions)
    model = load_torch_field()
    given = {name: torch.from_numpy(np.array(one)) for name, one in scene_arrays(arrays).items()}
    z, grid = torch.from_numpy(noise.copy()), np.array(refined_grid())
    with torch.no_grad():
        for tau, after in pairwise(grid):
            z = z + float(after - tau) * model(z, torch.full((len(z),), float(tau)), **given)
    assert not all(verdict.satisfied for verdict in judge(conditions, nominal.poses))
    np.testing.assert_allclose(z.numpy()[arrays.mask], nominal.z[arrays.mask], atol=1e-4)


def test_the_tabletop_field_in_pytorch_is_guided(scenes):
    conditions, noise = scenes[0][:6], scenes[1][:6]
    field = TorchField(load_torch_field(), extras=scene_arrays)
    generator = TabletopGenerator(field, tabletop_guidance(), drift=EveryStep(), guard=None)
    guided = generator.batch(noise, conditions)
    assert all(verdict.satisfied for verdict in judge(conditions, guided.poses))
