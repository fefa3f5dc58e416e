"""Two small training problems: a network that moves points, and a field of one weight."""

from functools import partial

import equinox as eqx
import jax
import numpy as np

from deggflow.train import Dataset, TrainingConfig, train

CONFIG = TrainingConfig(steps=400, batch=16, warmup=20, validate_every=20, average=0.9, seed=3)


class Shift(eqx.Module):
    """A small field for a small problem."""

    network: eqx.nn.MLP

    def __call__(self, tau, z, condition):
        return jax.vmap(lambda row: self.network(jax.numpy.append(row, tau)))(z)


def dataset(seed, samples):
    rng = np.random.default_rng(seed)
    z = (np.array([1.0, -1.0]) + 0.1 * rng.normal(size=(samples, 3, 2))).astype(np.float32)
    return Dataset(z, np.zeros(samples, np.float32), np.ones((samples, 3), bool))


def run(folder, on_progress=lambda curve: None):
    from deggflow.weights import save_weights

    field = Shift(eqx.nn.MLP(3, 2, 32, depth=2, key=jax.random.key(0)))
    trained, curves = train(
        field, dataset(0, 200), dataset(1, 50), CONFIG, folder, on_progress=on_progress
    )
    save_weights(folder / "end.safetensors", trained, {})
    return curves


def layers(width):
    return (eqx.nn.Linear(3, width, key=jax.random.key(0)),)


class Number(eqx.Module):
    """One weight, and whatever else tells fields apart."""

    weight: jax.Array
    table: jax.Array = eqx.field(default_factory=lambda: np.arange(2))
    scales: tuple = eqx.field(static=True, default=(1.0, 2.0))
    act: object = jax.nn.silu
    leaky: object = partial(jax.nn.leaky_relu, negative_slope=0.2)
    layers: tuple = eqx.field(default_factory=lambda: layers(4))

    def __call__(self, tau, z, condition):
        return self.weight * z


def number(value=5.0, **parts):
    return Number(jax.numpy.asarray(value), **parts)


def target(field, tau, x0, x1, condition, mask, aim=2.0):
    """Settles nowhere, as the noise is drawn anew at each step."""
    return jax.numpy.sum((field.weight - aim - x0) ** 2)


def shorter(steps=40, **settings):
    given = {"batch": 4, "learning_rate": 0.3, "warmup": 5, "average": 0.9, "validate_every": 10}
    return TrainingConfig(steps=steps, **{**given, **settings})


def train_number(folder, steps=40, *, field=None, samples=(8, 4), loss=target, **settings):
    config = settings.pop("config", None) or shorter(steps)
    sets = [dataset(k, count) for k, count in enumerate(samples)]
    return train(field or number(), *sets, config, folder, loss=loss, **settings)
