"""Limits of each agent, bodies in either direction, motion near standstill, no buffer, and arguments that are refused."""

import jax
import jax.numpy as jnp
import numpy as np
import pytest

from deggflow import DecoupledGuidance, certify, generate, sample, verdicts
from deggflow import requirements as req

POSES = req.poses()
DISC = req.Disc((0.0, 0.0), 1.0)
PAIR = jnp.array([[0.0, 0.0], [1.0, 0.0]])
CLOCKWISE = np.array([[(0.5, 0.5), (0.5, -0.5), (-0.5, -0.5), (-0.5, 0.5)]] * 2)


def to_zero(tau, z, condition):
    return -z


def margins(requirement, z):
    return np.asarray(requirement.margins(jnp.asarray(z), None))


def test_each_agent_has_its_own_heading_neighbour_and_place():
    turned = [[0.0, 0.0, 1.5], [0.0, 0.0, 1.5]]
    limits = np.array([0.5, 2.0])
    np.testing.assert_allclose(
        margins(req.heading(0.0, limits, layout=POSES), turned), [[-1.0], [0.5]], atol=1e-6
    )
    moving = req.trajectories(2, heading="angle")
    found = margins(req.heading(0.0, limits, layout=moving), [[0, 0, 0, 0, 0, 1.5]] * 2)
    np.testing.assert_allclose(found, [[0.5, -1.0], [2.0, 0.5]], atol=1e-6)
    near = req.neighbour(np.array([1.0, 5.0]))
    apart = jnp.array([[0.0, 0.0], [3.0, 0.0]])
    np.testing.assert_allclose(margins(near, apart), [[-2.0], [2.0]])
    parts = near.margins.violation(apart, None, near.buffer)
    assert parts[0] > near.floor
    assert parts[1] == 0
    places = req.formation(np.zeros((2, 2)), np.array([1.0, 2.0]))
    np.testing.assert_allclose(margins(places, apart), [[-0.5], [0.5]])


@pytest.mark.parametrize("make", [req.connected, lambda within: req.centroid(np.zeros(2), within)])
def test_a_limit_of_the_team_is_one_number(make):
    with pytest.raises(ValueError, match=r"`within` must be one number, .* got shape \(2,\)"):
        make(np.array([1.0, 2.0])).margins(PAIR, None)


def test_bodies_are_read_in_either_direction():
    z = jnp.array([[0.0, 0.0, 0.0], [0.3, 0.1, 0.0]])
    given = req.bodies_apart("shape", layout=POSES)
    for requirement, condition in (
        (req.bodies_apart(CLOCKWISE, layout=POSES), None),
        (req.bodies_apart(CLOCKWISE[0], layout=POSES), None),
        (given, {"shape": CLOCKWISE}),
        (given, {"shape": CLOCKWISE[:, ::-1]}),
    ):
        assert requirement.margins(z, condition)[0, 1] == pytest.approx(-0.7)
        assert (requirement.margins.violation(z, condition, 0.01) > requirement.floor).all()
    bad = [[(1, 0), (0.1, 0.1), (0, 1), (-1, -1)]] * 2
    with pytest.raises(ValueError, match="`shape` must be a convex polygon"):
        req.bodies_apart(bad, layout=POSES)


def test_bodies_with_different_numbers_of_corners():
    shapes = [[(0, 0), (1, 0), (1, 1), (0, 1)], [(0, 0), (1, 0), (2, 0), (0, 1)]]
    z = jnp.array([[0.0, 0.0, 0.0], [1.5, 0.0, 0.0]])
    assert req.bodies_apart(shapes, layout=POSES).margins(z, None)[0, 1] == pytest.approx(0.5)


@pytest.mark.parametrize("size", [1e-3, 6e-8, 1e-10, 1e-13, 1e-16, 1e-30])
@pytest.mark.parametrize("turn", [[0.0, 0.0], [1.0, 2.0]])
def test_near_standstill_curvature_has_a_finite_gradient(size, turn):
    limit = req.curvature(2.0, layout=req.trajectories(3))
    z = size * np.array([[0.0, 0.0, 1.0, 1.0, *turn]], np.float32)
    parts, gradient = limit.margins.violation_and_gradient(jnp.asarray(z), None, limit.buffer)
    assert np.isfinite(parts).all()
    assert np.isfinite(gradient).all()
    assert (parts[0] > limit.floor) == (verdicts(z, (limit,))[0].margin < 0)


def test_curvature_does_not_depend_on_scale():
    z = np.array([[0.0, 0.0, 1.0, 1.0, 1.0, 3.0]])
    with jax.enable_x64(True):
        for scale in (1e-6, 1.0, 1e6):
            limit = req.curvature(0.1 / scale, layout=req.trajectories(3), buffer=0.05 / scale)
            found = limit.margins.violation_and_gradient(jnp.asarray(scale * z), None, limit.buffer)
            if scale == 1e-6:
                parts, gradient = found[0] * scale**2, found[1] * scale**3
            np.testing.assert_allclose(found[0] * scale**2, parts, rtol=1e-9)
            np.testing.assert_allclose(found[1] * scale**3, gradient, rtol=1e-9)


@pytest.mark.parametrize(
    ("requirement", "z"),
    [
        (lambda **given: req.apart(radius=0.1, layout=req.trajectories(2), **given), [[0.0, 0, 0, 0], [0.1, 0, 0.1, 0]]),
        (lambda **given: req.inside((DISC, req.Disc((1.0, 0.0), 1.0)), **given), [[3.0, 0.0], [0.5, 0.0]]),
        (lambda **given: req.neighbour(0.5, **given), [[0.0, 0.0], [1.0, 0.0]]),
        (
            lambda **given: req.satisfies(
                req.Until(req.Without(DISC), req.Within(DISC)), layout=req.trajectories(2), **given
            ),
            [[3.0, 0.0, 3.0, 0.0], [2.0, 0.0, 0.5, 0.0]],
        ),
    ],
    ids=["apart", "inside", "neighbour", "formula"],
)  # fmt: skip
def test_without_a_buffer_v_is_positive_where_a_margin_is_negative(requirement, z):
    bare, z = requirement(buffer=0.0), jnp.asarray(z, jnp.float32)
    parts, gradient = bare.margins.violation_and_gradient(z, None, 0.0)
    assert np.isfinite(gradient).all()
    np.testing.assert_array_equal(np.asarray(parts) > 0, margins(bare, z).min(axis=1) < 0)


def test_to_stay_in_one_of_several_regions_is_as_easy_as_in_one():
    thin = req.Polygon([(0, 0), (2, 0), (2, 0.4)])
    ell = req.Polygon([(0, 0), (2, 0), (2, 1), (1, 1), (1, 2), (0, 2)])
    for regions in ((thin, req.Disc((50.0, 0.0), 0.5)), (ell, thin)):
        made = sample(
            to_zero, (req.inside(regions),), key=jax.random.key(0), count=32, shape=(2, 2), max_draws=1
        )  # fmt: skip
        assert made.satisfied.all()


def test_numbers_may_be_lists_and_numpys():
    np.testing.assert_allclose(margins(req.near((0.0, 0.0), 1.0), PAIR), [[1.0], [0.0]])
    assert margins(req.apart(radius=[0.1, 0.2]), PAIR)[0, 1] == pytest.approx(0.7)
    assert req.trajectories(np.int64(5)).waypoints == 5
    apart = jax.jit(lambda distance: req.apart(distance=distance).margins(PAIR, None))
    assert apart(0.3)[0, 1] == pytest.approx(0.7)


def test_a_tuple_of_requirements_guides():
    safe, z0 = (req.apart(distance=0.3),), np.array([[1.0, 0.0], [1.0, 1.0]], np.float32)
    made = generate(to_zero, safe, z0, None)
    assert certify(made, safe).satisfied
    np.testing.assert_array_equal(made.z, generate(to_zero, DecoupledGuidance(safe), z0, None).z)


def drawn(condition=None, **given):
    settings = {"key": jax.random.key(0), "count": 2, "shape": (2, 2), **given}
    return sample(to_zero, (req.apart(distance=0.3),), condition, **settings)


@pytest.mark.parametrize(
    ("call", "error", "message"),
    [
        (lambda: req.Disc((0.0, 0.0), -1.0), ValueError, "`radius` must be nonnegative and finite"),
        (lambda: req.Disc((np.nan, 0.0), 1.0), ValueError, "`centre` must be finite"),
        (lambda: req.Box((0.0, 0.0), (-1.0, 1.0)), ValueError, "`size` must be nonnegative"),
        (lambda: req.Box(np.zeros(3), np.ones(3), 1.0), ValueError, "`angle` must be 0 .* 3 axes"),
        (lambda: req.inside(DISC, radius=-5.0), ValueError, "`radius` must be nonnegative"),
        (lambda: req.outside(DISC, radius=np.nan), ValueError, "`radius` must be nonnegative"),
        (lambda: req.Within(DISC, -1.0), ValueError, "`radius` must be nonnegative"),
        (lambda: req.Always(req.Within(DISC), (2, 1)), ValueError, r"`window` .* got \(2, 1\)"),
        (lambda: req.Grid(np.ones((2, 2), bool), (np.nan, 0), 1.0), ValueError, "`origin` must be two finite"),
        (lambda: drawn({"name": "kitchen"}), TypeError, r"every leaf of `condition` .*'kitchen' at condition\['name'\]"),
    ],
)  # fmt: skip
def test_what_cannot_be_meant_is_refused(call, error, message):
    with pytest.raises(error, match=message):
        call()


def test_stops_are_numbers():
    with pytest.raises(ValueError, match=r"`stops` must not be NaN; got \[nan, 1.0\]"):
        generate(to_zero, (req.apart(distance=0.3),), PAIR, None, stops=np.array([np.nan, 1.0]))


def test_a_reason_names_the_agent_that_misses_its_own_limit():
    pair = req.heading(0.0, np.array([0.5, 2.0]), layout=POSES)
    first, second = (
        verdicts(np.array([[0.0, 0, 0], [0, 0, angle]]), (pair,))[0] for angle in (1.5, 2.5)
    )
    assert first.reason is None
    assert "agent 1 misses heading" in second.reason
