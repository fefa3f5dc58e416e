"""How the plank moves, what is planned and observed on the way, and how generated policies are carried out."""

import jax
import jax.numpy as jnp
import numpy as np
import pytest
from scipy.linalg import expm

from deggflow.tasks.bridge.codec import continuation, decode, decode_twists, team_twist
from deggflow.tasks.bridge.condition import Scales, observe
from deggflow.tasks.bridge.environment import parallel_env
from deggflow.tasks.bridge.field import BridgeField
from deggflow.tasks.bridge.generator import BridgeGenerator
from deggflow.tasks.bridge.policies import PolicyGenerator, initial_noise
from deggflow.tasks.bridge.scenes import random_conditions
from deggflow.tasks.bridge.verdict import execute

SIZES = (2, 4, 5, 8)


def rigid(pose):
    cos, sin = np.cos(pose[2]), np.sin(pose[2])
    return np.array([[cos, -sin, pose[0]], [sin, cos, pose[1]], [0, 0, 1]])


def random_scales(rng):
    return Scales(
        eta=tuple(rng.uniform(0.1, 0.3, 24).tolist()),
        continuation_mean=tuple(rng.normal(0, 0.1, 40).tolist()),
        continuation_std=tuple(rng.uniform(0.1, 0.4, 40).tolist()),
    )


def on_device(leaf):
    return jnp.asarray(leaf if leaf.dtype == bool else leaf.astype(np.float32))


def random_actions(env, rng, size=0.4):
    return {agent: rng.uniform(-size, size, 2) for agent in env.agents}


def play(env, twists):
    """Executes body twists until the trial is over; everything that `step` returned."""
    out = []
    for twist in twists:
        out.append(env.step(env.velocities_of(twist)))
        if not env.agents:
            break
    return out


@pytest.mark.parametrize("robots", SIZES)
def test_the_plank_follows_the_best_fitting_twist_exactly(robots):
    """Least squares by numpy's own solver, motion by the matrix exponential."""
    rng = np.random.default_rng(robots)
    env = parallel_env(robots)
    env.reset(seed=1)
    for _ in range(10):
        condition = env.policy_condition()
        actions = random_actions(env, rng, 0.5)
        rows = [[[1, 0, -y], [0, 1, x]] for x, y in condition.contacts]
        pulled = np.concatenate(list(actions.values()))
        twist = np.linalg.lstsq(np.concatenate(rows).astype(float), pulled, rcond=None)[0]
        vx, vy, w = twist
        after = rigid(condition.plank) @ expm(0.2 * np.array([[0, -w, vx], [w, 0, vy], [0, 0, 0]]))
        info = env.step(actions).infos["robot_1"]
        np.testing.assert_allclose(info["twist"], twist, atol=1e-12)
        np.testing.assert_allclose(rigid(info["pose"]), after, atol=1e-12)
        fit = team_twist(
            jnp.array(list(actions.values()), jnp.float32)[:, None],
            jnp.array(condition.contacts, jnp.float32),
            jnp.ones(robots, bool),
        )
        np.testing.assert_allclose(info["twist"], fit[0], atol=1e-5)
        if not env.agents:
            break


def test_without_a_plan_the_last_action_is_continued():
    env = parallel_env(4)
    env.reset(seed=0)
    assert not env.policy_condition().continuation.any()
    env.step(env.velocities_of([0.2, 0.1, 0.05]))
    expected = np.tile([0.2, 0.1, 0.05], (20, 1))
    np.testing.assert_allclose(env.policy_condition().continuation, expected, atol=1e-12)


def test_after_four_actions_of_a_plan_the_continuation_is_the_codecs():
    rng = np.random.default_rng(0)
    plan = rng.normal(0, 0.1, (20, 3))
    env = parallel_env(4)
    env.reset(seed=0)
    for k in range(2):
        env.set_plan(plan)
        play(env, plan[:4])
        with jax.enable_x64(True):
            expected = continuation(jnp.asarray(plan), jnp.asarray(plan[3]))
        np.testing.assert_allclose(env.policy_condition().continuation, expected, atol=1e-12)
        plan = plan + 0.01 * (k + 1)
    env.set_plan(None)
    assert np.ptp(env.policy_condition().continuation, axis=0).max() == 0


def test_observations_along_a_trial_are_those_of_its_policy_conditions():
    rng = np.random.default_rng(3)
    scales = random_scales(rng)
    env = parallel_env(6, scales=scales)
    observations, _ = env.reset(seed=2, options={"plan": rng.normal(0, 0.1, (20, 3))})
    parts = env.observation_parts
    for _ in range(12):
        seen = observe(jax.tree.map(on_device, env.policy_condition()), scales)
        for i, agent in enumerate(env.agents):
            read = observations[agent]
            others = np.delete(seen.other[i], i, axis=0)
            np.testing.assert_allclose(read[parts.own], seen.own[i], atol=2e-5)
            np.testing.assert_allclose(read[parts.other].reshape(-1, 8), others, atol=2e-5)
            np.testing.assert_allclose(read[parts.contact], seen.contact[i], atol=2e-5)
        observations = env.step(random_actions(env, rng, 0.2)).observations


def test_a_generated_policy_moves_the_plank_as_its_twists_do(key):
    """The velocities that the robots' coefficients decode to, one action at a time."""
    scales = random_scales(np.random.default_rng(0))
    field = BridgeField(scales, key=key)
    env = parallel_env(5, scales=scales)
    env.reset(seed=4)
    condition = env.policy_condition()
    batch = jax.tree.map(lambda leaf: leaf[None], condition)
    noise = initial_noise(0, np.array([0]), 0, 0)
    plan = PolicyGenerator(field, steps=4).batch(noise, batch).twists[0]
    verdict = execute(condition.plank, plan, condition.contacts.tolist())
    for step, pose in zip(play(env, plan), verdict.poses[1:], strict=True):
        assert step.infos["robot_1"]["pose"] == pytest.approx(pose, abs=1e-12)

    env.reset(seed=4)
    # Each robot's coefficients are its own: they do not agree, and the team's twist lies between them.
    z = jnp.asarray(0.5 * noise[0, :5])
    single = jax.tree.map(on_device, condition)
    velocities = np.asarray(decode(z, single, scales), np.float64)
    twists = np.asarray(decode_twists(z, single, scales))
    for t in range(4):
        actions = dict(zip(env.agents, velocities[:, t], strict=True))
        info = env.step(actions).infos["robot_1"]
        np.testing.assert_allclose(info["twist"], twists[t], atol=1e-5)


def test_a_trial_in_receding_horizon_is_the_same_in_the_environment(key):
    scales = Scales(eta=(0.05,) * 24)
    conditions = random_conditions(4, 3, seed=0)
    env = parallel_env(4, scales=scales)
    for trial in BridgeGenerator(BridgeField(scales, key=key), steps=4).trials(conditions):
        env.reset(options={"condition": trial.condition})
        out = play(env, trial.twists)
        end = out[-1].infos["robot_1"]
        assert len(out) == len(trial.twists)
        assert end["success"] == trial.success
        if all(out[-1].terminations.values()):
            assert end["failure"] == trial.reason
        poses = np.array([step.infos["robot_1"]["pose"] for step in out])
        np.testing.assert_allclose(poses, trial.poses[1:], atol=1e-10)


def test_the_process_has_the_places_of_robots_and_plank():
    env = parallel_env(4)
    condition = random_conditions(4, 1, seed=0)[0]
    env.reset(options={"condition": condition})
    (end,) = play(env, [[0.4, 0.2, 0.3]])
    process = env.process()
    assert len(process.stage) == 3  # twice the actions, and the start
    np.testing.assert_allclose(process.plank[0], condition.plank)
    np.testing.assert_allclose(process.plank[-1], end.infos["robot_1"]["pose"])
    local = [[x, y / 0.36 * 0.52, 1.0] for x, y in condition.contacts]
    for pose, robots in zip(process.plank, process.robots, strict=True):
        np.testing.assert_allclose(robots, (np.array(local) @ rigid(pose).T)[:, :2], atol=1e-12)
