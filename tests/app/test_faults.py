"""Faults in the middle of a real command: nothing is lost or mixed, and a rerun completes it to the byte."""

import faults
import pytest
from faulting.stage import Stage, jobs

JOB = next(job for job in jobs() if job.name == "bridge data")


@pytest.fixture(scope="module")
def stage(tmp_path_factory):
    stage = Stage(tmp_path_factory.mktemp("faults"))
    stage.prepare([JOB], lambda text: None)
    return stage


@pytest.mark.parametrize("kind", faults.FAULTS)
def test_nothing_is_lost_or_mixed_whatever_happens(stage, kind):
    tally = faults.Tally()
    faults.chain(stage, JOB, seed=len(kind), count=2, tally=tally, only=kind)
    assert tally.problems == []
    assert tally.faults == {kind: 2}


def test_what_would_be_lost_or_mixed_is_found(stage, monkeypatch):
    """Faults that nobody could mend: a finished line is cut off, or another stands in its place."""

    def complete(fault):
        fault.stage.run(fault.folder, *fault.job.command)

    def cut(fault):
        path = fault.folder / JOB.out
        path.write_bytes(path.read_bytes()[:-10])

    def mix(fault):
        path = fault.folder / JOB.out
        path.write_bytes(path.read_bytes().replace(b'"seed": 0', b'"seed": 1', 1))

    for harm, problem in ((cut, "bytes of finished lines"), (mix, "other lines than an")):
        steps = iter((complete, harm))

        def fault(under_way, steps=steps):
            next(steps)(under_way)
            return 0, None

        monkeypatch.setitem(faults.FAULTS, "harm", (fault, 1))
        tally = faults.Tally()
        faults.chain(stage, JOB, seed=100 + len(problem), count=2, tally=tally, only="harm")
        assert any(problem in each for each in tally.problems), tally.problems
