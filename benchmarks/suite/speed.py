"""How much of what the machine can do the field does: its FLOP/s over those of plain matrix products.

Both are taken in a process of their own, pinned to some of the cores before JAX counts them.
"""

import json
import os
import subprocess
import sys
from collections.abc import Iterator, Sequence
from functools import partial
from pathlib import Path
from typing import Any

from deggflow.blocks import blocks, map_blocks

from .clock import Call, Patience, in_turn
from .rows import Row, Spread, Times, spread

HOME = Path(__file__).parents[1]  # where this package is found

EDGES = (256, 512, 1024, 2048)  # of the square matrices
SIZE, SEED = 8, 0
EVALUATIONS = 10  # of the field in one call, as in a generation


def speed(patience: Patience, quick: bool) -> Iterator[Row]:
    """The field's share of the machine's peak, on all cores and on one."""
    batches = (1, 32) if quick else (1, 512)
    for cores in sorted({1, available_cores()}):
        yield from _rows(_measured_apart(cores, batches, patience), cores, patience)


def measure(batches: Sequence[int], patience: Patience) -> dict[str, Any]:
    """Seconds and FLOPs of matrix products and of the field, on the cores that this process may use."""
    import jax
    import jax.numpy as jnp

    from deggflow.tasks.tabletop.field import load_field

    calls: dict[str, Call] = {}
    flops: dict[str, float] = {}
    reported: dict[str, float] = {}
    product = jax.jit(jnp.matmul)
    for edge in EDGES:
        a, b = (jax.random.normal(jax.random.key(k), (edge, edge)) for k in (0, 1))
        name = f"matmul {edge}"
        calls[name] = partial(_waited, product, a, b)
        flops[name] = 2.0 * edge**3
    for batch in batches:
        run, given = _field(batch)
        name = f"field {batch}"
        # As generators do: in blocks, one core each.
        parts = [jax.tree.map(lambda leaf, k=k: leaf[k], given) for k in blocks(batch)]
        calls[name] = partial(_side_by_side, run, parts)
        flops[name] = EVALUATIONS * _field_flops(batch)
        # XLA counts every operation, features and activations as well; on some backends it can't see inside products.
        one = jax.jit(partial(_slope, load_field()))
        counted = one.lower(jnp.asarray(0.5), *given).cost_analysis().get("flops", 0.0)
        reported[name] = EVALUATIONS * float(counted)
    return {"seconds": in_turn(calls, patience), "flops": flops, "reported": reported}


def _waited(run: Any, *given: Any) -> None:
    run(*given).block_until_ready()


def _side_by_side(run: Any, parts: Sequence[Any]) -> None:
    map_blocks(lambda part: _waited(run, *part), parts, compiled=True)


def _field(batch: int) -> tuple[Any, tuple[Any, ...]]:
    """Some steps along the field, compiled, and the batch of scenes they begin with."""
    import jax
    import jax.numpy as jnp
    import numpy as np

    from deggflow.tasks.tabletop.changes import random_conditions
    from deggflow.tasks.tabletop.condition import to_arrays
    from deggflow.tasks.tabletop.field import load_field
    from deggflow.tasks.tabletop.generator import initial_noise

    field = load_field()
    conditions = to_arrays(random_conditions(SIZE, batch, "changed", SEED))
    z = jnp.asarray(initial_noise(SEED, np.arange(batch), 0)[:, :SIZE])

    @jax.jit
    def run(z: Any, condition: Any) -> Any:
        def step(k: Any, z: Any) -> Any:
            return z + _slope(field, k / EVALUATIONS, z, condition) / EVALUATIONS

        return jax.lax.fori_loop(0, EVALUATIONS, step, z)

    return run, (z, jax.tree.map(jnp.asarray, conditions))


def _slope(field: Any, tau: Any, z: Any, condition: Any) -> Any:
    import jax

    return jax.vmap(partial(field, tau))(z, condition)


def _field_flops(batch: int) -> float:
    """Of the products with the field's weights alone: what no way to evaluate it can leave out."""
    from deggflow.tasks.tabletop.field import load_field

    field = load_field()

    def of(*layers: Any) -> int:
        return sum(2 * layer.weight.size for layer in layers)

    per_agent = of(field.embed, *field.head.layers)
    per_agent += sum(of(r.receiver, r.sender, r.inner, r.outer) for r in field.rounds)
    per_pair = sum(of(r.pair) for r in field.rounds)
    return float(batch * SIZE * (per_agent + SIZE * per_pair))


def _measured_apart(cores: int, batches: Sequence[int], patience: Patience) -> dict[str, Any]:
    """`measure` in a process that is pinned to some of the cores before JAX counts them."""
    given = [str(cores), str(patience.seconds), str(patience.most), *map(str, batches)]
    command = [sys.executable, "-m", "suite.speed", *given]
    out = subprocess.run(command, cwd=HOME, stdout=subprocess.PIPE, text=True, check=True)
    found: dict[str, Any] = json.loads(out.stdout.splitlines()[-1])
    return found


def _rows(found: dict[str, Any], cores: int, patience: Patience) -> Iterator[Row]:
    seconds: Times = found["seconds"]
    flops: dict[str, float] = found["flops"]
    where = f"{cores} core{'s' if cores > 1 else ''}"
    best = min((f"matmul {edge}" for edge in EDGES), key=lambda n: min(seconds[n]) / flops[n])
    peak = f"speed/{cores}/peak"
    for name in (best, *found["reported"]):
        ms = 1000 * sorted(seconds[name])[len(seconds[name]) // 2]
        figures = {"GFLOP/s": flops[name] / (1e6 * ms)}
        if name == best:
            yield Row(
                peak, f"float32 matrix product {name.split()[1]}, {where}", ms, figures=figures
            )
            continue
        batch = int(name.split()[1])
        # Of FLOP/s, so the other way round than of times.
        share: Spread = spread(seconds[best], seconds[name], flops[name] / flops[best])
        figures["GFLOP in products"] = flops[name] / 1e9
        figures["GFLOP as XLA counts all"] = found["reported"][name] / 1e9
        what = f"{EVALUATIONS} evaluations of the field, N = {SIZE}, batch {batch} in blocks, {where}: share of that peak"
        yield Row(f"speed/{cores}/field {batch}", what, ms, batch, peak, share, "", figures)


def available_cores() -> int:
    """How many cores this process may use."""
    return (
        len(os.sched_getaffinity(0)) if hasattr(os, "sched_getaffinity") else (os.cpu_count() or 1)
    )


def main() -> None:
    """The process that is pinned."""
    cores, seconds, most, *batches = sys.argv[1:]
    if hasattr(os, "sched_setaffinity"):
        os.sched_setaffinity(0, sorted(os.sched_getaffinity(0))[: int(cores)])
    from deggflow.app.session import prepare_jax

    prepare_jax()
    patience = Patience(float(seconds), 3, int(most))
    print(json.dumps(measure([int(batch) for batch in batches], patience)))


if __name__ == "__main__":
    main()
