"""States, poses and parts placed in the world."""

import math

import jax
import jax.numpy as jnp
import numpy as np

from deggflow.tasks.tabletop.codec import Pose, decode, decode_exactly, encode, place
from deggflow.tasks.tabletop.condition import SceneCondition, take, to_arrays

PAPER_SCALE = np.array([[0.70, 0.47, 1.35]])  # [p, theta] = diag(0.70, 0.47, 1.35) z


def states(count, agents):
    return np.random.default_rng(count).normal(size=(count, agents, 3)).astype(np.float32)


@jax.jit
@jax.vmap
def _there_and_back(z, condition):
    pose = decode(z, condition)
    return pose, encode(pose, condition)


def test_decoder_is_the_papers(random_scenes):
    z, arrays = states(20, 6), to_arrays(random_scenes(0, 20, 5)[0])
    pose = np.stack(_there_and_back(z, arrays)[0], axis=-1)
    np.testing.assert_allclose(pose, z * PAPER_SCALE[None], rtol=1e-6)


def test_encode_inverts_decode():
    """On any table."""
    conditions = [
        SceneCondition(("laptop",), width=w, depth=d) for w, d in ((1.4, 0.94), (0.2, 30.0))
    ]
    z = states(2, 6)
    pose, again = _there_and_back(z, to_arrays(conditions))
    np.testing.assert_allclose(again, z, rtol=1e-6)
    np.testing.assert_allclose(pose.x[1], 0.1 * z[1, :, 0], rtol=1e-6)
    np.testing.assert_allclose(pose.y[1], 15.0 * z[1, :, 1], rtol=1e-6)


def test_exact_decoder_is_the_decoder(random_scenes):
    """In float64 and without padding, for the same z."""
    conditions, _ = random_scenes(0, 20, 5)
    z, arrays = states(20, 6), to_arrays(conditions)
    with jax.enable_x64(True):
        padded = np.stack(_there_and_back(z.astype(np.float64), arrays)[0], axis=-1)
    for k, condition in enumerate(conditions):
        exact = decode_exactly(z[k], condition)
        assert exact.dtype == np.float64
        np.testing.assert_allclose(exact, padded[k, :5], rtol=1e-15)


def test_placed_parts_are_the_papers(random_scenes, paper):
    """p_i + R(theta_i + phi_i) s_i^o a_iq for regions, p_i + R(theta_i) c for primitives (paper, App. Task 2)."""
    conditions, poses = random_scenes(2, 10, 9, "combined")
    arrays = to_arrays(conditions, 12)
    for k, (condition, pose) in enumerate(zip(conditions, poses, strict=True)):
        scene = take(arrays, k)
        with jax.enable_x64(True):
            padded = jnp.zeros((12, 3)).at[:9].set(pose)
            primitives = place(scene.primitives, Pose(*padded.T))
            regions = place(scene.regions, Pose(*padded.T))
        expected = {"primitives": [], "regions": []}
        for name, (x, y, theta) in zip(condition.objects, pose, strict=True):
            need = condition.affordance(name)
            for a, _, _, u, v in paper[name][0]:
                centre = complex(x, y) + np.exp(1j * theta) * complex(u, v)
                expected["primitives"].append((centre.real, centre.imag, a))
            for u, v, radius in paper[name][1]:
                turn = np.exp(1j * (theta + need.direction))
                centre = complex(x, y) + turn * need.offset_scale * complex(u, v)
                expected["regions"].append((centre.real, centre.imag, need.radius_scale * radius))
        for name, boxes, parts in (
            ("primitives", primitives, scene.primitives),
            ("regions", regions, scene.regions),
        ):
            rows = np.stack([boxes.x, boxes.y, boxes.half_x + boxes.radius], axis=-1)[parts.valid]
            apart = np.abs(rows[:, None] - np.array(expected[name])[None]).max(axis=-1)
            assert apart.shape[0] == apart.shape[1]
            assert max(apart.min(axis=0).max(), apart.min(axis=1).max()) < 5e-7


def test_a_quarter_turn_is_counterclockwise():
    """A pen cup turned to +y has its affordance region at +y."""
    scene = take(to_arrays([SceneCondition(("pen_cup",))]), 0)
    pose = Pose(jnp.zeros(6), jnp.zeros(6), jnp.full(6, math.pi / 2))
    regions = place(scene.regions, pose)
    np.testing.assert_allclose([regions.x[0], regions.y[0]], [0.0, 0.083], atol=1e-7)
