"""Demonstrations by the verdict, what the field reads by Shapely, its symmetries, and the baselines."""

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
import pytest
from shapely import Point, Polygon
from shapely.geometry import box

from deggflow.jsonl import InputError
from deggflow.tasks.fleet.condition import FleetCondition, Robot, to_arrays
from deggflow.tasks.fleet.data import make_demonstrations, parse_demonstration
from deggflow.tasks.fleet.field import load_field
from deggflow.tasks.fleet.maps import FloorMap
from deggflow.tasks.fleet.paths import DIM
from deggflow.tasks.fleet.prioritised import denoiser, prioritised
from deggflow.tasks.fleet.projected import Projection
from deggflow.tasks.fleet.surroundings import surroundings
from deggflow.tasks.fleet.verdict import judge

CROSSING = FleetCondition(
    FloorMap(discs=((0.0, 0.5, 0.2),)),
    (Robot((-0.8, 0.02), (0.8, 0.0)), Robot((0.8, -0.01), (-0.8, 0.0))),
)


def straight(condition):
    share = np.linspace(0, 1, 64)[:, None]
    return condition.starts[:, None] * (1 - share) + condition.goals[:, None] * share


@pytest.fixture(scope="module")
def demonstrations():
    return make_demonstrations(3, 0, 24, seed=5)


def test_demonstrations_satisfy_what_plans_must(demonstrations):
    verdicts = judge([d.condition for d in demonstrations], [d.paths for d in demonstrations])
    assert sum(verdict.satisfied for verdict in verdicts) >= 23
    maps = {d.condition.map for d in demonstrations if isinstance(d.condition.map, str)}
    assert len(maps) >= 4


def test_conveyor_is_crossed_by_the_corridor_of_the_direction(demonstrations):
    crossings = []
    for each in demonstrations:
        if each.condition.map == "conveyor":
            x, y = np.moveaxis(each.paths, -1, 0)
            robot, step = np.nonzero((x[:, 1:] > 0) != (x[:, :-1] > 0))
            inside = np.abs(y[robot, step]) < 0.3
            side = np.sign(x[robot, step + 1] - x[robot, step])
            crossings += list(np.sign(y[robot, step]) * side * inside)
    assert crossings
    assert set(crossings) <= {-1.0, 0.0}  # to the right below, to the left above


def test_a_demonstration_depends_on_its_number_and_survives_its_file(demonstrations):
    again = make_demonstrations(3, 7, 1, seed=5)[0]
    assert np.array_equal(again.paths, demonstrations[7].paths)
    row = again.to_json()
    assert np.array_equal(parse_demonstration(row).paths, again.paths)
    with pytest.raises(InputError, match="paths"):
        parse_demonstration(row | {"paths": row["paths"][:-1]})


def test_surroundings_are_those_of_shapely():
    corners = ((-0.1, 0.1), (0.5, 0.2), (0.0, 0.6))
    floor = FloorMap(
        boxes=((0.5, -0.5, 0.4, 0.2),), discs=((-0.5, -0.5, 0.2),), polygons=(corners,)
    )
    condition = FleetCondition(floor, (Robot((-0.9, -0.9), (0.9, 0.9)),))
    arrays = jax.tree.map(lambda leaf: jnp.asarray(leaf[0]), to_arrays([condition]))
    points = np.random.default_rng(0).uniform(-0.99, 0.99, (200, 2)).astype(np.float32)
    distance, along_x, along_y = surroundings(*jnp.asarray(points.T), arrays)
    solids = [Polygon(corners), box(0.3, -0.6, 0.7, -0.4)]

    def signed(point):
        place = Point(point)
        gaps = [
            solid.exterior.distance(place) * (-1 if solid.contains(place) else 1)
            for solid in solids
        ]
        return min(*gaps, np.hypot(*(point + 0.5)) - 0.2, *(1 - np.abs(point)))

    exact = np.array([signed(point) for point in points.astype(float)])
    assert np.abs(np.asarray(distance) - exact).max() < 1e-6
    step = 0.02 * np.stack([along_x, along_y], -1)
    farther = [signed(point) for point in (points + step).astype(float)]
    assert np.mean(farther - exact > 0.01) > 0.9  # away from what is nearest


def test_the_field_is_equivariant_and_absent_robots_change_nothing():
    robots = tuple(Robot((-0.8, y), (0.8, -y)) for y in (-0.8, -0.6, 0.7))
    conditions = [FleetCondition("conveyor", each) for each in (robots, robots[::-1])]
    field, z = load_field(), jax.random.normal(jax.random.key(0), (3, DIM))
    one, other = (
        jax.tree.map(lambda leaf, k=k: jnp.asarray(leaf[k]), to_arrays(conditions)) for k in (0, 1)
    )
    run = eqx.filter_jit(field)
    value = run(jnp.float32(0.4), z, one)
    np.testing.assert_allclose(run(jnp.float32(0.4), z[::-1], other)[::-1], value, atol=2e-5)
    few = to_arrays([FleetCondition("conveyor", robots[:2])])
    alone = jax.tree.map(lambda leaf: jnp.asarray(leaf[0]), few)
    for last in (0.0, 50.0):
        pair = run(jnp.float32(0.4), z.at[2].set(last), alone)[:2]
        np.testing.assert_allclose(pair, run(jnp.float32(0.4), z, alone)[:2], atol=1e-6)
    assert not np.allclose(value[:2], pair, atol=1e-3)  # messages do matter


def test_the_projection_mends_a_crossing_and_stays_near():
    nominal = straight(CROSSING)
    assert not judge([CROSSING], [nominal])[0].satisfied
    found = Projection()(nominal, CROSSING)
    assert found.shortfall == 0
    assert judge([CROSSING], [found.paths])[0].satisfied
    assert np.abs(found.paths - nominal).max() < 0.15


def test_prioritised_planning_lets_the_second_robot_give_way():
    program = denoiser(lambda tau, z, condition: -z)  # carries every z(0) to a nearly straight line
    noise = 0.05 * np.random.default_rng(0).normal(size=(2, 4, DIM)).astype(np.float32)
    found = prioritised(program, CROSSING, noise)
    assert judge([CROSSING], [found.paths])[0].satisfied
    assert np.abs(found.paths[0] - straight(CROSSING)[0]).max() < 0.06
    assert found.rounds > 2
