"""What a field from outside costs: one evaluation by JAX, by PyTorch inside JAX and by PyTorch alone, and whole scenes.

Usage: python benchmarks/foreign_models.py [--samples 1 128 500] [--scenes 128] [--threads 1] [--size 8] [--rounds 7]
"""

import time
from collections.abc import Callable
from dataclasses import dataclass
from typing import Any

import numpy as np
import torch
import tyro

from deggflow.app.session import prepare_jax


@dataclass(frozen=True)
class Settings:
    """What is timed."""

    samples: tuple[int, ...] = (1, 128, 500)  # evaluated together
    threads: int = 1  # of PyTorch; on a busy machine more of them wait for each other
    size: int = 8  # objects of a scene
    scenes: int = 128  # generated together
    evaluations: int = 30  # in a loop, of which each is a part
    rounds: int = 7
    seed: int = 0


def main(settings: Settings) -> None:
    prepare_jax()
    torch.set_num_threads(settings.threads)
    print(
        f"PyTorch {torch.__version__}, {settings.threads} threads; median and least of {settings.rounds} rounds in turn"
    )
    for samples in settings.samples:
        print(f"\none evaluation of {samples} samples of {settings.size} agents in 3-D, us")
        report(
            timed(evaluations(settings, samples), settings.rounds), 1e6 / settings.evaluations, 0
        )
    print(f"\n{settings.scenes} scenes of {settings.size} objects, s")
    made: dict[str, Any] = {}
    report(timed(scenes(settings, made), settings.rounds), 1.0, 2)
    apart = np.abs(made["nominal, JAX"].z - made["nominal, TorchField"].z).max()
    print(f"  nominal samples differ by {apart:.1e} at most")
    for name, count in satisfied(settings, made).items():
        print(f"  {name}: {count} of {settings.scenes} satisfied, first draw")


def timed(ways: dict[str, Callable[[], Any]], rounds: int) -> dict[str, list[float]]:
    """Seconds of each way, all of them in turn, so that what else the machine does falls on all."""
    taken: dict[str, list[float]] = {name: [] for name in ways}
    for way in ways.values():
        way()  # compiles
    for _ in range(rounds):
        for name, way in ways.items():
            start = time.perf_counter()
            way()
            taken[name].append(time.perf_counter() - start)
    return taken


def report(taken: dict[str, list[float]], unit: float, digits: int) -> None:
    """Median and least time of each way; on a busy machine the least says more."""
    for name, seconds in taken.items():
        median, least = unit * np.median(seconds), unit * min(seconds)
        print(f"  {name:40}{median:10.{digits}f}{least:10.{digits}f}", flush=True)


def nothing(x: Any, t: Any) -> Any:
    """A field that costs nothing by itself."""
    return x


def by_pure_callback(tau: Any, z: Any, condition: Any) -> Any:
    """The same, evaluated by NumPy."""
    import jax

    shape = jax.ShapeDtypeStruct(z.shape, z.dtype)
    return jax.pure_callback(
        lambda tau, z: np.asarray(z), shape, tau, z, vmap_method="broadcast_all"
    )


def perceptrons(size: int, seed: int) -> tuple[torch.nn.Module, Callable[[Any, Any], Any]]:
    """One of two hidden layers that takes a state and tau, in PyTorch and in JAX."""
    import jax
    import jax.numpy as jnp

    torch.manual_seed(seed)
    first, second, last = (
        torch.nn.Linear(*widths) for widths in ((size + 1, 64), (64, 64), (64, size))
    )
    mlp = torch.nn.Sequential(first, torch.nn.SELU(), second, torch.nn.SELU(), last).eval()
    weights = [jnp.asarray(one.detach().numpy()) for one in mlp.parameters()]

    def in_jax(x: Any, t: Any) -> Any:
        hidden = jnp.append(x, t)
        for weight, bias in zip(weights[:4:2], weights[1:4:2], strict=True):
            hidden = jax.nn.selu(weight @ hidden + bias)
        return weights[4] @ hidden + weights[5]

    return mlp, in_jax


@dataclass(frozen=True)
class Loop:
    """Evaluations one after another, from some states on."""

    evaluations: int
    tau: np.ndarray
    z: np.ndarray
    conditions: Any

    def in_jax(self, field: Any) -> Callable[[], Any]:
        """In a compiled program."""
        import jax

        def step(z: Any, condition: Any) -> Any:
            return z + 1e-3 * jax.vmap(field)(self.tau, z, condition)

        @jax.jit
        def loop(z: Any, condition: Any) -> Any:
            return jax.lax.fori_loop(0, self.evaluations, lambda _, z: step(z, condition), z)

        return lambda: jax.block_until_ready(loop(self.z, self.conditions))

    def in_torch(self, velocity: Callable[[Any, Any], Any]) -> Callable[[], Any]:
        """In PyTorch alone."""
        t = torch.from_numpy(self.tau)

        @torch.no_grad()
        def loop() -> Any:
            x = torch.from_numpy(self.z.copy())
            for _ in range(self.evaluations):
                x = x + 1e-3 * velocity(x, t)
            return x

        return loop


def evaluations(settings: Settings, samples: int) -> dict[str, Callable[[], Any]]:
    """Loops of as many evaluations as the settings say."""
    from deggflow.field.foreign import JaxField
    from deggflow.field.torch import TorchField, joined
    from deggflow.tasks.tabletop.changes import random_conditions
    from deggflow.tasks.tabletop.condition import to_arrays
    from deggflow.tasks.tabletop.field import load_field
    from deggflow.tasks.tabletop.generator import initial_noise
    from deggflow.tasks.tabletop.torch_field import load_torch_field, scene_arrays

    conditions = to_arrays(random_conditions(settings.size, samples, "changed", settings.seed))
    agents = conditions.mask.shape[1]
    z = initial_noise(settings.seed, np.arange(samples), 0)[:, :agents]
    tau = np.linspace(0, 1, samples, dtype=np.float32)
    loop = Loop(settings.evaluations, tau, z, conditions)
    mlp, same_mlp = perceptrons(3 * agents, settings.seed)
    scene = load_torch_field()
    arrays = {
        name: torch.from_numpy(np.array(value)) for name, value in scene_arrays(conditions).items()
    }
    return {
        "nothing, TorchField": loop.in_jax(TorchField(nothing)),
        "nothing, TorchField with memory lent": loop.in_jax(TorchField(nothing, lend=True)),
        "nothing, jax.pure_callback": loop.in_jax(by_pure_callback),
        "MLP 64-64, JAX": loop.in_jax(JaxField(same_mlp, flat=True)),
        "MLP 64-64, TorchField": loop.in_jax(TorchField(mlp, joined, flat=True)),
        "MLP 64-64, PyTorch alone": loop.in_torch(
            lambda x, t: joined(mlp, x.flatten(1), t).view_as(x)
        ),
        "tabletop, JAX": loop.in_jax(load_field()),
        "tabletop, TorchField": loop.in_jax(TorchField(scene, extras=scene_arrays)),
        "tabletop, PyTorch alone": loop.in_torch(lambda x, t: scene(x, t, **arrays)),
    }


def scenes(settings: Settings, made: dict[str, Any]) -> dict[str, Callable[[], Any]]:
    """Batches of scenes, 100 Euler steps each, guarded where they are guided; the last of each is left in `made`."""
    from deggflow.field.torch import TorchField
    from deggflow.tasks.tabletop.changes import random_conditions
    from deggflow.tasks.tabletop.field import load_field
    from deggflow.tasks.tabletop.generator import TabletopGenerator, initial_noise
    from deggflow.tasks.tabletop.requirements import tabletop_guidance
    from deggflow.tasks.tabletop.torch_field import load_torch_field, scene_arrays

    conditions = random_conditions(settings.size, settings.scenes, "changed", settings.seed)
    noise = initial_noise(settings.seed, np.arange(settings.scenes), 0)
    fields: dict[str, Any] = {
        "JAX": load_field(),
        "TorchField": TorchField(load_torch_field(), extras=scene_arrays),
    }

    def way(name: str, generator: TabletopGenerator) -> Callable[[], None]:
        return lambda: made.update({name: generator.batch(noise, conditions)})

    ways = {}
    for name, field in fields.items():
        for kind, guidance in (("nominal", None), ("guided", tabletop_guidance())):
            ways[f"{kind}, {name}"] = way(f"{kind}, {name}", TabletopGenerator(field, guidance))
    return ways


def satisfied(settings: Settings, made: dict[str, Any]) -> dict[str, int]:
    """Scenes that exact geometry finds satisfied."""
    from deggflow.tasks.tabletop.changes import random_conditions
    from deggflow.tasks.tabletop.verdict import judge

    conditions = random_conditions(settings.size, settings.scenes, "changed", settings.seed)
    return {
        name: sum(one.satisfied for one in judge(conditions, batch.poses))
        for name, batch in made.items()
    }


if __name__ == "__main__":
    main(tyro.cli(Settings))
