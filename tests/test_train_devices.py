"""Training from a file of records and on several devices and processes: the same run as in memory on one."""

import json
import os
import socket
import subprocess
import sys
from pathlib import Path

import equinox as eqx
import jax
import numpy as np
import pytest

from deggflow.jsonl import InputError
from deggflow.train import Dataset, StoredDataset, TrainingConfig, feed, train
from deggflow.train.store import header_path, is_stored, store

CONFIG = TrainingConfig(steps=60, batch=8, warmup=5, validate_every=12, average=0.9, seed=3)


class Shift(eqx.Module):
    """A small field for a small problem."""

    network: eqx.nn.MLP

    def __call__(self, tau, z, condition):
        return jax.vmap(lambda row: self.network(jax.numpy.append(row, tau)))(z)


def field():
    return Shift(eqx.nn.MLP(3, 2, 16, depth=2, key=jax.random.key(0)))


def dataset(seed, samples):
    rng = np.random.default_rng(seed)
    z = (np.array([1.0, -1.0]) + 0.1 * rng.normal(size=(samples, 3, 2))).astype(np.float32)
    condition = {"a": np.arange(samples, dtype=np.int32), "b": rng.random((samples, 2)) > 0.5}
    return Dataset(z, condition, np.ones((samples, 3), bool))


def stored(path, data, chunk=7):
    count = len(data.mask)
    chunks = (
        jax.tree.map(lambda leaf, k=k: leaf[k : k + chunk], data) for k in range(0, count, chunk)
    )
    store(path, chunks, {"from": "here"})
    return StoredDataset(path, jax.tree.map(lambda leaf: leaf[:1], data))


class KilledError(Exception):
    pass


def kill(curve):
    if curve.step == 24:
        raise KilledError


def end(folder):
    """Curves, identity and last checkpoint of a run."""
    names = ("curves.csv", "config.json", f"checkpoints/{CONFIG.steps}.safetensors")
    return [(folder / name).read_bytes() for name in names]


def test_a_stored_dataset_trains_to_the_same_bits_killed_or_not(tmp_path, monkeypatch):
    """Whatever the stretches; and a run in memory is resumed from the file."""
    data, held_out = dataset(0, 50), dataset(1, 10)
    on_disk = stored(tmp_path / "records", data)
    train(field(), data, held_out, CONFIG, tmp_path / "memory")
    for name, bytes_at_once in (("one", 10**9), ("several", on_disk.row_bytes * 8 * 5)):
        monkeypatch.setattr(feed, "_BYTES", bytes_at_once)
        first = on_disk if name == "one" else data
        with pytest.raises(KilledError):
            train(field(), first, held_out, CONFIG, tmp_path / name, on_progress=kill)
        train(field(), on_disk, held_out, CONFIG, tmp_path / name)
        assert end(tmp_path / name) == end(tmp_path / "memory")
    assert feed.stretch_length(on_disk, 12, 8) == 4
    assert feed.stretch_length(on_disk, 12, 10**9) == 1


def test_records_are_read_by_number_and_known_by_their_source(tmp_path):
    data = dataset(0, 50)
    path = tmp_path / "records"
    on_disk = stored(path, data)
    index = np.array([49, 0, 7, 7, 12])
    for one, other in zip(jax.tree.leaves(on_disk.rows(index)), jax.tree.leaves(data), strict=True):
        np.testing.assert_array_equal(one, other[index])
    assert is_stored(path, {"from": "here"})
    assert not is_stored(path, {"from": "elsewhere"})
    with pytest.raises(InputError, match="holds no records of these data"):
        StoredDataset(path, dataset(0, 3)._replace(condition=np.zeros(3)))
    with path.open("r+b") as file:
        file.truncate(path.stat().st_size - 1)
    with pytest.raises(InputError, match="was shortened while it was being read"):
        on_disk.rows(np.array([49]))
    some = jax.tree.map(lambda leaf: leaf[:1], data)
    with pytest.raises(InputError, match=r"must have .* bytes, for 50 samples"):
        StoredDataset(path, some)
    header_path(path).write_text("{")
    assert not is_stored(path, {"from": "here"})


def test_devices_that_can_not_divide_a_batch_are_refused(tmp_path):
    data = dataset(0, 5)
    config = TrainingConfig(steps=4, batch=3, validate_every=2)
    with pytest.raises(ValueError, match=r"`batch` must be a multiple of .* devices, 2; got 3"):
        train(field(), data, data, config, tmp_path, devices=jax.devices() * 2)


PROGRAM = """
import sys
sys.path.insert(0, {root!r})
import jax
from {module} import on_devices, as_process
{call}
"""


def program(call, **environment):
    here = Path(__file__)
    code = PROGRAM.format(root=str(here.parent), module=here.stem, call=call)
    return subprocess.Popen(
        [sys.executable, "-c", code],
        env={**os.environ, **environment},
        stdout=subprocess.PIPE,
        stderr=subprocess.STDOUT,
        text=True,
    )


def on_devices(folder):
    """Trains on two and on four devices of this process; also begun on four and resumed on two."""
    devices, data, held_out = jax.devices(), dataset(0, 50), dataset(1, 10)
    assert len(devices) == 4
    for count in (2, 4):
        train(field(), data, held_out, CONFIG, f"{folder}/{count}", devices=devices[:count])
    both = f"{folder}/both"
    try:
        train(field(), data, held_out, CONFIG, both, on_progress=kill, devices=devices)
    except KilledError:
        train(field(), data, held_out, CONFIG, both, devices=devices[:2])
    blocks_on_devices()


def blocks_on_devices():
    """Blocks of a batch take turns on the devices, with the same values as on one."""
    import deggflow
    from deggflow import sampler
    from deggflow.guidance import NoGuidance

    def drawn(devices):
        sampler.jax.local_devices = lambda: devices
        return sampler.Sampler(
            drift, deggflow.refined_grid(4), None, program=sampler.masked_batch
        ).draw(NoGuidance(), z0, Present(np.ones((200, 3), bool)))

    z0 = np.random.default_rng(0).normal(size=(200, 3, 2)).astype(np.float32)
    one, four = drawn(jax.devices()[:1]), drawn(jax.devices())
    np.testing.assert_array_equal(one.z, four.z)
    print("blocks agree")


class Present(eqx.Module):
    """A condition that only says who is present."""

    mask: np.ndarray


def drift(tau, z, condition):
    return -jax.numpy.sin(3 * z)


def as_process(folder, coordinator, number):
    """Trains as one of two processes."""
    jax.distributed.initialize(coordinator, 2, number, coordinator_bind_address=coordinator)
    train(field(), dataset(0, 50), dataset(1, 10), CONFIG, folder)


def curves(folder):
    lines = (folder / "curves.csv").read_text().splitlines()[1:]
    return np.array([[float(value) for value in line.split(",")] for line in lines])


@pytest.mark.slow
def test_devices_and_processes_train_the_same_curves_within_rounding(tmp_path):
    """On 2 and 4 host devices; resumed on another number; by two processes over loopback."""
    with socket.socket() as free:
        free.bind(("127.0.0.1", 0))
        coordinator = f"127.0.0.1:{free.getsockname()[1]}"
    two = tmp_path / "two"
    running = [program(f"as_process({str(two)!r}, {coordinator!r}, {k})") for k in (0, 1)]
    flags = f"{os.environ.get('XLA_FLAGS', '')} --xla_force_host_platform_device_count=4"
    running.append(program(f"on_devices({str(tmp_path)!r})", XLA_FLAGS=flags))
    said = [process.communicate()[0] for process in running]
    assert all(process.returncode == 0 for process in running), "\n".join(said)
    assert "blocks agree" in said[-1]
    train(field(), dataset(0, 50), dataset(1, 10), CONFIG, tmp_path / "here")
    expected = curves(tmp_path / "here")
    for name in ("2", "4", "both", "two"):
        np.testing.assert_allclose(curves(tmp_path / name), expected, rtol=2e-5)
        config = json.loads((tmp_path / name / "config.json").read_text())
        assert config["data"] == json.loads((tmp_path / "here/config.json").read_text())["data"]
