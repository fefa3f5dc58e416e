"""Requirements written in PyTorch: the same numbers as in JAX, the same samples, and errors that name the function."""

import doctest

import jax
import jax.numpy as jnp
import numpy as np
import pytest

import deggflow
from deggflow import PrivateRequirement, SharedFactor, SharedRequirements, TighteningBound

torch = pytest.importorskip("torch")

from deggflow import torch as bridge  # noqa: E402
from deggflow.torch import TorchMargins, TorchValue, sample  # noqa: E402

RADIUS = 0.2


def margins_jax(z, condition):
    return deggflow.distances(z).clip(max=5.0) - condition["least"]


def margins_torch(z, condition):
    own = 10 * torch.eye(z.shape[1], dtype=z.dtype)
    apart = ((z[:, :, None] - z[:, None]).square().sum(-1) + own).sqrt() + own
    return apart.clamp(max=5.0) - condition["least"][:, None, None]


def width_jax(tau, z, condition):
    return jnp.sum(z**2) * (1 + tau) - 10 * condition["least"]


def width_torch(t, z, condition):
    return z.square().sum(dim=(1, 2)) * (1 + t) - 10 * condition["least"]


def pull(tau, z, condition):
    return -z


def requirements(private, shared):
    return (
        PrivateRequirement(private, 0.02, name="apart"),
        SharedRequirements((SharedFactor(shared, TighteningBound(least=3.0), name="width"),)),
    )


IN_JAX = requirements(margins_jax, width_jax)
IN_TORCH = requirements(TorchMargins(margins_torch), TorchValue(width_torch))
CONDITION = {"least": np.float32(RADIUS)}


@pytest.mark.parametrize("x64", [False, True])
def test_values_gradients_and_dependence_are_those_of_jax(x64):
    with jax.enable_x64(x64):
        z = 0.3 * jax.random.normal(jax.random.key(1), (6, 4, 2), float if x64 else jnp.float32)
        condition = {"least": jnp.asarray(RADIUS, z.dtype)}
        here, there = (IN_JAX[0]._judged(None), IN_TORCH[0]._judged(None))

        def of(margins, value):
            def one(z):
                pulled = jax.value_and_grad(value, argnums=(0, 1))(
                    jnp.asarray(0.3, z.dtype), z, condition
                )
                both = margins.violation_and_gradient(z, condition, 0.02)
                return both, margins.dependence(z, condition, 0.02), margins(z, condition), pulled

            return jax.jit(jax.vmap(one))(z)

        for a, b in zip(
            jax.tree.leaves(of(here, width_jax)),
            jax.tree.leaves(of(there, IN_TORCH[1].factors[0].value)),
            strict=True,
        ):
            assert a.dtype == b.dtype
            off = np.eye(4, dtype=bool) if a.shape == (6, 4, 4) and a.dtype != bool else False
            np.testing.assert_allclose(
                np.where(off, 0, a), np.where(off, 0, b), rtol=1e-12 if x64 else 1e-4, atol=1e-6
            )


def test_samples_are_those_of_jax_and_tensors():
    settings = {"count": 8, "shape": (4, 2), "guard": None}
    there = sample(
        bridge.TorchField(lambda x, t: -x),
        IN_TORCH,
        {"least": torch.tensor(RADIUS)},
        seed=3,
        **settings,
    )
    here = deggflow.sample(pull, IN_JAX, CONDITION, key=jax.random.key(3), **settings)
    assert here.satisfied.all()
    assert there.satisfied.all()
    assert isinstance(there.z, torch.Tensor)
    assert str(there) == str(here)
    np.testing.assert_allclose(there.z.numpy(), here.z, atol=1e-3)
    # Each judges the other's samples.
    [one, two] = deggflow.verdicts(there.z[0].numpy(), IN_JAX, CONDITION)
    assert min(one.margin, two.margin) >= 0


@pytest.mark.parametrize(
    ("margins", "error", "message"),
    [
        (lambda z, c: z > 0, TypeError, "floating-point numbers; got torch.bool"),
        (lambda z, c: z.sum(dim=2), ValueError, r"\(samples, agents, margins\) .* got \(1, 4\)"),
        (lambda z, c: z.half(), TypeError, "type of z; got torch.float16 for float32"),
        (lambda z, c: 1.0, TypeError, "got float"),
    ],
)
def test_errors_name_the_function(margins, error, message):
    with pytest.raises(error, match=message):
        TorchMargins(margins)(jnp.zeros((4, 2)), None)


def test_examples_run():
    names = {"torch": torch, "jnp": jnp, "TorchField": bridge.TorchField, **vars(bridge)}
    names["PrivateRequirement"] = PrivateRequirement
    tests = [each for each in doctest.DocTestFinder().find(bridge, globs=names) if each.examples]
    assert len(tests) == 3
    for test in tests:
        assert doctest.DocTestRunner().run(test).failed == 0
