"""Floors from files: images and JSON maps."""

import json
from pathlib import Path

import numpy as np
import pytest
from PIL import Image
from shapely.geometry import LineString, Point, box

from deggflow.jsonl import InputError
from deggflow.tasks.fleet.clearance import clearance
from deggflow.tasks.fleet.condition import FleetCondition, Robot
from deggflow.tasks.fleet.floor_files import MAX_PIXELS, floor_of_image, read_floor
from deggflow.tasks.fleet.generator import FleetGenerator
from deggflow.tasks.fleet.maps import FloorMap
from deggflow.tasks.fleet.model import FleetModel
from deggflow.tasks.fleet.options import FleetFieldOptions, FleetGenerate
from deggflow.tasks.fleet.oracle import refutes
from deggflow.tasks.fleet.routes import Search, routes
from deggflow.tasks.fleet.schemes import random_scheme
from deggflow.tasks.fleet.task import FleetTask


def test_points_are_inside_an_obstacle_where_their_pixel_is_dark():
    rng = np.random.default_rng(0)
    occupied = rng.uniform(size=(12, 20)) < 0.3
    floor = floor_of_image(occupied)
    assert floor.bounds == (-1.0, -0.6, 1.0, 0.6)
    points = rng.uniform((-1.0, -0.6), (1.0, 0.6), (4000, 2))
    column, row = ((points + (1.0, 0.6)) / 0.1).astype(int).T
    np.testing.assert_array_equal(clearance(floor, points) < 0, occupied[11 - row, column])


def test_an_image_is_read_with_its_transparent_pixels_free(tmp_path):
    pixels = np.full((4, 4, 4), 255, np.uint8)
    pixels[0, 0, :3] = 0  # top left
    pixels[3, 3] = 0  # transparent
    Image.fromarray(pixels).save(tmp_path / "floor.png")
    assert read_floor(tmp_path / "floor.png") == FloorMap(boxes=((-0.75, 0.75, 0.5, 0.5),))
    Image.fromarray(np.full((2, 3), 255, np.uint8)).save(tmp_path / "free.png")
    assert read_floor(tmp_path / "free.png") == FloorMap((-1.0, -2 / 3, 1.0, 2 / 3))


def test_random_starts_and_goals_are_clear_of_the_polygons_of_a_floor(tmp_path):
    corners = [[-0.7, -0.7], [0.7, -0.7], [0.0, 0.7]]  # clockwise or not, concave or not
    (tmp_path / "floor.json").write_text(json.dumps({"polygons": [corners]}))
    options = FleetGenerate(size=6, floor=tmp_path / "floor.json")
    (condition,) = FleetTask().random_conditions(6, 1, 3, options)
    assert condition.to_json()["map"]["polygons"] == [corners]
    a, b, c = np.array(corners)
    for point in (*condition.starts, *condition.goals):
        weights = np.linalg.solve(np.stack([np.append(v, 1) for v in (a, b, c)], 1), [*point, 1])
        assert weights.min() < 0  # outside, by barycentric coordinates
        ends = zip((a, b, c), (b, c, a), strict=True)
        along = np.linspace(0, 1, 2001)[:, None]
        assert min(np.hypot(*(p + along * (q - p) - point).T).min() for p, q in ends) > 0.159


@pytest.mark.parametrize(
    ("name", "content", "reason"),
    [
        ("none.png", None, "can't be read: No such file or directory"),
        ("text.png", b"text", "is no image that can be read"),
        ("cut.png", b"\x89PNG\r\n\x1a\n\0\0", "is no image that can be read"),
        ("wrong.json", b'{"boxes": [[0, 0, 1]]}', "must be [centre x, centre y, width, height]"),
        ("name.json", b'"conveyor"', "must be"),
    ],
)
def test_a_bad_file_is_named(tmp_path, name, content, reason):
    path = tmp_path / name
    if content is not None:
        path.write_bytes(content)
    with pytest.raises(InputError, match=reason.replace("[", r"\[")) as error:
        read_floor(path)
    assert str(error.value).startswith(str(path))


def test_an_image_with_too_much_in_it_is_refused(tmp_path):
    Image.new("L", (MAX_PIXELS // 1000 + 1, 1000)).save(tmp_path / "large.png")
    with pytest.raises(InputError, match="at most 1000000 pixels; got 1001 x 1000"):
        read_floor(tmp_path / "large.png")
    checkered = np.indices((64, 64)).sum(axis=0) % 2 == 0
    with pytest.raises(InputError, match="2048 rectangles; at most 1000"):
        floor_of_image(checkered)


@pytest.mark.parametrize(
    "options", [{"map": "conveyor", "size": 3}, {"conditions": Path("asked.jsonl")}]
)
def test_a_floor_goes_with_drawn_conditions_without_a_map(options):
    with pytest.raises(InputError, match="--floor goes with --size, instead of --map"):
        FleetGenerate(floor=Path("floor.png"), **options)


WALLS = FloorMap(
    bounds=(-1.0, -0.8, 1.0, 0.8),
    boxes=((-0.45, 0.2, 0.1, 1.2),),
    discs=((0.5, -0.1, 0.2),),
    polygons=(((0.0, -0.8), (0.1, -0.8), (0.1, 0.4), (0.0, 0.4)),),
)


def test_routes_lead_around_long_walls():
    rng = np.random.default_rng(0)
    starts, goals = random_scheme(WALLS, 12, rng)
    robots = tuple(Robot(tuple(a), tuple(b)) for a, b in zip(starts, goals, strict=True))
    condition = FleetCondition(WALLS, robots)
    ((paths,),) = routes([Search(condition, np.arange(12), rng)], 1)
    np.testing.assert_allclose(paths[:, 0], starts)
    np.testing.assert_allclose(paths[:, -1], goals)
    walls = [box(-0.5, -0.4, -0.4, 0.8), Point(0.5, -0.1).buffer(0.2), box(0.0, -0.8, 0.1, 0.4)]
    distances = [min(LineString(path).distance(wall) for wall in walls) for path in paths]
    assert (
        min(distances) > condition.radius / 2
    )  # corners are rounded; guidance keeps the discs clear
    assert (
        sum(LineString([a, b]).distance(walls[0]) == 0 for a, b in zip(starts, goals, strict=True))
        > 2
    )


def test_a_plan_whose_floor_the_field_does_not_know_is_found():
    ends = (((-0.8, 0.3), (-0.2, 0.3)), ((-0.2, 0.6), (0.4, -0.6)), ((0.8, 0.0), (-0.25, -0.4)))
    condition = FleetCondition(WALLS, tuple(Robot(*pair) for pair in ends))
    generator = FleetGenerator(FleetModel().load(None), FleetFieldOptions())
    (plan,) = generator.plans([condition], max_draws=4)
    assert plan.certificate.satisfied
    assert not refutes(condition, plan.paths)
