"""Reads a data set that `deggflow export --lerobot` wrote with LeRobot itself, and compares every frame with the file's lines.

python benchmarks/lerobot_reader.py set trials.jsonl
"""

import argparse
import json
from contextlib import suppress
from pathlib import Path

import numpy as np
import torch

# A torchvision that was built for another PyTorch lacks its operators, whose declarations its import needs.
for name in ("nms", "qnms"):
    with suppress(RuntimeError):
        torch.library.define(f"torchvision::{name}", "(Tensor a, Tensor b, float c) -> Tensor")

import lerobot
from lerobot.datasets.lerobot_dataset import LeRobotDataset


def frames_of(line):
    """States and actions of a trial or a plan, and whether it succeeded."""
    if "paths" in line:
        paths = np.array(line["paths"]).swapaxes(0, 1)
        paths = paths.reshape(len(paths), -1)
        return paths[:-1], np.diff(paths, axis=0), line["certificate"]["satisfied"]
    twists = np.array(line["twists"])
    return np.array(line["poses"])[: len(twists)], twists, line["outcome"]["success"]


def main():
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("folder", type=Path)
    parser.add_argument("lines", type=Path, help="trials or plans")
    given = parser.parse_args()
    lines = [json.loads(line) for line in given.lines.read_text().splitlines()]
    expected = [frames_of(line) for line in lines]
    data = LeRobotDataset("local/set", root=given.folder)
    assert data.num_episodes == len(lines)
    assert data.num_frames == sum(len(states) for states, *_ in expected)
    number = 0
    for line, (states, actions, success) in zip(lines, expected, strict=True):
        for state, action in zip(states, actions, strict=True):
            frame = data[number]
            np.testing.assert_allclose(frame["observation.state"], state, atol=1e-6)
            np.testing.assert_allclose(frame["action"], action, atol=1e-6)
            number += 1
        assert bool(frame["next.done"])
        assert bool(frame["next.success"]) == success
        named = line["condition"].get("map")
        assert not isinstance(named, str) or frame["task"].endswith(f" {named}.")
    step = 1 / data.fps
    ahead = {"action": [0.0, step, 2 * step], "observation.state": [-step, 0.0]}
    windows = LeRobotDataset("local/set", root=given.folder, delta_timestamps=ahead)
    batch = next(iter(torch.utils.data.DataLoader(windows, batch_size=8, shuffle=True)))
    assert batch["action"].shape[:2] == (8, 3)
    print(f"lerobot {lerobot.__version__}: {len(lines)} episodes, {number} frames, all equal")


if __name__ == "__main__":
    main()
