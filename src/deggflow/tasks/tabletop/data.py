"""Training scenes of the tabletop: made, written as scenes, read back as arrays."""

from collections.abc import Callable, Sequence
from pathlib import Path
from typing import NamedTuple

import jax
import jax.numpy as jnp
import numpy as np

from deggflow.blocks import padded_batch
from deggflow.certificate import Certificate
from deggflow.files import StrPath
from deggflow.jsonl import InputError
from deggflow.output import ResumableOutput, forget
from deggflow.redraw import Candidate, redraw_until_satisfied
from deggflow.train import Dataset

from .changes import random_conditions
from .codec import Pose, decode_exactly, encode
from .condition import SceneCondition, padded_size, take, to_arrays
from .formats import read_scenes
from .relax import relaxed_scenes
from .scene import Scene, finished
from .symmetry import wrap
from .verdict import judge

CHUNK = 512  # scenes relaxed at once
MAX_ATTEMPTS = 50  # random arrangements tried for one scene


class Recipe(NamedTuple):
    """What the training scenes are like."""

    sizes: tuple[int, ...] = (4, 5, 6)
    training: int = 4_000  # scenes of each size
    validation: int = 400
    clearance: float = 0.10  # m, aimed at by the relaxation
    spare: float = 0.015  # m, least margin of a scene that is kept
    seed: int = 0


def _attempt(
    conditions: Sequence[SceneCondition], keys: jax.Array, number: int, recipe: Recipe, seed: int
) -> list[Candidate[Scene]]:
    arrays = to_arrays(conditions)
    index = np.resize(np.arange(len(conditions)), padded_batch(len(conditions)))
    drawn = jax.vmap(lambda key: jax.random.fold_in(key, number))(keys)
    z, _ = relaxed_scenes(drawn[index], take(arrays, index), recipe.clearance)
    kept = [decode_exactly(state, c) for state, c in zip(np.asarray(z), conditions, strict=False)]
    for poses in kept:
        poses[:, 2] = np.asarray(wrap(jnp.asarray(poses[:, 2])))
    out = []
    for condition, poses, verdict in zip(conditions, kept, judge(conditions, kept), strict=True):
        roomy = verdict.min_margin >= recipe.spare
        reason = None if roomy else f"less than {recipe.spare} m to spare"
        certificate = Certificate(roomy, verdict.min_margin, verdict.violation, 1, reason)
        scene = Scene(condition, poses, certificate, seed)
        out.append(Candidate(scene, roomy, verdict.min_margin))
    return out


def make_scenes(size: int, first: int, count: int, recipe: Recipe, seed: int) -> list[Scene]:
    """Scenes number `first` to `first + count - 1` of one size; each depends on its own number alone."""
    conditions = random_conditions(size, count, "default", seed, first)
    root = jax.random.fold_in(jax.random.key(seed), size)
    keys = jax.vmap(lambda k: jax.random.fold_in(root, k))(np.arange(first, first + count))
    drawn = redraw_until_satisfied(
        lambda index, number: _attempt(
            [conditions[k] for k in index], keys[np.asarray(index)], number, recipe, seed
        ),
        count,
        MAX_ATTEMPTS,
    )
    if not all(each.satisfied for each in drawn):
        raise InputError(
            f"no arrangement of {size} objects with {recipe.spare} m to spare in {MAX_ATTEMPTS} "
            "attempts; ask for less clearance"
        )
    return finished(drawn)


def write_data(
    folder: StrPath,
    recipe: Recipe,
    on_progress: Callable[[int, int], None] = lambda done, total: None,
) -> None:
    """Writes `training.jsonl` and `validation.jsonl`, or completes what a killed call left there."""
    folder = Path(folder)
    folder.mkdir(parents=True, exist_ok=True)
    parts = (
        ("training", recipe.training, 2 * recipe.seed),
        ("validation", recipe.validation, 2 * recipe.seed + 1),
    )
    total = len(recipe.sizes) * (recipe.training + recipe.validation)
    settings = {**recipe._asdict(), "sizes": list(recipe.sizes)}
    done = 0
    for name, count, seed in parts:
        path, lines = folder / f"{name}.jsonl", count * len(recipe.sizes)
        with ResumableOutput(path, settings, count=lines, on_row=forget) as output:
            finished = output.done
            done += finished
            on_progress(done, total)
            for position, size in enumerate(recipe.sizes):
                have = min(max(0, finished - position * count), count)
                if have == count:
                    continue
                # A chunk that a kill cut in two is made again whole, as another batch rounds differently.
                for start in range(have // CHUNK * CHUNK, count, CHUNK):
                    scenes = make_scenes(size, start, min(CHUNK, count - start), recipe, seed)
                    scenes = scenes[max(0, have - start) :]
                    output.append([scene.to_json() for scene in scenes])
                    done += len(scenes)
                    on_progress(done, total)


def load_dataset(path: StrPath) -> Dataset:
    """Scenes of a file as encoded training data; `InputError` if the file is not as it should be."""
    scenes = read_scenes(path)
    conditions = [scene.condition for scene in scenes]
    agents = padded_size(max(len(c.objects) for c in conditions))
    arrays = to_arrays(conditions, agents)
    poses = np.zeros((len(scenes), agents, 3))
    for row, scene in zip(poses, scenes, strict=True):
        row[: len(scene.poses)] = scene.poses
    z = jax.vmap(encode)(Pose(*np.moveaxis(poses.astype(np.float32), -1, 0)), arrays)
    return Dataset(z, arrays, arrays.mask)
