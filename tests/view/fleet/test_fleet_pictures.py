"""Pictures and videos of plans."""

import numpy as np

from deggflow.certificate import Certificate
from deggflow.task import PictureRequest
from deggflow.tasks.fleet.condition import FleetCondition, Robot
from deggflow.tasks.fleet.maps import FloorMap
from deggflow.tasks.fleet.options import FleetRender
from deggflow.tasks.fleet.paths import exact_path
from deggflow.tasks.fleet.plan import Plan
from deggflow.view.fleet import video
from deggflow.view.fleet.results import FleetPictures
from deggflow.view.fleet.topview import pixels, plan_figure


def test_a_picture_and_a_video(tmp_path, monkeypatch):
    monkeypatch.setattr(video, "BETWEEN", 1 / 21)  # four frames
    floor = FloorMap(
        boxes=((0.0, 0.0, 0.2, 0.2),), discs=((0.5, 0.5, 0.1),), polygons=(((-0.5, -0.5), (-0.4, -0.5), (-0.4, -0.4)),)
    )  # fmt: skip
    condition = FleetCondition(floor, (Robot((-0.8, 0.0), (0.8, 0.1)),))
    paths = exact_path(np.zeros((1, 124)), condition.starts, condition.goals)
    plan = Plan(condition, paths, Certificate(False, -0.1, 0.1, 1, "robot 1"), 0)
    request = PictureRequest(plan, 3, FleetRender(out=tmp_path, video=True), lambda: None, print)
    written = [path.name for path in FleetPictures().write(request)]
    assert written == ["plan_0003.png", "plan_0003.mp4"]
    assert all((tmp_path / name).stat().st_size > 1000 for name in written)


def drawn(*robots):
    """A picture of robots that go straight on a floor without obstacles."""
    condition = FleetCondition(FloorMap(), tuple(Robot(*robot) for robot in robots))
    path = np.linspace(condition.starts, condition.goals, 64, axis=1)
    plan = Plan(condition, path, Certificate(True, 0.1, 0.0, 1, None), 0)
    figure = plan_figure(plan)
    return figure.axes[0], pixels(figure)


def red(picture):
    fault = np.array([0xB0, 0x00, 0x20])
    return int((np.abs(picture.astype(int) - fault).max(axis=-1) < 12).sum())


def test_robots_that_miss_a_requirement_are_red():
    apart = ((-0.8, 0.5), (0.8, 0.5)), ((-0.8, -0.5), (0.8, -0.5))
    crossing = ((-0.8, 0.5), (0.8, -0.5)), ((-0.8, -0.5), (0.8, 0.5))
    assert red(drawn(*apart)[1]) == 0
    assert red(drawn(*crossing)[1]) > 100


def test_what_is_outside_of_the_bounds_is_shown():
    inside, _ = drawn(((-0.8, 0.0), (0.8, 0.0)))
    assert inside.get_xlim() == (-1.0, 1.0)
    beyond, _ = drawn(((-0.8, 0.0), (1.5, 0.0)))
    assert beyond.get_xlim()[1] > 1.5
    assert beyond.get_ylim() == (-1.0, 1.0)
