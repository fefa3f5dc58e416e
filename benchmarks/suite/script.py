"""Guided scenes against `plain_torch.py`, a script in PyTorch that does the same with the same weights."""

import importlib.util
from collections.abc import Iterator
from functools import partial
from typing import Any

import jax
import numpy as np

from deggflow import EveryStep
from deggflow.tasks.tabletop.changes import random_conditions
from deggflow.tasks.tabletop.condition import TabletopCondition, to_arrays
from deggflow.tasks.tabletop.field import SPREAD, load_field
from deggflow.tasks.tabletop.generator import TabletopGenerator, initial_noise
from deggflow.tasks.tabletop.requirements import POOLED, tabletop_guidance

from .clock import Call, Kept, Patience, in_turn
from .rows import Row, Way, rows_of

SIZE, SEED = 8, 0
CHECKED = 16  # scenes that are generated in float64 as well


def script(patience: Patience, quick: bool) -> Iterator[Row]:
    """The script's time over ours, for a scene alone and for many."""
    if importlib.util.find_spec("torch") is None:
        yield Row("script", "guided scenes, plain PyTorch", note="not installed")
        return
    field = load_field()
    paper = tabletop_guidance(POOLED, reanchored=False)
    ours = {
        "fixed": TabletopGenerator(field, paper, drift=EveryStep(), guard=None),
        "guarded": TabletopGenerator(field, tabletop_guidance()),
    }
    for batch in (1, 16) if quick else (1, 512):
        yield from _compared(ours, batch, patience, quick)


def _compared(
    ours: dict[str, TabletopGenerator], batch: int, patience: Patience, quick: bool
) -> list[Row]:
    conditions, noise = _given(batch)
    plain = plain_call(noise, conditions, ours["fixed"].grid)
    threads = _best_threads(plain, quick)
    calls = {name: Kept(partial(way.draw, noise, conditions)) for name, way in ours.items()}
    calls["torch"] = Kept(partial(_with_threads, threads, plain))
    name = {key: f"script/{batch}/{key}" for key in calls}
    where = f"guided scenes, N = {SIZE}, batch {batch}"
    ways = {
        name["fixed"]: Way(f"{where}, ours, fixed steps", batch),
        name["guarded"]: Way(f"{where}, ours, as shipped", batch, name["fixed"]),
        name["torch"]: Way(
            f"{where}, plain PyTorch", batch, name["fixed"], f"{threads} of PyTorch's threads"
        ),
    }
    times = in_turn({name[key]: call for key, call in calls.items()}, patience)
    apart = np.abs(calls["torch"].result - calls["fixed"].result.z).max(axis=(1, 2))
    figures = {
        "apart from ours by at most": float(apart.max()),
        "share within 1e-3": float((apart <= 1e-3).mean()),
        "apart in float64": _apart_in_float64(min(batch, CHECKED)),
    }
    return rows_of(ways, times, {name["torch"]: figures})


def _given(batch: int) -> tuple[TabletopCondition, np.ndarray]:
    """Scenes and their z(0)."""
    conditions = to_arrays(random_conditions(SIZE, batch, "changed", SEED))
    return conditions, initial_noise(SEED, np.arange(batch), 0)[:, :SIZE]


def _best_threads(call: Call, quick: bool) -> int:
    """One or as many as PyTorch would take: where products are small, or the machine busy, its threads wait for each other."""
    import torch

    usual = torch.get_num_threads()
    if quick or usual == 1:
        return 1
    times = in_turn(
        {str(threads): partial(_with_threads, threads, call) for threads in (1, usual)},
        Patience(seconds=1.0, least=2, most=10),
    )
    return int(min(times, key=lambda threads: min(times[threads])))


def _with_threads(threads: int, call: Call) -> Any:
    import torch

    usual = torch.get_num_threads()
    torch.set_num_threads(threads)
    try:
        return call()
    finally:
        torch.set_num_threads(usual)


def _apart_in_float64(batch: int) -> float:
    """Largest difference of any sample, both ways in float64: what float32 shows beyond it is rounding.

    Inputs in proportion to 1 / |ell| make some scenes follow rounding: it grows a hundred thousand times on the way.
    """
    conditions, noise = _given(batch)
    with jax.enable_x64(True):
        wide = jax.tree.map(
            lambda leaf: leaf.astype(np.float64) if leaf.dtype == np.float32 else leaf, conditions
        )
        guidance = tabletop_guidance(POOLED, reanchored=False)
        ours = TabletopGenerator(load_field(), guidance, drift=EveryStep(), guard=None)
        z = noise.astype(np.float64)
        made = ours.draw(z, wide).z
        plain = plain_call(z, wide, ours.grid)()
    return float(np.abs(plain - made).max())


def plain_call(noise: np.ndarray, conditions: TabletopCondition, grid: Any) -> Call:
    """The script with everything that it reads prepared, in the precision of `noise`."""
    import plain_torch
    import torch

    from deggflow.tasks.tabletop.torch_field import load_torch_field, scene_arrays

    taus, z = torch.from_numpy(np.array(grid)), torch.from_numpy(np.array(noise))
    field = load_torch_field().to(z.dtype)
    field.network.spread = torch.tensor(SPREAD, dtype=z.dtype)  # not as float32 rounds it
    scenes = plain_torch.scenes_of(conditions)
    given = {
        key: torch.from_numpy(np.array(value)) for key, value in scene_arrays(conditions).items()
    }
    return lambda: plain_torch.guided(field, given, scenes, z, taus).numpy()
