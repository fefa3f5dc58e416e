"""Draws that once failed: each is redrawn until it holds, and none fails without a word.

`failures.jsonl` has every first draw that `deggflow tabletop evaluate --cases 10000 --sizes 10 12 8 7 6 5 4` refused,
with the reason given then. Another batch rounds differently, so a case may hold at once here.
"""

import json
from pathlib import Path

import numpy as np
import pytest

from deggflow.tasks.tabletop.changes import random_conditions
from deggflow.tasks.tabletop.field import load_field
from deggflow.tasks.tabletop.generator import TabletopGenerator
from deggflow.tasks.tabletop.oracle import refutes
from deggflow.tasks.tabletop.requirements import tabletop_guidance

LINES = (Path(__file__).parent / "failures.jsonl").read_text().splitlines()


@pytest.fixture(scope="module")
def generator():
    return TabletopGenerator(load_field(), tabletop_guidance())


@pytest.mark.parametrize(
    "case", [json.loads(line) for line in LINES], ids=lambda c: f"{c['size']}-{c['number']}"
)
def test_what_failed_once_says_why_and_holds_when_drawn_again(generator, case):
    (condition,) = random_conditions(
        case["size"], 1, case["requirements"], case["seed"], case["number"]
    )
    draws = []
    (scene,) = generator.scenes(
        [condition],
        seed=case["seed"],
        first=case["number"],
        on_draw=lambda number, drawn: draws.append((number, drawn)),
    )
    assert scene.certificate.satisfied
    assert not refutes(scene.condition, scene.poses)
    for number, drawn in draws:
        assert number == case["number"]
        certificate = drawn.certificate
        assert np.isfinite(drawn.poses).all()
        # A draw along which the hypotheses hold is not refused; one that is refused says what did not.
        if not certificate.satisfied:
            assert not certificate.generation.hypotheses_hold
            assert certificate.generation.first_failure in certificate.reason
