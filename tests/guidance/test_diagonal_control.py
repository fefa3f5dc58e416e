"""A control map that returns diagonals is the one that returns the matrices with these diagonals."""

import jax
import jax.numpy as jnp
import numpy as np

from deggflow import DecoupledGuidance
from deggflow import requirements as req


def test_diagonals_are_matrices():
    z = jax.random.normal(jax.random.key(0), (3, 2)) / 4
    diagonal = jnp.abs(jax.random.normal(jax.random.key(1), (3, 2)))
    plan = (req.apart(distance=1.0),)

    def correction(control):
        guidance = DecoupledGuidance(plan, control=lambda tau, z, condition: control)
        state = guidance.init(z, None)
        return guidance(state, jnp.array(0.5), z, jnp.zeros_like(z), None)[1]

    matrices = jax.vmap(jnp.diag)(diagonal)
    np.testing.assert_allclose(correction(diagonal), correction(matrices), rtol=1e-5)
