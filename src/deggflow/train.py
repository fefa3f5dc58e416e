"""Training of nominal fields: AdamW, cosine schedule, averaged weights, exact resume after a kill."""

import csv
import json
from collections.abc import Callable, Mapping
from dataclasses import asdict, dataclass
from functools import partial
from pathlib import Path
from typing import Any, NamedTuple

import equinox as eqx
import jax
import jax.numpy as jnp
import optax
import orbax.checkpoint as ocp
from jaxtyping import Array, Bool, Float, Int, PRNGKeyArray

from .files import write_atomically
from .flow import mac_loss
from .jsonl import InputError

SampleLoss = Callable[..., Float[Array, ""]]
"""Loss of one sample: (field, tau, x0, x1, condition, mask) -> scalar, as `mac_loss`."""
Augment = Callable[[PRNGKeyArray, Float[Array, "agents dim"], Any], Float[Array, "agents dim"]]

_VALIDATION_KEY = 2**31 - 1  # folded into the seed's key; no training step reaches it


class Dataset(NamedTuple):
    """Encoded data with its conditions; all leaves have a leading sample axis."""

    z: Float[Array, "samples agents dim"]
    condition: Any
    mask: Bool[Array, "samples agents"]


@dataclass(frozen=True)
class TrainingConfig:
    """How a field is trained. The last step's averaged weights are the result."""

    steps: int = 50_000
    batch: int = 256
    learning_rate: float = 1.5e-3  # peak of the cosine schedule
    warmup: int = 500  # steps
    weight_decay: float = 1e-4
    average: float = 0.999  # decay of the exponential moving average of the weights
    seed: int = 0
    validate_every: int = 500  # steps between points of the curves and checkpoints

    def __post_init__(self) -> None:
        if self.steps % self.validate_every or self.steps <= 0:
            raise ValueError(
                f"`steps` must be a positive multiple of `validate_every` ({self.validate_every}), "
                f"as checkpoints are written there; got {self.steps}."
            )


class TrainingState(NamedTuple):
    """Everything that changes while training; the arrays of a field, not the field."""

    weights: Any
    averaged: Any
    optimizer: Any
    step: Int[Array, ""]


class Curve(NamedTuple):
    """One point of the training curves."""

    step: int
    training: float  # mean loss since the point before
    validation: float  # loss of the averaged weights on held-out data


def _optimizer(config: TrainingConfig) -> optax.GradientTransformation:
    schedule = optax.warmup_cosine_decay_schedule(
        0.0,
        config.learning_rate,
        min(config.warmup, config.steps // 10),
        config.steps,
        end_value=0.0,
    )
    return optax.chain(
        optax.clip_by_global_norm(1.0), optax.adamw(schedule, weight_decay=config.weight_decay)
    )


def _batch_loss(
    field: Any, data: Dataset, key: PRNGKeyArray, loss: SampleLoss, augment: Augment | None
) -> Float[Array, ""]:
    def one(key: PRNGKeyArray, x1: Array, condition: Any, mask: Array) -> Float[Array, ""]:
        tau_key, noise_key, augment_key = jax.random.split(key, 3)
        if augment is not None:
            x1 = augment(augment_key, x1, condition)
        x0 = jax.random.normal(noise_key, x1.shape)
        return loss(field, jax.random.uniform(tau_key), x0, x1, condition, mask)

    keys = jax.random.split(key, data.z.shape[0])
    return jnp.mean(jax.vmap(one)(keys, data.z, data.condition, data.mask))


def _make_programs(
    static: Any, config: TrainingConfig, loss: SampleLoss, augment: Augment | None
) -> tuple[Callable[..., Any], Callable[..., Any]]:
    optimizer = _optimizer(config)
    root = jax.random.key(config.seed)

    def step(data: Dataset, state: TrainingState, _: None) -> tuple[TrainingState, Array]:
        # The step number alone decides the batch, the noise and tau: resuming repeats nothing.
        index_key, loss_key = jax.random.split(jax.random.fold_in(root, state.step))
        index = jax.random.randint(index_key, (config.batch,), 0, data.z.shape[0])
        batch = jax.tree.map(lambda leaf: leaf[index], data)

        def of_weights(weights: Any) -> Float[Array, ""]:
            return _batch_loss(eqx.combine(weights, static), batch, loss_key, loss, augment)

        value, gradient = jax.value_and_grad(of_weights)(state.weights)
        updates, optimizer_state = optimizer.update(gradient, state.optimizer, state.weights)
        weights = optax.apply_updates(state.weights, updates)
        averaged = optax.incremental_update(weights, state.averaged, 1 - config.average)
        return TrainingState(weights, averaged, optimizer_state, state.step + 1), value

    @partial(jax.jit, donate_argnums=0)
    def advance(state: TrainingState, data: Dataset) -> tuple[TrainingState, Float[Array, ""]]:
        state, losses = jax.lax.scan(partial(step, data), state, None, length=config.validate_every)
        return state, jnp.mean(losses)

    @jax.jit
    def validate(state: TrainingState, data: Dataset) -> Float[Array, ""]:
        field = eqx.combine(state.averaged, static)
        return _batch_loss(field, data, jax.random.fold_in(root, _VALIDATION_KEY), loss, None)

    return advance, validate


def read_curves(path: Path) -> list[Curve]:
    """The training curves of a run; none if the file does not exist."""
    if not path.exists():
        return []
    with path.open(newline="") as file:
        return [
            Curve(int(row["step"]), float(row["training"]), float(row["validation"]))
            for row in csv.DictReader(file)
        ]


def _write_curves(path: Path, curves: list[Curve]) -> None:
    lines = [
        ",".join(Curve._fields),
        *(f"{c.step},{c.training!r},{c.validation!r}" for c in curves),
    ]
    write_atomically(path, "\n".join(lines) + "\n")


def _check_same_run(folder: Path, config: TrainingConfig, identity: Mapping[str, Any]) -> None:
    path, wanted = folder / "config.json", {**asdict(config), **identity}
    if path.exists():
        found = json.loads(path.read_text())
        changed = [name for name in wanted if found.get(name) != wanted[name]]
        if changed:
            name = changed[0]
            raise InputError(
                f"a run with `{name}` = {found.get(name)} was begun here, now `{name}` = "
                f"{wanted[name]}; resume it unchanged or choose another folder",
                file=path,
            )
    write_atomically(path, json.dumps(wanted, indent=2) + "\n")


def train(
    field: eqx.Module,
    training: Dataset,
    validation: Dataset,
    config: TrainingConfig,
    folder: Path,
    *,
    identity: Mapping[str, Any] | None = None,
    loss: SampleLoss = mac_loss,
    augment: Augment | None = None,
    on_progress: Callable[[Curve], None] = lambda curve: None,
) -> tuple[eqx.Module, list[Curve]]:
    """Trains a field, or goes on where a killed run in the same folder stopped.

    Args:
        field: Freshly initialised field; decides architecture and initial weights.
        training: Training data.
        validation: Held-out data.
        config: Settings; a folder holds one run and refuses another configuration.
        folder: Receives `config.json`, `curves.csv` and checkpoints.
        identity: What else makes this run this run (JSON values), checked like the settings.
        loss: Loss of one sample, L_MAC by default.
        augment: Symmetry of the data, applied to x1 with a key and the condition.
        on_progress: Called at each point of the curves.

    Raises:
        InputError: The folder holds a run with other settings.

    Returns:
        The field with averaged weights, and the curves.
    """
    folder.mkdir(parents=True, exist_ok=True)
    _check_same_run(folder, config, identity or {})
    weights, static = eqx.partition(field, eqx.is_inexact_array)
    averaged = jax.tree.map(jnp.copy, weights)
    state = TrainingState(weights, averaged, _optimizer(config).init(weights), jnp.asarray(0))
    advance, validate = _make_programs(static, config, loss, augment)
    training, validation = jax.tree.map(jnp.asarray, (training, validation))
    options = ocp.CheckpointManagerOptions(max_to_keep=2, enable_async_checkpointing=False)
    with ocp.CheckpointManager((folder / "checkpoints").resolve(), options=options) as manager:
        latest = manager.latest_step()
        if latest is not None:
            state = manager.restore(latest, args=ocp.args.StandardRestore(state))
        # A kill between the curve and its checkpoint leaves a point that is about to be made again.
        curves = [c for c in read_curves(folder / "curves.csv") if c.step <= int(state.step)]
        for curve in curves[-1:]:
            on_progress(curve)
        while int(state.step) < config.steps:
            state, mean_loss = advance(state, training)
            held_out = float(validate(state, validation))
            curves.append(Curve(int(state.step), float(mean_loss), held_out))
            _write_curves(folder / "curves.csv", curves)
            manager.save(int(state.step), args=ocp.args.StandardSave(state))
            on_progress(curves[-1])
    return eqx.combine(state.averaged, static), curves
