"""Faults in the middle of a real command: nothing is lost or mixed, and a rerun completes it to the byte."""

import faults
import pytest

JOB = next(job for job in faults.jobs() if job.name == "bridge data")


@pytest.fixture(scope="module")
def stage(tmp_path_factory):
    stage = faults.Stage(tmp_path_factory.mktemp("faults"))
    stage.prepare([JOB], lambda text: None)
    return stage


@pytest.mark.parametrize("kind", faults.FAULTS)
def test_nothing_is_lost_or_mixed_whatever_happens(stage, kind):
    tally = faults.Tally()
    faults.chain(stage, JOB, seed=len(kind), count=2, tally=tally, only=kind)
    assert tally.problems == []
    assert tally.faults == {kind: 2}


def test_what_would_be_lost_or_mixed_is_found(stage, monkeypatch):
    """A fault that nobody could mend: a finished line is cut off, or another line stands in its place."""

    def cut(fault):
        fault.stage.run(fault.folder, *fault.job.command)
        path = fault.folder / JOB.out
        path.write_bytes(path.read_bytes()[:-10])
        return 0, None

    def mix(fault):
        path = fault.folder / JOB.out
        path.write_bytes(path.read_bytes().replace(b"condition", b"conditioN", 1))
        return 0, None

    monkeypatch.setattr(faults, "FAULTS", {"cut": (cut, 1), "mixed": (mix, 1)})
    for kind, problem in (("cut", "lost"), ("mixed", "other lines")):
        tally = faults.Tally()
        stage.known[JOB.name] = dict(stage.known[JOB.name])
        count = 2 if kind == "cut" else 1
        if kind == "mixed":
            monkeypatch.setitem(
                faults.FAULTS, "mixed", (lambda fault: (cut(fault), mix(fault))[1], 1)
            )
        faults.chain(stage, JOB, seed=100 + count, count=count, tally=tally, only=kind)
        assert any(problem in each for each in tally.problems), tally.problems
