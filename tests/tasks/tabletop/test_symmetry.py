"""Half a turn and mirroring keep every margin of a scene, and are of order two."""

import math

import jax
import jax.numpy as jnp
import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from deggflow.tasks.tabletop.codec import Pose, decode, encode
from deggflow.tasks.tabletop.condition import to_arrays
from deggflow.tasks.tabletop.margins import TABLETOP, scene_margins
from deggflow.tasks.tabletop.symmetry import half_turn, mirror, random_symmetry, wrap

SYMMETRIES = {
    "mirror": lambda pose, condition: mirror(pose, condition),
    "half turn": lambda pose, condition: half_turn(pose),
    "both": lambda pose, condition: half_turn(mirror(pose, condition)),
}


@jax.jit
@jax.vmap
def _images(pose, condition):
    """Poses, margins and V_i of a scene and of its images; and what a symmetry applied twice makes of it."""

    def told(pose):
        z = encode(pose, condition)
        return pose, scene_margins(z, condition), TABLETOP.violation(z, condition, 0.02)

    images = {name: told(apply(pose, condition)) for name, apply in SYMMETRIES.items()}
    twice = {name: apply(images[name][0], condition) for name, apply in SYMMETRIES.items()}
    return told(pose), images, twice


@pytest.fixture(scope="module")
def images(random_scenes):
    """Of scenes with all twelve objects, under the default requirements that the training data has."""
    conditions, poses = random_scenes(0, 20, 12)
    with jax.enable_x64(True):
        pose = Pose(*jnp.moveaxis(jnp.asarray(np.array(poses)), -1, 0))
        return jax.tree.map(np.asarray, _images(pose, to_arrays(conditions)))


@pytest.mark.parametrize("name", SYMMETRIES)
def test_every_margin_is_kept(images, name):
    """As a set: mirroring exchanges the outer regions of an object."""
    (_, before, violation), of_images, _ = images
    _, after, violated = of_images[name]
    for margin, image in zip(before, after, strict=True):
        flat = (len(margin), -1)
        np.testing.assert_allclose(
            np.sort(image.reshape(flat), axis=1), np.sort(margin.reshape(flat), axis=1), atol=1e-7
        )
    np.testing.assert_allclose(violated, violation, atol=1e-7)  # of every object, not only in sum


@pytest.mark.parametrize("name", SYMMETRIES)
def test_twice_is_the_identity(images, name):
    (pose, _, _), _, twice = images
    np.testing.assert_allclose(twice[name].x, pose.x, atol=1e-12)
    np.testing.assert_allclose(twice[name].y, pose.y, atol=1e-12)
    turns = (twice[name].theta - pose.theta) / (2 * math.pi)
    np.testing.assert_allclose(turns, np.round(turns), atol=1e-12)


def test_images_are_where_they_should_be(images):
    (pose, _, _), of_images, _ = images
    np.testing.assert_array_equal(of_images["mirror"][0].x, pose.x)
    np.testing.assert_array_equal(of_images["mirror"][0].y, -pose.y)
    np.testing.assert_array_equal(of_images["half turn"][0].x, -pose.x)
    np.testing.assert_array_equal(of_images["half turn"][0].y, -pose.y)


@settings(deadline=None)
@given(st.floats(-100, 100, allow_subnormal=False))
def test_wrap(angle):
    wrapped = float(wrap(jnp.asarray(angle, jnp.float32)))
    assert -math.pi - 1e-6 <= wrapped <= math.pi
    turns = (wrapped - angle) / (2 * math.pi)
    assert turns == pytest.approx(round(turns), abs=1e-5)


def test_random_symmetry_draws_all_four(random_scenes):
    """Each in about a quarter of the draws, and nothing else."""
    conditions, poses = random_scenes(1, 1, 6)
    condition = jax.tree.map(lambda leaf: jnp.asarray(leaf[0]), to_arrays(conditions))
    pose = Pose(*jnp.asarray(poses[0], jnp.float32).T)
    drawn = jax.jit(jax.vmap(lambda key, z: random_symmetry(key, z, condition), in_axes=(0, None)))(
        jax.random.split(jax.random.key(0), 400), encode(pose, condition)
    )
    four = [pose, *(apply(pose, condition) for apply in SYMMETRIES.values())]
    found = jax.vmap(lambda z: decode(z, condition))(drawn)
    counts = []
    for image in four:
        turned = np.exp(1j * np.asarray(found.theta)) - np.exp(1j * np.asarray(image.theta))[None]
        here = [np.asarray(found.x) - image.x[None], np.asarray(found.y) - image.y[None], turned]
        counts.append(np.sum(np.all(np.abs(np.stack(here)) < 1e-5, axis=(0, 2))))
    assert sum(counts) == 400
    assert min(counts) > 70
