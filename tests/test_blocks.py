"""Parts side by side: every one, in order, whatever the machine has; the first compiles for the others."""

import threading

import jax
import numpy as np
import pytest

from deggflow import blocks


@pytest.mark.parametrize("cores", [1, 2, 5])
@pytest.mark.parametrize("count", [0, 1, 2, 7])
@pytest.mark.parametrize("compiled", [False, True])
def test_every_part_is_done_in_order(monkeypatch, cores, count, compiled):
    monkeypatch.setattr(blocks, "cores", lambda: cores)
    parts = list(range(count))
    assert blocks.map_blocks(lambda x: x * x, parts, compiled=compiled) == [x * x for x in parts]


def test_the_first_part_is_alone_until_its_program_is_compiled(monkeypatch):
    monkeypatch.setattr(blocks, "cores", lambda: 3)
    busy, most, order = set(), [], []
    lock = threading.Lock()

    def call(part):
        with lock:
            busy.add(part)
            order.append(part)
            most.append((part, len(busy)))
        with lock:
            busy.discard(part)
        return part

    blocks.map_blocks(call, [0, 1, 2], compiled=False)
    assert order[0] == 0
    assert most[0] == (0, 1)


def test_an_error_in_a_part_is_not_lost(monkeypatch):
    monkeypatch.setattr(blocks, "cores", lambda: 2)

    def call(part):
        if part == 2:
            raise ValueError("part 2")
        return part

    with pytest.raises(ValueError, match="part 2"):
        blocks.map_blocks(call, [0, 1, 2], compiled=True)


@pytest.mark.parametrize(("backend", "sizes"), [("cpu", [64] * 15 + [40]), ("gpu", [512, 488])])
def test_blocks_are_larger_on_an_accelerator(monkeypatch, backend, sizes):
    monkeypatch.setattr(jax, "default_backend", lambda: backend)
    parts = blocks.blocks(1000)
    assert [len(part) for part in parts] == sizes
    assert np.concatenate(parts).tolist() == list(range(1000))
