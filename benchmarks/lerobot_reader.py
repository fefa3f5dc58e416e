"""Reads a data set that `deggflow export --lerobot` wrote with LeRobot itself, and compares every frame with the trials.

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


def main():
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("folder", type=Path)
    parser.add_argument("trials", type=Path)
    given = parser.parse_args()
    trials = [json.loads(line) for line in given.trials.read_text().splitlines()]
    data = LeRobotDataset("local/trials", root=given.folder)
    assert data.num_episodes == len(trials)
    assert data.num_frames == sum(len(trial["twists"]) for trial in trials)
    number = 0
    for trial in trials:
        for pose, twist in zip(trial["poses"], trial["twists"], strict=False):
            frame = data[number]
            np.testing.assert_allclose(frame["observation.state"], pose, atol=1e-6)
            np.testing.assert_allclose(frame["action"], twist, atol=1e-6)
            number += 1
        assert bool(frame["next.done"])
        assert bool(frame["next.success"]) == trial["outcome"]["success"]
    ahead = {"action": [0.0, 0.2, 0.4], "observation.state": [-0.2, 0.0]}
    windows = LeRobotDataset("local/trials", root=given.folder, delta_timestamps=ahead)
    batch = next(iter(torch.utils.data.DataLoader(windows, batch_size=8, shuffle=True)))
    assert batch["action"].shape == (8, 3, 3)
    print(f"lerobot {lerobot.__version__}: {len(trials)} episodes, {number} frames, all equal")


if __name__ == "__main__":
    main()
