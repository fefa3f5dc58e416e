"""
# Training a field from data

`MessagePassingField` is a permutation-equivariant network for teams of any size; `train` fits it by the multi-agent
flow-matching loss, with checkpoints, exact resumption and averaged weights. This tutorial trains on 1,000 samples,
certifies what comes out, and saves and loads the field.
"""

# %%
import tempfile
from pathlib import Path

import jax
import jax.numpy as jnp
import numpy as np

from deggflow import ModelCard, from_pretrained, plot, requirements, sample, save_pretrained
from deggflow.field import MessagePassingField, TeamFeatures
from deggflow.train import Dataset, TrainingConfig, train

# %%
# ## Data
#
# A `Dataset` has the states z of shape (samples, agents, dim), a condition (any tree of arrays with a leading axis of
# samples), and a mask of the agents that are present. Teams of different sizes are padded. Scale the data so that their
# standard deviation is about one. Here four agents stand on a circle whose radius is the condition.


def circles(seed, count):
    rng = np.random.default_rng(seed)
    radius = rng.uniform(0.7, 1.3, count)
    turn = 2 * np.pi * (rng.uniform(size=(count, 1)) + np.arange(4) / 4)
    z = radius[:, None, None] * np.stack([np.cos(turn), np.sin(turn)], axis=-1)
    z += 0.05 * rng.normal(size=z.shape)
    return Dataset(z.astype(np.float32), radius.astype(np.float32), np.ones((count, 4), bool))


training, validation = circles(0, 1000), circles(1, 100)

# %%
# ## A field
#
# `featurise` turns a state into features of every agent and of every pair of agents. Use relative quantities for pairs,
# and nothing that depends on the order of the agents.


def featurise(z, radius):
    agents = len(z)
    node = jnp.concatenate([z, jnp.broadcast_to(radius, (agents, 1))], axis=1)
    pair = z[None] - z[:, None]
    return TeamFeatures(node, pair, jnp.ones(agents, bool))


field = MessagePassingField(
    featurise, node_size=3, pair_size=2, spread=(0.7, 0.7), width=32, rounds=2, head_width=32,
    key=jax.random.key(0),
)  # fmt: skip

# %%
# ## Training
#
# The folder holds one run. Call `train` again with the same arguments after a crash, and it resumes from its last
# checkpoint with bitwise the same result; call it with more steps, and it extends the run. `on_progress` may be a bar,
# TensorBoard or a run of W&B: see `deggflow.loggers`.

folder = Path(tempfile.mkdtemp())
config = TrainingConfig(steps=400, batch=64, warmup=20, average=0.98, validate_every=100)
trained, curves = train(field, training, validation, config, folder / "run", on_progress=print)

# %%
# ## Certified samples of the trained field
#
# In training, agents on the smallest circles were about 1 apart. The requirement asks for more.

apart = requirements.apart(distance=1.2, buffer=0.02)
settings = {
    "key": jax.random.key(2),
    "count": 64,
    "shape": (4, 2),
    "conditions": jnp.linspace(0.7, 1.3, 64),
}
nominal = sample(trained, (apart,), guided=False, **settings)
guided = sample(trained, (apart,), **settings)
print(f"nominal: {nominal.satisfied.sum()} of 64 satisfied")
print(guided)
plot(guided)

# %%
# ## Saving and loading
#
# The folder has the weights, a card for programs and a card for people. `hf upload ORGANISATION/NAME FOLDER` publishes
# it, and `from_pretrained("ORGANISATION/NAME", featurise)` reads it from there: see [sharing](../sharing.md).

card = ModelCard(
    name="circles",
    summary="Four agents on a circle of a given radius.",
    data="1,000 circles of the tutorial's `circles(0, 1000)`.",
    seeds={"data": 0, "weights": 0, "training": config.seed},
    figures={"validation loss": round(curves[-1].validation, 3)},
    intended_use="The tutorial on training.",
    limits="Four agents; radii from 0.7 to 1.3.",
)
save_pretrained(trained, folder / "circles", card)
again, read = from_pretrained(folder / "circles", featurise)
print(sorted(path.name for path in (folder / "circles").iterdir()), read["figures"])
