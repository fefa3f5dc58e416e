"""Whole generations under faults, simulated; benchmarks/runtime_faults.py plays thousands."""

import pytest
import runtime_faults


@pytest.mark.slow
@pytest.mark.parametrize("outside", [False, True], ids=["within the fault model", "outside"])
def test_survivors_agree_and_no_certificate_is_false(outside, monkeypatch):
    monkeypatch.setattr(runtime_faults, "SIZES", (4,))
    monkeypatch.setattr(runtime_faults, "DRIFTS", runtime_faults.DRIFTS[1:])
    total = runtime_faults.Counter()
    for seed in range(24):
        counts, wrong = runtime_faults.play(seed, outside)
        assert not wrong, f"--seed {seed}"
        total.update(counts)
    assert total["lost agents"] > 0
    assert total["satisfied"] > 0
    assert total["as the batched program"] == total["with a sample"]


def test_a_run_is_replayed_by_its_seed(monkeypatch):
    """Whether the agents' numbers are computed in one call, or each agent has a program of its own."""
    monkeypatch.setattr(runtime_faults, "SIZES", (4,))
    monkeypatch.setattr(runtime_faults, "DRIFTS", runtime_faults.DRIFTS[1:])
    assert runtime_faults.play(5) == runtime_faults.play(5, apart=True)
