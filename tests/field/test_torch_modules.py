"""What a PyTorch module does as a field: whose memory is whose, types, gradients and modes."""

import jax
import jax.numpy as jnp
import numpy as np
import pytest

torch = pytest.importorskip("torch")

from deggflow.field.torch import TorchField  # noqa: E402

pytestmark = pytest.mark.usefixtures("one_thread")


# Memory


def scribble(x, t, push):
    """Right, but uses its arguments as scratch memory."""
    velocity = x * t[:, None, None] + push
    x.mul_(0)
    t.add_(1)
    push.data.fill_(7)
    return velocity


@pytest.mark.parametrize("compiled", [False, True])
def test_a_module_may_write_to_its_inputs(compiled, key):
    field = TorchField(scribble, extras=lambda c: {"push": c})
    z, tau, push = jax.random.normal(key, (3, 2)), jnp.asarray(0.5), jnp.ones((3, 2))
    before = np.array(z)

    def twice(tau, z, push):
        return z + field(tau, z, push) + field(tau, 2 * z, push)

    found = (jax.jit(twice) if compiled else twice)(tau, z, push)
    np.testing.assert_allclose(found, before + 1.5 * before + 2.0, atol=1e-6)
    np.testing.assert_array_equal(z, before)
    np.testing.assert_array_equal(push, 1.0)
    assert tau == 0.5


def test_a_module_that_writes_to_lent_memory_is_told_of():
    field = TorchField(scribble, extras=lambda c: {"push": c}, lend=True)
    with pytest.raises(
        jax.errors.JaxRuntimeError, match=r"`scribble` has written to its input `x`"
    ):
        field(jnp.asarray(0.5), jnp.ones((3, 2)), jnp.ones((3, 2)))


def test_lent_memory_is_that_of_jax_and_copies_are_not():
    seen = []

    def model(x, t):
        seen.append(x.data_ptr())
        return -x

    z = jnp.ones((3, 2))
    assert float(TorchField(model, lend=True)(jnp.zeros(()), z, None)[0, 0]) == -1.0
    assert float(TorchField(model)(jnp.zeros(()), z, None)[0, 0]) == -1.0
    assert seen[0] == z.unsafe_buffer_pointer() != seen[1]


class Reusing(torch.nn.Module):
    """Writes each output into the memory of the one before, and keeps its inputs."""

    def __init__(self):
        super().__init__()
        self.register_buffer("out", torch.zeros(1, 3, 2))
        self.kept = []

    def forward(self, x, t):
        self.kept.append(x)
        return self.out.copy_(2 * x)


def test_what_a_module_does_with_its_memory_later_changes_no_result():
    model = Reusing().eval()
    field, zero = TorchField(model), jnp.zeros(())
    first = field(zero, jnp.ones((3, 2)), None)
    second = field(zero, 5 * jnp.ones((3, 2)), None)
    model.out.zero_()
    np.testing.assert_array_equal(first, 2.0)
    np.testing.assert_array_equal(second, 10.0)
    assert [float(kept.mean()) for kept in model.kept] == [1.0, 5.0]


# Types


@pytest.mark.parametrize("dtype", [torch.float64, torch.float32, torch.bfloat16])
def test_a_module_computes_in_its_own_precision(dtype):
    seen = []

    class Model(torch.nn.Module):
        def __init__(self):
            super().__init__()
            self.weight = torch.nn.Parameter(torch.full((2,), 1 / 3, dtype=dtype))

        def forward(self, x, t, push, kind, here):
            seen.append([one.dtype for one in (x, t, push, kind, here)])
            return x * self.weight + push

    def extras(condition):
        return {"push": condition, "kind": jnp.arange(3), "here": jnp.arange(3) > 1}

    field, tau = TorchField(Model().eval(), extras=extras), jnp.zeros(())
    found = field(tau, jnp.ones((3, 2)), 0.0)
    assert found.dtype == jnp.float32
    np.testing.assert_allclose(found, 1 / 3, rtol=1e-2 if dtype == torch.bfloat16 else 1e-7)
    with jax.enable_x64(True):
        exact = field(tau, jnp.ones((3, 2)), 0.0)
        assert exact.dtype == jnp.float64
    if dtype == torch.float64:  # not by way of float32
        np.testing.assert_allclose(exact, 1 / 3, rtol=1e-15)
    assert seen == [[dtype, dtype, dtype, torch.int64, torch.bool]] * 2


def test_a_callable_without_parameters_computes_in_the_precision_of_z():
    field = TorchField(lambda x, t: x / 3)
    with jax.enable_x64(True):
        np.testing.assert_allclose(
            field(0.0 * jnp.ones(()), jnp.ones((3, 2)), None), 1 / 3, rtol=1e-15
        )


def test_not_a_number_passes():
    found = TorchField(lambda x, t: x / t[:, None, None])(jnp.zeros(()), jnp.eye(2), None)
    np.testing.assert_array_equal(found, [[np.inf, np.nan], [np.nan, np.inf]])


# Gradients and modes


def test_nothing_is_recorded_and_a_module_may_take_gradients_itself():
    class Potential(torch.nn.Module):
        def __init__(self):
            super().__init__()
            self.stiffness = torch.nn.Parameter(torch.tensor(3.0))

        def forward(self, x, t):
            assert not (self.stiffness * x).requires_grad
            with torch.enable_grad():
                x = x.detach().requires_grad_()
                energy = (self.stiffness * x.square() / 2).sum()
                return -torch.autograd.grad(energy, x, create_graph=True)[0]

    model = Potential().eval()
    np.testing.assert_allclose(TorchField(model)(jnp.zeros(()), jnp.ones((3, 2)), None), -3.0)
    assert model.stiffness.grad is None


def test_a_module_in_training_mode_is_refused_and_none_is_changed():
    model = torch.nn.Dropout(0.5)
    field = TorchField(model, lambda m, x, t: m(x))
    program = jax.jit(lambda z: field(jnp.zeros(()), z, None))
    with pytest.raises(ValueError, match="`Dropout` is in training mode"):
        program(jnp.ones((3, 2)))
    assert model.training
    model.eval()
    np.testing.assert_array_equal(program(jnp.ones((3, 2))), 1.0)
    model.train()  # compiled by now
    with pytest.raises(jax.errors.JaxRuntimeError, match="`Dropout` is in training mode"):
        program(jnp.ones((3, 2))).block_until_ready()


def test_weights_count_when_they_are_changed():
    model = torch.nn.Linear(2, 2, bias=False).eval()
    program = jax.jit(lambda z: TorchField(model, lambda m, x, t: m(x))(jnp.zeros(()), z, None))
    for weight in (1.0, 2.0):
        torch.nn.init.constant_(model.weight, weight)
        np.testing.assert_allclose(program(jnp.ones((3, 2))), 2 * weight)
