"""JAX callables from outside: every form of call is the same field, and what is no velocity is refused."""

import subprocess
import sys

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
import pytest

from deggflow import (
    DecoupledGuidance,
    PrivateRequirement,
    certify,
    generate,
)
from deggflow.field.foreign import JaxField, time_state

PULL = jnp.array([[0.0, -1.0, 0.5], [1.0, 0.2, 0.0], [0.3, 0.0, -0.4]])


def plain(tau, z, condition):
    """Three agents in 2-D, each drawn by the others."""
    return PULL @ z + tau * condition


def joint(x, t, push):
    return jnp.kron(PULL, jnp.eye(2)) @ x + t * push


def of_batch(x, t, push):
    assert x.shape[1:] == (3, 2)
    assert t.shape == x.shape[:1] == push.shape[:1]
    return jnp.einsum("ij,bjd->bid", PULL, x) + t[:, None, None] * push


FORMS = {
    "x, t": JaxField(lambda x, t, push: plain(t, x, push), extras=lambda c: {"push": c}),
    "t, x": JaxField(
        lambda t, x, push: plain(t, x, push), time_state, extras=lambda c: {"push": c}
    ),
    "of one's own": JaxField(
        plain, lambda model, x, t, given: model(t, x, given), extras=lambda c: {"given": c}
    ),
    "flat": JaxField(joint, extras=lambda c: {"push": c.reshape(-1)}, flat=True),
    "batched": JaxField(of_batch, extras=lambda c: {"push": c}, batched=True),
    "batched and flat": JaxField(
        lambda x, t, push: jax.vmap(joint)(x, t, push),
        extras=lambda c: {"push": c.reshape(-1)},
        flat=True,
        batched=True,
    ),
    "bfloat16": JaxField(
        lambda x, t, push: plain(t, x, push).astype(jnp.bfloat16), extras=lambda c: {"push": c}
    ),
}


@pytest.mark.parametrize("form", FORMS)
def test_every_form_is_the_same_field(form, key):
    z, push = jax.random.normal(key, (2, 5, 3, 2))
    tau = jnp.linspace(0.0, 1.0, 5)
    wanted = jax.vmap(plain)(tau, z, push)
    found = jax.jit(jax.vmap(FORMS[form]))(tau, z, push)
    assert found.dtype == wanted.dtype
    np.testing.assert_allclose(found, wanted, rtol=2e-2 if form == "bfloat16" else 1e-5, atol=1e-5)


def test_a_model_in_double_precision_leaves_states_as_they_are():
    field = JaxField(lambda x, t: np.float64(2) * x.astype(jnp.float64))
    with jax.enable_x64(True):
        assert field(jnp.zeros(()), jnp.ones((3, 2), jnp.float32), None).dtype == jnp.float32
        assert field(jnp.zeros(()), jnp.ones((3, 2)), None).dtype == jnp.float64


def test_weights_of_a_model_are_arguments_of_a_compiled_program():
    programs = []

    @eqx.filter_jit
    def program(field, z):
        programs.append(field)
        return field(jnp.zeros(()), z, None)

    z = jnp.ones((3, 2))

    def linear(pull, x, t):
        return pull @ x

    for scale in (1.0, 2.0):
        model = jax.tree_util.Partial(linear, scale * PULL)
        np.testing.assert_allclose(program(JaxField(model), z), scale * PULL @ z, rtol=1e-6)
    assert len(programs) == 1


def half(x, t):
    return x[..., :1]


@pytest.mark.parametrize(
    ("field", "message"),
    [
        (JaxField(half), r"`half` returned .* shape \(3, 1\); .* \(3, 2\), like x: \(agents"),
        (JaxField(half, flat=True), r"shape \(1,\); .* \(6,\), like x: \(agents \* dim\)"),
        (JaxField(half, batched=True), r"shape \(1, 3, 1\); .* \(1, 3, 2\), .* \(samples, agents"),
        (JaxField(lambda x, t: (x, t)), "`<lambda>` returned an object of type tuple"),
        (JaxField(lambda x, t: None), "an object of type NoneType"),
        (JaxField(lambda x, t: jnp.ones((3, 2), int)), "type int32; a velocity has floating"),
        (JaxField(lambda x, t: x + 1j), "type complex64; a velocity has floating"),
        (JaxField(eqx.nn.Identity(), lambda m, x, t: t), r"`Identity` .* shape \(\)"),
    ],
)
def test_what_is_no_velocity_is_refused(field, message):
    with pytest.raises(ValueError, match=message):
        jax.jit(field)(jnp.zeros(()), jnp.ones((3, 2)), None)


def test_a_joint_model_from_outside_is_guided():
    """Three agents that are drawn to nearly one point stay 0.5 apart."""
    goal = jnp.array([[0.0, 0.0], [0.1, 0.0], [0.0, 0.1]])
    field = JaxField(lambda t, x: (goal.reshape(-1) - x) / (1.5 - t), time_state, flat=True)

    def margins(z, condition):
        offset = z[:, None] - z[None, :] + 10.0 * jnp.eye(3)[..., None]
        return jnp.linalg.norm(offset, axis=-1) - 0.5

    guidance = DecoupledGuidance((PrivateRequirement(margins, 0.02, name="apart"),))
    z0 = jax.random.normal(jax.random.key(3), (3, 2))
    assert jnp.min(margins(goal + (z0 - goal) / 3, None)) < 0  # where the field alone leads
    sample = jax.jit(lambda z0: generate(field, guidance, z0, None))(z0)
    assert certify(sample, guidance).satisfied


def test_pytorch_is_an_extra():
    """Nothing imports it unasked, and who asks without having it is told what to install."""
    code = """
import sys
import deggflow.certificate, deggflow.field.foreign, deggflow.generation, deggflow.tasks.tabletop.generator
assert "torch" not in sys.modules
sys.modules["torch"] = None
try:
    import deggflow.field.torch
except ImportError as error:
    assert "deggflow[torch]" in str(error)
else:
    raise AssertionError
"""
    subprocess.run([sys.executable, "-c", code], check=True)
