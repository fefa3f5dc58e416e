"""Training scenes of the tabletop: their generation, and reading them as arrays."""

from collections.abc import Sequence

import jax
import jax.numpy as jnp
import numpy as np

from deggflow.blocks import padded_batch
from deggflow.certificate import Certificate
from deggflow.files import StrPath
from deggflow.jsonl import InputError
from deggflow.redraw import Candidate, redraw_until_satisfied
from deggflow.train import Dataset

from .changes import random_conditions
from .codec import Pose, decode_exactly, encode
from .condition import SceneCondition, padded_size, take, to_arrays
from .formats import read_scenes
from .options import SceneRecipe
from .relax import relaxed_scenes
from .scene import Scene, finished
from .symmetry import wrap
from .verdict import judge

CHUNK = 512  # scenes relaxed at once
MAX_ATTEMPTS = 50  # random arrangements tried for one scene


def _attempt(
    conditions: Sequence[SceneCondition],
    keys: jax.Array,
    number: int,
    recipe: SceneRecipe,
    seed: int,
) -> list[Candidate[Scene]]:
    arrays = to_arrays(conditions)
    index = np.resize(np.arange(len(conditions)), padded_batch(len(conditions)))
    scene_keys = jax.vmap(lambda key: jax.random.fold_in(key, number))(keys)
    z, _ = relaxed_scenes(scene_keys[index], take(arrays, index), recipe.clearance)
    arrangements = [
        decode_exactly(state, c) for state, c in zip(np.asarray(z), conditions, strict=False)
    ]
    for poses in arrangements:
        poses[:, 2] = np.asarray(wrap(jnp.asarray(poses[:, 2])))
    out = []
    for condition, poses, verdict in zip(
        conditions, arrangements, judge(conditions, arrangements), strict=True
    ):
        roomy = verdict.min_margin >= recipe.spare
        reason = None if roomy else f"less than {recipe.spare} m to spare"
        certificate = Certificate(roomy, verdict.min_margin, verdict.violation, 1, reason)
        scene = Scene(condition, poses, certificate, seed)
        out.append(Candidate(scene, roomy, verdict.min_margin))
    return out


def make_scenes(size: int, first: int, count: int, recipe: SceneRecipe, seed: int) -> list[Scene]:
    """Scenes number `first` to `first + count - 1` of one size; each depends on its own number alone."""
    conditions = random_conditions(size, count, "default", seed, first)
    root = jax.random.fold_in(jax.random.key(seed), size)
    keys = jax.vmap(lambda k: jax.random.fold_in(root, k))(np.arange(first, first + count))
    candidates = redraw_until_satisfied(
        lambda index, number: _attempt(
            [conditions[k] for k in index], keys[np.asarray(index)], number, recipe, seed
        ),
        count,
        MAX_ATTEMPTS,
    )
    if not all(each.satisfied for each in candidates):
        raise InputError(
            f"no arrangement of {size} objects with {recipe.spare} m to spare in {MAX_ATTEMPTS} "
            "attempts; ask for less clearance"
        )
    return finished(candidates)


def load_dataset(path: StrPath) -> Dataset:
    """Scenes of a file as encoded training data; `InputError` if the file is invalid."""
    scenes = read_scenes(path)
    conditions = [scene.condition for scene in scenes]
    agents = padded_size(max(len(c.objects) for c in conditions))
    arrays = to_arrays(conditions, agents)
    poses = np.zeros((len(scenes), agents, 3))
    for row, scene in zip(poses, scenes, strict=True):
        row[: len(scene.poses)] = scene.poses
    z = jax.vmap(encode)(Pose(*np.moveaxis(poses.astype(np.float32), -1, 0)), arrays)
    return Dataset(z, arrays, arrays.mask)
