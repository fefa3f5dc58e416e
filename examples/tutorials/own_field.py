"""
# A field of your own in JAX

A *field* is any function `(tau, z, condition) -> dz/dtau` of one sample: z has shape (agents, dim), tau runs from 0
(noise) to 1 (data), and the condition is whatever the model is conditioned on. A *requirement* says what must hold at
the end. This tutorial guides a field that gathers five agents far too close to each other.
"""

# %%
import jax
import jax.numpy as jnp

from deggflow import DecoupledGuidance, PrivateRequirement, distances, generate, plot, sample


def field(tau, z, targets):
    """A flow to the targets."""
    return (targets - z) / (1.5 - tau)


angle = jnp.linspace(0.0, 1.2, 5)
targets = jnp.stack([jnp.cos(angle), jnp.sin(angle)], axis=-1)

# %%
# ## A requirement is a function that returns margins
#
# One row of margins for each agent, in a unit of your choice, `>= 0` where the requirement holds. Return the distance
# itself and not a comparison: guidance follows its gradient. `distances(z)` is safe to differentiate, which
# `jnp.linalg.norm(z[i] - z[j])` is not where i = j. The buffer is what guidance aims at above zero; it pays for discrete
# steps.


def far_enough(z, targets):
    return distances(z) - 0.5


apart = PrivateRequirement(far_enough, buffer=0.02, name="apart")

# %%
# ## Samples with certificates
#
# `sample` compiles the generation once, draws z(0), judges every sample in float64, and draws again what missed a
# requirement. `guided=False` gives nominal samples, judged by the same requirement. `plot` returns a matplotlib figure,
# which a notebook shows; in a script, save it: `plot(guided).savefig("samples.png")`.

settings = {"key": jax.random.key(0), "count": 64, "shape": (5, 2)}
nominal = sample(field, (apart,), targets, guided=False, **settings)
guided = sample(field, (apart,), targets, **settings)
print(f"nominal: {nominal.satisfied.sum()} of 64 satisfied")
print(guided)
plot(guided)

# %%
# ## One sample from a given z(0)
#
# `generate` returns everything that happened: the trace of V against its bound, every agent's input and the path. Wrap it
# in `eqx.filter_jit` or `jax.jit` if you call it more than once: without it, each call is traced and compiled afresh.

guidance = DecoupledGuidance((apart,))
z0 = jax.random.normal(jax.random.key(1), (5, 2))
generation = generate(field, guidance, z0, targets, keep_path=True)
print(
    f"{int(generation.work.evaluations)} evaluations, {int(generation.work.refused_steps)} refused steps"
)
plot(generation, names=guidance.names)
