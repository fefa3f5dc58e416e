"""Training scenes of the tabletop: their generation, and reading them as arrays."""

from collections.abc import Iterator, Sequence
from itertools import islice
from pathlib import Path

import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Float

from deggflow.blocks import padded_batch
from deggflow.certificate import Certificate
from deggflow.files import StrPath
from deggflow.jsonl import InputError
from deggflow.locks import locked
from deggflow.redraw import Candidate, finished, redraw_until_satisfied
from deggflow.tables import longest_list, table_rows
from deggflow.train import Dataset, StoredDataset
from deggflow.train.store import is_stored, store

from .changes import random_conditions
from .codec import Pose, decode_exactly, encode
from .condition import SceneCondition, padded_size, take, to_arrays
from .formats import parse_condition, parse_poses, read_scenes
from .library import MAX_OBJECTS
from .lines import SceneLine
from .options import SceneRecipe
from .relax import relaxed_scenes
from .scene import Scene
from .symmetry import wrap
from .verdict import judge

CHUNK = 512  # scenes relaxed at once
MAX_ATTEMPTS = 50  # random arrangements tried for one scene
STORED_AT_ONCE = 2048  # scenes

Arrangement = tuple[SceneCondition, Float[np.ndarray, "_ 3"]]
"""A condition and its objects' poses; m and rad."""


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
    agents = padded_size(max(len(scene.condition.objects) for scene in scenes))
    return _encoded([(scene.condition, scene.poses) for scene in scenes], agents)


def _encoded(scenes: Sequence[Arrangement], agents: int) -> Dataset:
    arrays = to_arrays([condition for condition, _ in scenes], agents)
    poses = np.zeros((len(scenes), agents, 3))
    for row, (_, own) in zip(poses, scenes, strict=True):
        row[: len(own)] = own
    z = jax.vmap(encode)(Pose(*np.moveaxis(poses.astype(np.float32), -1, 0)), arrays)
    return Dataset(z, arrays, arrays.mask)


def stored_dataset(path: StrPath, out: Path) -> StoredDataset:
    """Scenes of a table as encoded training data in a file, which is written unless it holds them already.

    Args:
        path: The table; only its columns `condition` and `objects` are read.
        out: File of records.

    Raises:
        InputError: The table can't be read, or holds an invalid scene.
    """
    most = longest_list(path, "condition.objects")
    if not 1 <= most <= MAX_OBJECTS:
        raise InputError(
            f"scenes to train on have 1 to {MAX_OBJECTS} objects; got {most}", file=path
        )
    agents, status = padded_size(most), Path(path).stat()
    source = {"bytes": status.st_size, "changed": status.st_mtime_ns, "agents": agents}
    out.parent.mkdir(parents=True, exist_ok=True)
    with locked(out, wait=True):  # processes that train together share the file
        if not is_stored(out, source):
            chunks = (_encoded(some, agents) for some in _batches(_arrangements(path)))
            store(out, chunks, source)
    first = list(islice(_arrangements(path), 1))
    return StoredDataset(out, _encoded(first, agents))


def _arrangements(path: StrPath) -> Iterator[Arrangement]:
    for number, row in enumerate(table_rows(path, SceneLine, ["condition", "objects"]), start=1):
        try:
            condition = parse_condition(row["condition"], "condition")
            yield condition, parse_poses(row["objects"], condition)
        except InputError as error:
            raise InputError(error.reason, file=path, line=number, field=error.field) from None


def _batches(scenes: Iterator[Arrangement]) -> Iterator[list[Arrangement]]:
    while some := list(islice(scenes, STORED_AT_ONCE)):
        yield some
