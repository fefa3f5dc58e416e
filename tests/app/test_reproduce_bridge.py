"""The bridge's experiments: what a result claims is so by the oracle, and what is drawn is what was measured.

All of them run teams of seven, one trial at a time: the same compiled programs.
"""

import json
from functools import cache

import numpy as np
import pytest
import shapely
from shapely.geometry import box

from deggflow.app.reproduce import bridge_process, bridge_rescue, bridge_success
from deggflow.app.reproduce.bridge import EXPERIMENTS
from deggflow.app.reproduce.bridge_search import measure_rescue
from deggflow.app.reproduce.experiment import UNMET, Settings
from deggflow.schema import parse_as
from deggflow.statistics import Rate
from deggflow.tasks.bridge.evaluate import Evaluation, PolicyCounts
from deggflow.tasks.bridge.field import load_field
from deggflow.tasks.bridge.formats import parse_trial
from deggflow.tasks.bridge.observations import task_value
from deggflow.tasks.bridge.oracle import refutation
from deggflow.tasks.bridge.process import TICK
from deggflow.tasks.bridge.verdict import bridges
from deggflow.tasks.bridge.world import (
    DT,
    EXECUTED,
    GAP_LEFT,
    GAP_RIGHT,
    PLANK_LENGTH,
    PLANK_WIDTH,
    ROBOT_RADIUS,
    X_MAX,
    X_MIN,
    Y_MAX,
    Y_MIN,
)
from deggflow.view.style import GUIDED, NOMINAL

QUICK = Settings(quick=True)
SIZE = 7
WORKSPACE = box(X_MIN, Y_MIN, X_MAX, Y_MAX)
SMALL = {"width": 160, "height": 80}

loaded = cache(load_field)


def stored(result):
    """As it comes back from its file."""
    return json.loads(json.dumps(result, allow_nan=False))


def quietly(text):
    assert text


@pytest.fixture(scope="module")
def success():
    return stored(bridge_success.measure_rows(loaded(), (SIZE,), 1, 1, quietly))


@pytest.fixture(scope="module")
def process():
    return stored(bridge_process.measure_process(loaded(), SIZE, 1, quietly))


@pytest.fixture(scope="module")
def rescue():
    """As a quick run measures it: the known example."""
    return stored(bridge_rescue.BridgeRescue().measure(QUICK, quietly))


@pytest.fixture
def quick_pictures(monkeypatch):
    """Pictures of the real contents, but small and from above, without OpenGL."""
    for module in (bridge_process, bridge_rescue):
        draw = module.picture

        def small(process, tick, draw=draw, **_):
            return draw(process, tick, renderer="matplotlib", **SMALL)

        monkeypatch.setattr(module, "picture", small)


def plank(pose):
    """The plank as a polygon."""
    half = np.array([PLANK_LENGTH, PLANK_WIDTH]) / 2
    corners = np.array([[1, 1], [-1, 1], [-1, -1], [1, -1]]) * half
    turn = np.exp(1j * pose[2])
    placed = corners @ [1, 1j] * turn + complex(*pose[:2])
    return shapely.Polygon(np.stack([placed.real, placed.imag], -1))


def quintic(tau, start, end):
    """beta as the paper has it."""
    return end + (start - end) * (1 - 6 * tau**5 + 15 * tau**4 - 10 * tau**3)


def test_every_experiment_has_a_name_of_its_own():
    names = [experiment.name for experiment in EXPERIMENTS]
    assert names == ["bridge_success", "bridge_process", "bridge_rescue"]


def test_the_papers_counts_add_up_to_its_overall_row():
    assert sum(rate.successes for rate in bridge_success.PAPER_NOMINAL.values()) == 218
    assert sum(rate.successes for rate in bridge_success.PAPER_GUIDED.values()) == 250


def rows():
    """Two sizes as they could have been counted."""
    kinds = dict.fromkeys(bridge_success.KIND_TITLES, 0)
    counts = {"nominal": PolicyCounts(100, 90, 90, 1), "guided": PolicyCounts(80, 79, 80, 2)}
    given = {"least_margin": 0.1, "policies": counts, "refuted": []}
    return [
        Evaluation(4, 10, 9, {**kinds, "plank_leaves": 1}, 10, [], **given),
        Evaluation(8, 10, 7, {**kinds, "time_out": 3}, 9, ["N = 8, trial 3: blocked"], **given),
    ]


def test_success_stands_beside_the_papers_with_its_interval():
    result = {"trials": 10, "seed": 1, "max_draws": 8, "rows": [row.to_json() for row in rows()]}
    section = bridge_success.BridgeSuccess().present(stored({**result, UNMET: []}), QUICK)
    table, failures, _ = section.tables
    found = {row[0]: dict(zip(table.columns, row, strict=True)) for row in table.rows}
    assert list(found) == ["4", "8 (unseen)", "overall"]
    assert found["8 (unseen)"]["nominal [95%]"] == str(Rate(7, 10))
    assert found["8 (unseen)"]["guided"] == 9
    assert found["4"]["nominal (paper)"] == "46/50 (92%)"
    assert found["overall"]["nominal"] == 16
    assert found["overall"]["nominal (paper)"] == "88/100 (88%)"  # of the same sizes
    assert [sum(row[2:]) for row in failures.rows] == [row[1] for row in failures.rows] == [1, 3]
    assert any("trial 3: blocked" in text for text in section.text)
    (axes,) = section.plots[0].figure.axes
    heights = {c.get_label(): [bar.get_height() for bar in c] for c in axes.containers[::2]}
    assert heights == {
        "nominal (paper)": [92, 84],
        "nominal (ours)": [90, 70],
        "guided (paper)": [100, 100],
        "guided (ours)": [100, 90],
    }


def test_measured_success_is_that_of_the_existing_evaluation(success):
    (row,) = (parse_as(Evaluation, each) for each in success["rows"])
    assert (row.size, row.trials, success["seed"]) == (SIZE, 1, 1)
    assert row.guided == 1
    assert success[UNMET] == []
    section = bridge_success.BridgeSuccess().present(success, QUICK)
    assert section.tables[0].rows[0][1:3] == (1, row.nominal)
    assert section.command == "deggflow bridge evaluate --trials 1 --sizes 7 --seed 1"


def test_the_process_is_complete_by_the_oracle_and_by_its_pictures(process):
    example = process["example"]
    trial = parse_trial(example["trial"])
    assert refutation(example["trial"]) is None
    assert trial.success
    assert trial.certificate.satisfied
    moments = example["moments"]
    assert moments["stages"] == ["approach", "build", "cross"]
    poses, robots = np.array(moments["plank"]), np.array(moments["robots"])
    np.testing.assert_allclose(poses[0], trial.poses[0])
    np.testing.assert_allclose(poses[1:], trial.poses[[-1, -1]])
    assert bridges(poses).tolist() == [False, True, True]
    assert (robots[:2, :, 0] < GAP_LEFT).all()
    away = [shapely.points(at).buffer(ROBOT_RADIUS) for at in robots[0]]
    assert plank(poses[0]).distance(away).min() > 0
    assert shapely.distance(plank(poses[1]), shapely.points(robots[1])) == pytest.approx(
        ROBOT_RADIUS
    )
    over = (robots[2, :, 0] > GAP_LEFT) & (robots[2, :, 0] < GAP_RIGHT)
    assert over.any()
    assert shapely.distance(plank(poses[2]), shapely.points(robots[2][over])).max() == 0.0
    built = moments["seconds"][1] - moments["seconds"][0]
    assert built >= len(trial.twists) * DT - TICK


def test_q_task_is_under_the_papers_bound_and_ends_where_the_certificate_says(process):
    example = process["example"]
    trial = parse_trial(example["trial"])
    policies = trial.certificate.policies
    rows = example["policies"]
    assert [row["when"] for row in rows] == ["early", "middle", "late"]
    assert (rows[0]["policy"], rows[-1]["policy"]) == (1, len(policies))
    for row in rows:
        record = policies[row["policy"] - 1]
        before = trial.poses[(row["policy"] - 1) * EXECUTED]
        tau, q, beta = (np.array(row[key]) for key in ("tau", "q_task", "beta_task"))
        assert (tau[0], tau[-1]) == (0.0, 1.0)
        assert row["seconds"] == pytest.approx((row["policy"] - 1) * EXECUTED * DT)
        assert q[-1] == pytest.approx(record.q_task, abs=1e-3)
        assert beta[-1] == pytest.approx(record.bound, abs=1e-9)
        assert beta[-1] == pytest.approx(task_value(before) - 0.05, abs=1e-9)
        assert beta[0] == pytest.approx(max(q[0] + 0.02, beta[-1] + 0.02), abs=1e-5)
        np.testing.assert_allclose(beta, quintic(tau, beta[0], beta[-1]), atol=1e-5)
        assert row["q_safe"][-1] == pytest.approx(record.q_safe, abs=1e-3)
        if row["hypotheses_hold"]:
            assert (q <= beta + 1e-6).all()


def test_shifted_curves_keep_their_distance(process):
    rows = process["example"]["policies"]
    figure = bridge_process.task_figure(rows)
    for axes, row in zip(figure.axes, rows, strict=True):
        bound, value = axes.lines
        np.testing.assert_allclose(
            value.get_ydata() - bound.get_ydata(),
            np.subtract(row["q_task"], row["beta_task"]),
            atol=1e-12,
        )
        assert bound.get_ydata()[-1] == 0.0


def test_the_process_is_presented_from_its_file_alone(process, quick_pictures):
    section = bridge_process.BridgeProcess().present(process, QUICK)
    pictures, curves = (plot.figure for plot in section.plots)
    shown = [axes.images[0].get_array() for axes in pictures.axes]
    assert [image.shape for image in shown] == [(80, 160, 3)] * 3
    assert all(
        (one != other).any() for one, other in zip(shown, shown[1:] + shown[:1], strict=True)
    )
    assert all(axes.get_xlabel() and axes.get_title() for axes in curves.axes)
    assert len(section.tables[0].rows) == 3


def test_the_rescue_is_one_by_the_oracle(rescue):
    example = rescue["example"]
    nominal, guided = example["nominal"], example["guided"]
    assert (rescue["scanned"], rescue["failures"]) == (1, {"plank_leaves": 1})
    assert (rescue["guided"], rescue["rescued"], rescue[UNMET]) == (1, 1, [])
    assert refutation(nominal) is None
    assert refutation(guided) is None
    assert nominal["outcome"] == {"success": False, "reason": "the plank leaves the workspace"}
    assert guided["outcome"] == {"success": True, "reason": None}
    assert guided["certificate"]["satisfied"]
    assert nominal["condition"] == guided["condition"]
    assert len(nominal["condition"]["contacts"]) == bridge_rescue.SIZE == SIZE
    assert not plank(nominal["poses"][-1]).within(WORKSPACE)
    assert all(plank(pose).within(WORKSPACE) for pose in nominal["poses"][:-1])
    assert all(plank(pose).within(WORKSPACE) for pose in guided["poses"])
    # The policy that is looked at is the last that the nominal trial executes.
    assert example["policy"] == len(nominal["certificate"]["policies"])
    assert example["policy"] == -(-len(nominal["twists"]) // EXECUTED)


def test_the_search_goes_on_until_it_finds_an_example(rescue):
    before = bridge_rescue.KNOWN[1] - 1
    found = stored(measure_rescue(loaded(), SIZE, 1, before, quietly, most=2))
    assert found["scanned"] == 2
    assert found["example"] == rescue["example"]
    nothing = measure_rescue(loaded(), SIZE, 1, before, quietly, most=1)
    assert (nothing["scanned"], nothing["example"]) == (1, None)


def test_q_safe_starts_from_the_same_and_only_guidance_ends_it_below_zero(rescue):
    example = rescue["example"]
    trials = {"nominal": example["nominal"], "guided": example["guided"]}
    for name, place in example["places"].items():
        tau, beta = np.array(place["tau"]), np.array(place["beta_safe"])
        q, nominal = np.array(place["q_safe"]), np.array(place["q_safe_nominal"])
        assert len(tau) == len(nominal)
        assert nominal[0] == pytest.approx(q[0], abs=1e-5)
        assert beta[0] == pytest.approx(q[0] + 0.02, abs=1e-5)
        np.testing.assert_allclose(beta, quintic(tau, beta[0], 0.0), atol=1e-5)
        assert q[-1] <= 0.0 < nominal[-1]
        at = (example["policy"] - 1) * EXECUTED
        np.testing.assert_allclose(place["plank"], trials[name]["poses"][at], atol=1e-9)
        inside = WORKSPACE.exterior.distance(plank(place["plank"]))
        assert place["margin"] == pytest.approx(inside, abs=1e-9)
        # What was executed in the trial is what is drawn.
        executed = trials[name]["certificate"]["policies"][example["policy"] - 1]
        drawn = place["q_safe" if name == "guided" else "q_safe_nominal"]
        assert drawn[-1] == pytest.approx(executed["q_safe"], abs=1e-3)


def test_the_rescue_is_presented_from_its_file_alone(rescue, quick_pictures):
    section = bridge_rescue.BridgeRescue().present(rescue, QUICK)
    pictures, curves = (plot.figure for plot in section.plots)
    assert [axes.get_title() for axes in pictures.axes] == ["Nominal", "Guided"]
    assert "leaves the workspace" in pictures.axes[0].get_xlabel()
    for axes, place in zip(curves.axes, rescue["example"]["places"].values(), strict=True):
        _, guided, nominal = axes.lines
        assert (guided.get_color(), nominal.get_color()) == (GUIDED, NOMINAL)
        np.testing.assert_array_equal(guided.get_ydata(), place["q_safe"])
        np.testing.assert_array_equal(nominal.get_ydata(), place["q_safe_nominal"])
    assert "--lines 88 --nominal" in section.command


def test_a_search_that_finds_nothing_says_so(rescue):
    nothing = {**rescue, "example": None, "scanned": 512, "rescued": 0}
    section = bridge_rescue.BridgeRescue().present(nothing, QUICK)
    assert not section.plots
    assert "512" in section.text[0]
    lacking = {"size": 5, "seed": 1, "scanned": 100, "example": None, UNMET: []}
    assert not bridge_process.BridgeProcess().present(lacking, QUICK).plots
