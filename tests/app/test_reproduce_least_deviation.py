"""The report's section on both bounds: what it says of given rows, and what it calls a contradiction."""

import numpy as np
import pytest

from deggflow.app.reproduce import least_deviation
from deggflow.app.reproduce.experiment import UNMET, Settings
from deggflow.tasks.tabletop.two_sided import LOWER, NEAREST, CaseDeviations

TIGHT, FAILING, FAR = "predict, then pooled", "penalty gradient", "pooled"


def row(name, deviations, satisfied=(True,) * 4, upper=None, size=8):
    """A row of four cases from their deviations, not squared."""
    return CaseDeviations(
        name,
        size,
        list(satisfied),
        [None if each is None else each**2 for each in deviations],
        [None] * 4 if upper is None else [each**2 for each in upper],
    )


ROWS = [
    row(LOWER, [0.0, 0.1, 0.1, 0.2], (True, False, False, False)),
    row(NEAREST, [0.0, 0.1, 0.1, 0.25]),
    row(FAR, [0.2, 0.3, 0.3, 0.4], upper=[0.3, 0.4, 0.5, 0.6]),
    row(TIGHT, [0.01, 0.12, 0.11, 0.3], upper=[0.02, 0.2, 0.2, 0.5]),
    row(FAILING, [0.01, 0.05, None, 0.3], (True, False, False, True)),
]


def section(rows):
    result = {"cases": 4, "seed": 1, "rows": [each.to_json() for each in rows]}
    return least_deviation.LeastDeviation().present(result, Settings())


def rms(*values):
    return float(np.sqrt(np.mean(np.square(values))))


def test_every_method_stands_between_the_bounds():
    table = section(ROWS).tables[0]
    lines = {line[1]: dict(zip(table.columns, line, strict=True)) for line in table.rows}
    assert lines[LOWER]["deviation"] == pytest.approx(rms(0, 0.1, 0.1, 0.2), abs=1e-4)
    assert lines[LOWER]["95% limit"] < lines[LOWER]["deviation"]
    assert lines[TIGHT]["times lower bound"] == pytest.approx(
        rms(0.01, 0.12, 0.11, 0.3) / rms(0, 0.1, 0.1, 0.2), abs=0.01
    )
    assert lines[FAR]["upper bound"] == pytest.approx(rms(0.3, 0.4, 0.5, 0.6), abs=1e-4)
    # Of a method that fails, only what it satisfies can be compared: the first case and the last.
    assert lines[FAILING]["times lower bound"] == pytest.approx(
        rms(0.01, 0.3) / rms(0, 0.2), abs=0.01
    )
    assert lines[FAILING]["deviation"] == pytest.approx(rms(0.01, 0.05, 0.3), abs=1e-4)


def test_the_closest_method_that_never_fails_is_named():
    words = section(ROWS).text[-1]
    assert "0.1225 to 0.1436" in words
    assert f"{TIGHT} is the closest to nominal" in words
    failing = [ROWS[0], ROWS[1], ROWS[-1]]
    assert section(failing).text[-1].endswith("No method satisfies every case.")


def test_the_figure_marks_methods_to_which_the_bound_does_not_apply():
    (axes,) = section(ROWS).plots[0].figure.axes
    faces = {
        line.get_ydata()[0]: line.get_markerfacecolor()
        for line in axes.lines
        if len(line.get_xdata()) == 1 and line.get_marker() == "o"
    }
    names = [label.get_text() for label in axes.get_yticklabels()]
    assert faces[names.index(FAILING)] == "white"
    assert faces[names.index(TIGHT)] != "white"
    assert axes.get_xlim()[0] < rms(0, 0.1, 0.1, 0.2)


def unmet(monkeypatch, *rows):
    monkeypatch.setattr(
        least_deviation, "jobs", lambda field, grid, *_: [(lambda each=each: each) for each in rows]
    )
    quick = Settings(quick=True)
    return least_deviation.LeastDeviation().measure(quick, lambda text: None)[UNMET]


def test_a_case_beyond_a_bound_is_a_contradiction(monkeypatch):
    assert unmet(monkeypatch, *ROWS) == []
    below = row(FAR, [0.2, 0.3, 0.3, 0.19])
    assert unmet(monkeypatch, ROWS[0], below) == [
        "deviation, N = 8, pooled: 1 cases below the lower bound"
    ]
    above = row(FAR, [0.2, 0.3, 0.3, 0.7], upper=[0.3, 0.4, 0.5, 0.6])
    assert unmet(monkeypatch, ROWS[0], above) == [
        "deviation, N = 8, pooled: 1 cases above the upper bound"
    ]
    # A sample that fails may be as close as it likes.
    assert unmet(monkeypatch, ROWS[0], row(FAR, [0.0] * 4, (True, False, False, False))) == []
