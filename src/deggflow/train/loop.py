"""The training loop: compiled programs, checkpoints, and resumption of the run in a folder."""

import json
import math
from collections.abc import Callable, Mapping, Sequence
from contextlib import nullcontext
from functools import partial
from hashlib import sha256
from itertools import pairwise
from pathlib import Path
from typing import Any, NamedTuple

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
import optax
from jaxtyping import Array, Float, Int, PRNGKeyArray

from deggflow.files import StrPath, write_atomically
from deggflow.flow import mac_loss
from deggflow.jsonl import InputError
from deggflow.locks import locked
from deggflow.shapes import Scalar

from . import checkpoints
from .devices import Devices
from .feed import stretch_length, stretches
from .folder import (
    VERSION,
    ConfigFile,
    check_same_run,
    config_file,
    curves_until,
    read_config,
    segments_with,
    write_curves,
)
from .identity import description
from .settings import Augment, Curve, Dataset, SampleLoss, TrainingConfig, check_samples
from .store import StoredDataset

_VALIDATION_KEY = 2**31 - 1  # folded into the seed's key; no training step reaches it


class TrainingState(NamedTuple):
    """Everything that changes during training, as arrays of a field without its static parts.

    Attributes:
        weights: Current weights.
        averaged: Averaged weights.
        optimizer: State of the optimizer.
        step: Number of completed steps.
    """

    weights: Any
    averaged: Any
    optimizer: Any
    step: Int[Array, ""]


def _optimizer(config: TrainingConfig, segments: Sequence[int]) -> optax.GradientTransformation:
    """AdamW with one warm-up and cosine decay per segment; its own step count determines the segment."""
    schedules = [
        optax.warmup_cosine_decay_schedule(
            0.0, config.learning_rate, min(config.warmup, steps // 10), steps, end_value=0.0
        )
        for steps in (end - start for start, end in pairwise((0, *segments)))
    ]
    schedule = optax.join_schedules(schedules, list(segments[:-1]))
    return optax.chain(
        optax.clip_by_global_norm(1.0), optax.adamw(schedule, weight_decay=config.weight_decay)
    )


def _averaged(averaged: Any, weights: Any, step: Int[Array, ""], decay: float) -> Any:
    """The mean of the weights after steps 1 to `step`, with weight decay^(step - k) for those after step k.

    This is Adam's debiased average (Kingma and Ba, 2015, sec. 3), written as an update of the average itself. The new
    weights enter with the share (1 - decay) / (1 - decay^step), which is one at the first step.
    """
    share = (1 - decay) / -jnp.expm1(step * math.log(decay)) if decay else 1.0
    return jax.tree.map(
        lambda old, new: (old + share * (new - old)).astype(old.dtype), averaged, weights
    )


def _batch_loss(
    field: Any, data: Dataset, key: PRNGKeyArray, loss: SampleLoss, augment: Augment | None
) -> Scalar:
    def sample_loss(key: PRNGKeyArray, x1: Array, condition: Any, mask: Array) -> Scalar:
        tau_key, noise_key, augment_key = jax.random.split(key, 3)
        if augment is not None:
            x1 = augment(augment_key, x1, condition)
        x0 = jax.random.normal(noise_key, x1.shape)
        return loss(field, jax.random.uniform(tau_key), x0, x1, condition, mask)

    keys = jax.random.split(key, data.z.shape[0])
    return jnp.mean(jax.vmap(sample_loss)(keys, data.z, data.condition, data.mask))


def _make_programs(
    static: Any,
    config: TrainingConfig,
    optimizer: optax.GradientTransformation,
    loss: SampleLoss,
    augment: Augment | None,
    devices: Devices,
) -> tuple[Callable[..., Any], Callable[..., Any]]:
    root = jax.random.key(config.seed)

    def step(
        data: Dataset, state: TrainingState, index: Int[Array, " batch"]
    ) -> tuple[TrainingState, Array]:
        # Batch, noise and tau depend on the step number only, so a resumed run continues exactly.
        loss_key = jax.random.split(jax.random.fold_in(root, state.step))[1]
        batch = devices.divided(jax.tree.map(lambda leaf: leaf[index], data))

        def of_weights(weights: Any) -> Scalar:
            return _batch_loss(eqx.combine(weights, static), batch, loss_key, loss, augment)

        value, gradient = jax.value_and_grad(of_weights)(state.weights)
        updates, optimizer_state = optimizer.update(gradient, state.optimizer, state.weights)
        weights = optax.apply_updates(state.weights, updates)
        averaged = _averaged(state.averaged, weights, state.step + 1, config.average)
        return TrainingState(weights, averaged, optimizer_state, state.step + 1), value

    @partial(jax.jit, donate_argnums=0)
    def advance(
        state: TrainingState, data: Dataset, index: Int[Array, "steps batch"]
    ) -> tuple[TrainingState, Float[Array, " steps"]]:
        return jax.lax.scan(partial(step, data), state, index)

    @jax.jit
    def validate(state: TrainingState, data: Dataset) -> Scalar:
        field = eqx.combine(state.averaged, static)
        return _batch_loss(field, data, jax.random.fold_in(root, _VALIDATION_KEY), loss, None)

    return advance, validate


def _draw_batches(
    config: TrainingConfig, samples: int, steps: int
) -> Callable[[int], Int[np.ndarray, "steps batch"]]:
    """Numbers of the samples of `steps` batches, by the first step: with replacement from all samples."""
    root = jax.random.key(config.seed)

    @jax.jit
    def draw(first: Int[Array, ""]) -> Int[Array, "steps batch"]:
        def one(step: Int[Array, ""]) -> Int[Array, " batch"]:
            key = jax.random.split(jax.random.fold_in(root, step))[0]
            return jax.random.randint(key, (config.batch,), 0, samples)

        return jax.vmap(one)(first + jnp.arange(steps))

    return lambda first: np.asarray(draw(jnp.asarray(first)))


def train(
    field: eqx.Module,
    training: Dataset | StoredDataset,
    validation: Dataset,
    config: TrainingConfig,
    folder: StrPath,
    *,
    identity: Mapping[str, Any] | None = None,
    loss: SampleLoss = mac_loss,
    augment: Augment | None = None,
    on_progress: Callable[[Curve], None] = lambda curve: None,
    devices: Sequence[jax.Device] | None = None,
) -> tuple[eqx.Module, list[Curve]]:
    """Trains a field, resumes an interrupted run in the same folder, or extends a finished run.

    A folder holds one run, which `config.json` identifies: settings, names of loss and augmentation, the data by
    content, the field's arrays by dtype and shape, and its other parts by value. Any difference raises an error that
    names it. Functions are compared by name, not by the values they close over; these values belong in `identity`. Data
    are compared bit for bit, so data that are recomputed must be identical.

    An interrupted run resumes from its last checkpoint, and ends with bitwise the same weights as an uninterrupted one.

    A finished run is extended by increasing `steps`. The learning rate was zero at its end, so the added steps have
    their own warm-up and cosine decay with the same peak (a warm restart: Loshchilov and Hutter, 2017). Weights, moments
    of AdamW and averaged weights continue from their last values. `segments` in `config.json` lists the step at which
    each segment ends. 40 steps extended to 80 are therefore a different run from 80 steps at once. The `steps` of an
    unfinished run can't be changed.

    Averaged weights are the mean of the weights after each step so far, with weight `average`^k for those k steps back.
    The initial weights are not included.

    Args:
        field: Defines the architecture and the initial weights; it is not modified.
        training: Training data, any number of samples; in memory, or in a file, with the same result.
        validation: Held-out data, any number of samples.
        config: Settings.
        folder: Folder for `config.json`, `curves.csv` and checkpoints.
        identity: Further values that identify the run (JSON values by name), compared like the settings.
        loss: Loss of one sample, L_MAC by default.
        augment: Symmetry of the data, applied to x1 with a key and the condition.
        on_progress: Called at each point of the curves, and with the last point of a resumed run.
        devices: Divide each batch; a run may be resumed on others. By default one device, or all if `jax.distributed`
            connects several processes, of which the first one writes the folder.

    Raises:
        InputError: The folder holds another run or a run of an older version, its files are damaged, or another process
            is training in it.
        ValueError: Parts of the data have different numbers of samples, `identity` has values that JSON cannot
            represent, or the devices can't divide a batch equally.

    Returns:
        The field with averaged weights, and the curves from the first step on.
    """
    folder = Path(folder)
    placement = Devices(devices)
    if config.batch % placement.count:
        raise ValueError(
            f"`batch` must be a multiple of the number of devices, {placement.count}; got {config.batch}."
        )
    validation = jax.tree.map(jnp.asarray, validation)
    check_samples("validation", validation)
    if not isinstance(training, StoredDataset):
        in_memory: Dataset = jax.tree.map(jnp.asarray, training)
        check_samples("training", in_memory)
        training = in_memory
    settings = description(field, training, validation, config, identity or {}, loss, augment)
    folder.mkdir(parents=True, exist_ok=True)
    with locked(folder / "config.json") if placement.writes else nullcontext():
        return _run(
            field,
            training,
            validation,
            config,
            folder,
            settings,
            loss,
            augment,
            on_progress,
            placement,
        )


def _run(
    field: eqx.Module,
    training: Dataset | StoredDataset,
    validation: Dataset,
    config: TrainingConfig,
    folder: Path,
    settings: Mapping[str, Any],
    loss: SampleLoss,
    augment: Augment | None,
    on_progress: Callable[[Curve], None],
    devices: Devices,
) -> tuple[eqx.Module, list[Curve]]:
    """`train` in a folder that no other process writes to."""
    path, checkpoint_folder = folder / "config.json", folder / "checkpoints"
    stored = _stored_config(path, checkpoint_folder, settings)
    run = sha256(json.dumps(settings, sort_keys=True).encode()).hexdigest()
    last_step = checkpoints.last_step(checkpoint_folder)
    segments = segments_with(path, stored, config.steps, last_step)
    curves = curves_until(folder / "curves.csv", last_step, config.validate_every)
    optimizer = _optimizer(config, segments)
    state, static = _initial_state(field, optimizer)
    if last_step:
        state = checkpoints.restore(checkpoint_folder, last_step, state, run)
    contents = {"version": VERSION, "segments": segments, **settings}
    if contents != stored and devices.writes:
        write_atomically(path, json.dumps(contents, indent=2) + "\n")
    own_config = config_file(path)
    advance, validate = _make_programs(static, config, optimizer, loss, augment, devices)
    for curve in curves[-1:]:
        on_progress(curve)
    samples = training.count if isinstance(training, StoredDataset) else len(training.mask)
    length = stretch_length(training, config.validate_every, config.batch)
    draw = _draw_batches(config, samples, length)
    state, validation = devices.replicate((state, validation))
    losses: list[np.ndarray] = []
    for stretch in stretches(training, range(last_step, config.steps, length), draw, devices):
        state, some = advance(state, *stretch)
        losses.append(np.asarray(some))
        if int(state.step) % config.validate_every:
            continue
        held_out = float(validate(state, validation))
        curves.append(Curve(int(state.step), float(np.mean(np.concatenate(losses))), held_out))
        losses = []
        if devices.writes:
            _save(folder, own_config, curves, state, run)
        on_progress(curves[-1])
    return eqx.combine(state.averaged, static), curves


def _stored_config(
    path: Path, checkpoint_folder: Path, settings: Mapping[str, Any]
) -> dict[str, Any] | None:
    """What the folder's `config.json` says of the same run; None in a folder without a run."""
    stored = read_config(path)
    if stored is not None:
        check_same_run(path, stored, settings)
    elif any(checkpoint_folder.glob("*")):
        raise InputError(
            "does not exist, and there are checkpoints of an unknown run beside it; choose another folder",
            file=path,
        )
    return stored


def _initial_state(
    field: eqx.Module, optimizer: optax.GradientTransformation
) -> tuple[TrainingState, Any]:
    """The state before the first step, and the field's static parts."""
    weights, static = eqx.partition(field, eqx.is_inexact_array)
    weights = jax.tree.map(jnp.copy, weights)  # the caller's arrays are not donated
    averaged = jax.tree.map(jnp.zeros_like, weights)
    return TrainingState(weights, averaged, optimizer.init(weights), jnp.asarray(0)), static


def _save(
    folder: Path, own_config: ConfigFile, curves: list[Curve], state: TrainingState, run: str
) -> None:
    """Writes curves and a checkpoint, unless the folder is no longer this run's."""
    own_config.check()
    write_curves(folder / "curves.csv", curves)
    checkpoints.save(folder / "checkpoints", int(state.step), state, run)
    try:
        own_config.check()
    except InputError:
        checkpoints.remove(folder / "checkpoints", int(state.step))
        raise
