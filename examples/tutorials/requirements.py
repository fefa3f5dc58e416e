"""
# Named requirements, private and shared

`deggflow.requirements` has the common requirements of points, poses and trajectories: see
[the table](../requirements.md). They know their margins, buffers and units, and can be added up.
"""

# %%
import jax
import jax.numpy as jnp

from deggflow import SharedFactor, SharedRequirements, TighteningBound, plot, requirements, sample


def field(tau, z, targets):
    return (targets - z) / (1.5 - tau)


targets = jnp.stack([jnp.linspace(-1.0, 1.0, 4), jnp.zeros(4)], axis=-1)

# %%
# ## Private requirements
#
# Each agent owns one, although its neighbours also affect it: distances, regions, speeds. A *sum* of two is one
# requirement with one V, in which every margin is measured in its own buffer. It is the right choice for margins of
# several kinds in large numbers.

disc = requirements.Disc((0.0, 0.6), 0.4)
box = requirements.Box((0.0, 0.0), (4.0, 3.0))
safe = (
    requirements.apart(distance=0.4, buffer=0.02)
    + requirements.outside(disc, buffer=0.02)
    + requirements.inside(box, buffer=0.02)
)

# %%
# ## Shared requirements
#
# A factor is a quantity of several agents that must be at most its bound in the end. z(0) need not satisfy it: the bound
# starts where the factor is, and falls. Here the centre of the team stays within 0.1 of the line y = -0.2. The square has a
# gradient everywhere, which an absolute value has not.


def off_centre(tau, z, targets):
    return (((jnp.mean(z[:, 1]) + 0.2) / 0.1) ** 2 - 1) / 2


centred = SharedFactor(off_centre, TighteningBound(least=0.0), buffer=0.02, name="centred")

# %%
# ## Both at once
#
# A *tuple* has one V or q and one row for each entry, and every agent meets all of its rows at once. Where they
# contradict each other, the certificate names the agent.

result = sample(
    field,
    (safe, SharedRequirements((centred,))),
    targets,
    key=jax.random.key(0),
    count=64,
    shape=(4, 2),
)
print(result)
print(result.certificates[0].table())
plot(result)

# %%
# ## What cannot be satisfied is reported
#
# Four agents at least 4 m apart do not fit into this box. `sample` returns the closest of `max_draws` draws, with the
# agent that misses the requirement, and by how much.

crowded = requirements.apart(distance=4.0) + requirements.inside(box)
refused = sample(
    field, (crowded,), targets, key=jax.random.key(0), count=2, shape=(4, 2), max_draws=2
)
print(refused)
assert not refused.satisfied.any()
