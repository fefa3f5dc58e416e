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
