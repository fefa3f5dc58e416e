"""The report's sections on baselines: what is measured, and what is said of it."""

import json
from dataclasses import asdict, dataclass

import pytest

from deggflow.app.reproduce import baselines
from deggflow.app.reproduce.experiment import Settings
from deggflow.app.reproduce.rows import kept_rows
from deggflow.tasks.tabletop.baselines import METHODS
from deggflow.tasks.tabletop.frontier import Point

QUICK = Settings(seed=3, quick=True)


def point(method, satisfied, transport, *, size=8, draws=1.0, hyperparameters=None):
    (way,) = [each for each in METHODS if each.name == method]
    setting = dict(way.default if hyperparameters is None else hyperparameters)
    return Point(
        method, setting, size, 100, satisfied, 0, 0.01, transport, transport, 0.02, draws
    ).to_json()


def rows(**transports):
    given = {"pooled": (100, 0.2), "rejection sampling": (60, 0.5), **transports}
    return [
        point(name, *numbers, draws=4.0 if name == "rejection sampling" else 1.0)
        for name, numbers in given.items()
    ]


def test_ways_are_measured_on_the_same_cases(monkeypatch):
    names = ("penalty gradient", "rejection sampling")
    few = [each for each in METHODS if each.name in names]
    monkeypatch.setattr(baselines, "QUICK_METHODS", names)
    monkeypatch.setattr(baselines, "METHODS", tuple(few))
    monkeypatch.setattr(baselines, "QUICK_SIZES", (3,))
    monkeypatch.setattr(baselines, "QUICK_SWEPT", (3,))
    said = []
    whole = baselines.Baselines().measure(QUICK, said.append)
    swept = baselines.BaselinesFrontier().measure(QUICK, said.append)
    assert json.loads(json.dumps([whole, swept], allow_nan=False)) == [whole, swept]
    assert [row["method"] for row in whole["rows"]] == [each.name for each in few]
    assert whole["seed"] == 3
    assert swept["seed"] == 1003
    hyperparameters = [dict(hyperparameters) for each in few for hyperparameters in each.grid[::3]]
    assert [row["hyperparameters"] for row in swept["rows"]] == hyperparameters
    assert len(said) == len(few) + len(hyperparameters)


def test_a_baseline_that_is_better_is_said_to_be():
    found = rows(**{"penalty gradient": (100, 0.1), "joint barrier QP": (99, 0.1)})
    section = baselines.Baselines().present({"cases": 100, "seed": 1, "rows": found}, Settings())
    words = section.text[-1]
    assert "the best baseline is penalty gradient" in words
    assert "closer to nominal: penalty gradient." in words
    found = rows(**{"penalty gradient": (100, 0.3), "joint barrier QP": (99, 0.1)})
    section = baselines.Baselines().present({"cases": 100, "seed": 1, "rows": found}, Settings())
    assert "closer to nominal" not in section.text[-1]


def test_times_are_over_one_nominal_draw_of_the_same_run():
    section = baselines.Baselines().present(
        {"cases": 100, "seed": 1, "rows": rows(own=(90, 0.2), **{"dual flow": (90, 0.2)})}, QUICK
    )
    lines = {
        line[1]: dict(zip(section.tables[0].columns, line, strict=True))
        for line in section.tables[0].rows
    }
    assert lines["rejection sampling"]["time / nominal"] == pytest.approx(4.0)
    assert lines["own"]["time / nominal"] == pytest.approx(4.0)
    assert lines["own"]["worst, mm"] == pytest.approx(10.0)
    assert {line[0] for line in section.tables[1].rows} == {each.name for each in METHODS}


def test_the_frontier_has_every_setting_in_its_table_and_marks_the_best():
    (penalty,) = [each for each in METHODS if each.name == "penalty gradient"]
    found = [
        point("penalty gradient", 90 + k, 0.1 * (k + 1), hyperparameters=hyperparameters)
        for k, hyperparameters in enumerate(penalty.grid)
    ]
    section = baselines.BaselinesFrontier().present(
        {"cases": 100, "seed": 1001, "rows": found}, QUICK
    )
    marked = [row for row in section.tables[0].rows if row[-2] == "yes"]
    assert len(section.tables[0].rows) == len(penalty.grid)
    assert [row[3].split("%")[0] for row in marked] == [f"{90 + len(penalty.grid) - 1}.0"]
    (axes,) = section.plots[0].figure.axes
    assert axes.get_xlabel() == "$W_2$ to nominal ($z$, per object)"
    assert axes.get_xlim()[1] < 1.0


@dataclass(frozen=True)
class Row:
    number: int

    def to_json(self):
        return asdict(self)


def test_rows_of_a_stopped_measurement_are_kept_and_those_of_another_thrown_away(tmp_path):
    settings, done = Settings(folder=tmp_path), []

    def job(number, stops=False):
        def run():
            if stops:
                raise KeyboardInterrupt
            done.append(number)
            return Row(number)

        return run

    with pytest.raises(KeyboardInterrupt):
        kept_rows(settings, "rows", {"of": "these"}, [job(1), job(2), job(3, stops=True)], Row)
    jobs = [job(1), job(2), job(3)]
    rows = kept_rows(settings, "rows", {"of": "these"}, jobs, Row)
    assert rows == [Row(1), Row(2), Row(3)]
    assert done == [1, 2, 3]
    assert kept_rows(settings, "rows", {"of": "others"}, jobs[:1], Row) == [Row(1)]
    assert done == [1, 2, 3, 1]
