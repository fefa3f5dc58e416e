"""
# Comparing with other guidance methods

`deggflow.baselines` has the methods that one would otherwise try: a penalty's gradient, a central barrier QP, a dual
flow, projection of the predicted endpoint and others. They have the interface of `DecoupledGuidance`, run on the same
field from the same z(0), and their samples are judged by the same requirements.
"""

# %%
import equinox as eqx
import jax
import jax.numpy as jnp

from deggflow import (
    DecoupledGuidance,
    NoGuidance,
    PrivateRequirement,
    distances,
    generate_batch,
    hinge_violation,
    verdicts,
)
from deggflow.baselines import JointBarrier, PenaltyGradient


def field(tau, z, targets):
    return (targets - z) / (1.5 - tau)


targets = jnp.stack([jnp.linspace(-0.4, 0.4, 4), jnp.zeros(4)], axis=-1)
count, least, buffer = 64, 0.5, 0.02


def margins(z, targets):
    return distances(z) - least


def each_pair_once(z, targets):
    return distances(z)[jnp.triu_indices(len(z), 1)] - least


apart = PrivateRequirement(margins, buffer, name="apart")

# %%
# ## The same z(0) for every method

z0 = jax.random.normal(jax.random.key(0), (count, 4, 2))
conditions = jnp.broadcast_to(targets, (count, *targets.shape))
run = eqx.filter_jit(generate_batch)
methods = {
    "none": NoGuidance(),
    "penalty, gain 20": PenaltyGradient(hinge_violation(margins, buffer), 20.0),
    "central barrier QP": JointBarrier(each_pair_once, 1.0, buffer, rows=6),
    "decoupled": DecoupledGuidance((apart,)),
}
nominal = run(field, NoGuidance(), z0, conditions).z

# %%
# ## Success, and how far samples were moved
#
# The deviation is the root mean square distance to the nominal sample of the same z(0). Hyperparameters of baselines have
# to be tuned for each field; `deggflow tabletop baselines` does so on separate cases, and
# [the comparison](../baselines.md) has its tables.

for name, guidance in methods.items():
    generations = run(field, guidance, z0, conditions)
    met = [min(each.margin for each in verdicts(z, (apart,), targets)) >= 0 for z in generations.z]
    moved = jnp.sqrt(jnp.mean(jnp.sum((generations.z - nominal) ** 2, axis=(1, 2))))
    print(f"{name:20} {sum(met):3} of {count} satisfied, deviation {moved:.3f}")
