"""The PettingZoo environment: its rules, how trials end, what it refuses, its pictures and its example."""

import copy
import pickle
import subprocess
import sys
from pathlib import Path

import numpy as np
import pytest
from gymnasium.utils.env_checker import data_equivalence
from pettingzoo.test import api_test, parallel_api_test, parallel_seed_test
from pettingzoo.utils import parallel_to_aec

from deggflow.jsonl import InputError
from deggflow.tasks.bridge.condition import TrialCondition
from deggflow.tasks.bridge.environment import BridgeParallelEnv, RewardWeights, parallel_env
from deggflow.tasks.bridge.expert import follow, random_demonstration
from deggflow.tasks.bridge.observations import task_value
from deggflow.tasks.bridge.verdict import execute
from deggflow.view.bridge import picture

EXAMPLE = Path(__file__).parents[3] / "examples" / "compare_policies.py"
SIZES = (2, 4, 5, 8)


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


# The rules of PettingZoo


@pytest.mark.parametrize("robots", SIZES)
def test_passes_the_api_test_of_pettingzoo(robots, capsys):
    parallel_api_test(parallel_env(robots), num_cycles=300)
    assert "Passed Parallel API test" in capsys.readouterr().out


# Plans are the caller's, so what is read of them has no bound; PettingZoo's tests advise one.
@pytest.mark.filterwarnings("ignore:Agent's m.*imum observation space value is:UserWarning")
def test_passes_the_api_test_of_agents_in_turn():
    api_test(parallel_to_aec(parallel_env(4)), num_cycles=200)


def test_passes_the_seed_test_of_pettingzoo():
    parallel_seed_test(parallel_env, num_cycles=100)


def test_a_seed_decides_whole_trials():
    first, second = parallel_env(4), parallel_env(4)
    assert data_equivalence(first.reset(seed=5), second.reset(seed=5))
    for _ in range(2):  # the trial after it, too
        rng = np.random.default_rng(0)
        while first.agents:
            actions = random_actions(first, rng, 0.8)
            assert data_equivalence(tuple(first.step(actions)), tuple(second.step(actions)))
        assert second.agents == []
        assert data_equivalence(first.reset(), second.reset())
    assert not data_equivalence(first.reset(seed=5), second.reset(seed=6))


def test_everything_returned_lies_in_its_space_and_belongs_to_the_caller():
    env = parallel_env(5)
    observations, infos = env.reset(seed=0)
    rng = np.random.default_rng(1)
    for _ in range(20):
        assert list(observations) == list(infos) == env.agents == env.possible_agents
        for agent in env.agents:
            assert observations[agent] in env.observation_space(agent)
            assert env.action_space(agent).sample() in env.action_space(agent)
        assert env.state() in env.state_space
        before = env.state()
        for info in infos.values():
            info["pose"][:], info["twist"][:] = 9.0, 9.0
        assert np.array_equal(env.state(), before)
        observations, _, _, _, infos = env.step(random_actions(env, rng))


def test_copies_go_their_own_way():
    env = parallel_env(4)
    env.reset(seed=0)
    twin, other = copy.deepcopy(env), pickle.loads(pickle.dumps(env))
    actions = env.velocities_of([0.2, 0.0, 0.1])
    found = tuple(env.step(actions))
    assert data_equivalence(found, tuple(twin.step(actions)))
    assert data_equivalence(found, tuple(other.step(actions)))


def test_without_pettingzoo_the_package_works_and_the_message_names_the_extra():
    code = """
import sys
sys.modules["pettingzoo"] = None
import deggflow.app.cli, deggflow.tasks.bridge.generator
try:
    import deggflow.tasks.bridge.environment
except ImportError as error:
    sys.exit("deggflow[env]" not in str(error))
sys.exit(2)
"""
    assert subprocess.run([sys.executable, "-c", code], check=False).returncode == 0


# How trials end


@pytest.mark.parametrize("robots", [4, 6, 8])
def test_an_expert_bridges_at_the_action_at_which_the_verdict_says_so(robots):
    demonstration = random_demonstration(robots, seed=0, number=0)
    condition = demonstration.condition
    twists = follow(condition, demonstration.approach)
    verdict = execute(np.array(condition.plank), twists, condition.contacts)
    env = parallel_env(robots)
    env.reset(options={"condition": condition})
    out = play(env, twists)
    assert verdict.bridged
    assert len(out) == verdict.actions == demonstration.bridged
    for step, pose in zip(out, verdict.poses[1:], strict=True):
        assert step.infos["robot_2"]["pose"] == pytest.approx(pose, abs=1e-12)
    assert all(not any(step.terminations.values()) for step in out[:-1])
    end = out[-1]
    assert all(end.terminations.values())
    assert not any(end.truncations.values())
    assert all(info["success"] and info["failure"] is None for info in end.infos.values())
    assert env.agents == []
    with pytest.raises(RuntimeError, match="reset"):
        env.step({})


def toward(world, pose):
    cos, sin = np.cos(pose[2]), np.sin(pose[2])
    return [cos * world[0] + sin * world[1], cos * world[1] - sin * world[0], 0.0]


@pytest.mark.parametrize(
    ("direction", "failure"),
    [
        ((0.0, 0.5), "robot 1 leaves the workspace"),
        ((-0.5, 0.0), "the plank leaves the workspace"),
        ((0.5, 0.0), "robot 1 enters the gap"),
    ],
)
def test_driving_where_no_one_may_go_ends_with_the_failure_by_name(direction, failure):
    contacts = [[-0.1, 0.36], [-2.0, 0.36], [-0.7, -0.36], [-2.5, -0.36]]
    pose, goal = {"x": -3.1, "y": 2.0, "theta": 0.0}, {"x": 0.0, "y": 0.0, "theta": 0.0}
    if direction[0] > 0:  # it would bridge the gap, were it not for robot 1, too far forward
        contacts[0] = [1.6, 0.36]
    condition = {"plank": pose, "goal": goal, "contacts": contacts}
    env = parallel_env(4, reward=RewardWeights(progress=0.0, failure=7.0))
    env.reset(options={"condition": condition})
    twists = np.tile(toward(direction, [*pose.values()]), (40, 1))
    out = play(env, twists)
    verdict = execute(np.array([*pose.values()]), twists, contacts)
    end = out[-1]
    assert verdict.reason == failure
    assert len(out) == verdict.actions
    assert all(end.terminations.values())
    for agent, info in end.infos.items():
        assert info["failure"] == failure
        assert not info["success"]
        assert end.rewards[agent] == -7.0
    assert env.process().failure == failure


def test_standing_still_is_truncated():
    env = parallel_env(4, max_actions=7)
    _, infos = env.reset(seed=0)
    out = play(env, np.zeros((20, 3)))
    assert len(out) == 7
    assert all(out[-1].truncations.values())
    assert not any(out[-1].terminations.values())
    assert not any(out[-2].truncations.values())
    assert out[-1].infos["robot_1"]["failure"] is None
    assert np.array_equal(out[-1].infos["robot_1"]["pose"], infos["robot_1"]["pose"])
    assert env.agents == []


def test_progress_adds_up_to_what_q_task_fell_by():
    demonstration = random_demonstration(5, seed=1, number=0)
    env = parallel_env(5, reward=RewardWeights(progress=2.5, success=4.0))
    _, infos = env.reset(options={"condition": demonstration.condition})
    start = infos["robot_1"]["q_task"]
    out = play(env, demonstration.twists)
    fell = start - out[-1].infos["robot_1"]["q_task"]
    for agent in env.possible_agents:
        total = sum(step.rewards[agent] for step in out)
        assert total == pytest.approx(2.5 * fell + 4.0, abs=1e-9)
    assert start == pytest.approx(task_value(np.array(demonstration.condition.plank)))


# What is refused


def test_velocities_beyond_the_limit_are_clipped_and_named():
    env = parallel_env(4)
    env.reset(seed=0)
    twin = copy.deepcopy(env)
    limits = {agent: env.action_space(agent).high for agent in env.agents}
    asked = {**limits, "robot_3": [2.0, 0.86]}
    cut, plain = env.step(asked), twin.step(limits)
    assert [info["clipped"] for info in cut.infos.values()] == [False, False, True, False]
    assert not any(info["clipped"] for info in plain.infos.values())
    np.testing.assert_allclose(
        cut.infos["robot_1"]["pose"], plain.infos["robot_1"]["pose"], atol=1e-7
    )


@pytest.mark.parametrize(
    "action",
    [[0.1], [0.1, 0.2, 0.3], [[0.1, 0.2]], [np.nan, 0.0], [0.0, np.inf], None, "ab", ["a", "b"]],
)
def test_an_action_that_is_no_velocity_is_refused_by_the_robots_name(action):
    env = parallel_env(4)
    env.reset(seed=0)
    before = env.state()
    with pytest.raises(ValueError, match="action of robot_3 must be two finite velocities"):
        env.step({**env.velocities_of(np.zeros(3)), "robot_3": action})
    with pytest.raises(ValueError, match="action of robot_1"):
        env.step(dict.fromkeys(env.agents, action))
    assert np.array_equal(env.state(), before)
    env.step(env.velocities_of(np.zeros(3)))


def test_missing_and_unknown_robots_are_named():
    env = parallel_env(4)
    env.reset(seed=0)
    actions = env.velocities_of(np.zeros(3))
    with pytest.raises(ValueError, match="robot_2, robot_4 got none"):
        env.step({agent: actions[agent] for agent in ("robot_1", "robot_3")})
    with pytest.raises(ValueError, match="got one for robot_9"):
        env.step({**actions, "robot_9": [0, 0]})


CONDITION = TrialCondition(
    (-3.5, 0.0, 0.0), (0.0, 0.0, 0.0), ((-0.5, 0.36), (-1.5, -0.36), (-2.0, 0.36), (-2.5, -0.36))
)


@pytest.mark.parametrize(
    ("condition", "message"),
    [
        ({**CONDITION.to_json(), "goal": {"x": 0.0, "y": 0.0}}, "condition.goal"),
        ({**CONDITION.to_json(), "contacts": [[-0.5, 0.3]] * 4}, r"condition.contacts\[0\]"),
        ({**CONDITION.to_json(), "contacts": [[-0.5, 0.36], [-1.0, -0.36]]}, "4 robots; got 2"),
        ({**CONDITION.to_json(), "plank": {"x": -3.5, "y": 2.7, "theta": 0.0}}, "at the start"),
        ({**CONDITION.to_json(), "plank": CONDITION.to_json()["goal"]}, "bridges the gap"),
        (TrialCondition((-9.0, 0.0, 0.0), CONDITION.goal, CONDITION.contacts), "plank.x"),
        ("here", "condition"),
    ],
)
def test_bad_conditions_are_refused(condition, message):
    with pytest.raises(InputError, match=message):
        parallel_env(4).reset(options={"condition": condition})


def test_a_condition_is_the_same_as_object_and_as_json():
    env = parallel_env(4)
    first = env.reset(options={"condition": CONDITION})
    assert data_equivalence(first, env.reset(options={"condition": CONDITION.to_json()}))
    expected = [-3.5, 0, 0, 0, 0, 0, 0, 0, 0, *np.ravel(CONDITION.contacts)]
    np.testing.assert_allclose(env.state(), expected, atol=1e-6)


@pytest.mark.parametrize(
    ("settings", "message"),
    [
        ({"robots": 1}, "`robots`"),
        ({"robots": 9}, "`robots`"),
        ({"max_actions": 0}, "`max_actions`"),
        ({"render_mode": "human"}, "`render_mode`"),
        ({"render_mode": "rgb_array"}, "`draw`"),
    ],
)
def test_settings_are_checked(settings, message):
    with pytest.raises(ValueError, match=message):
        BridgeParallelEnv(**settings)


@pytest.mark.parametrize("plan", [np.zeros((0, 3)), np.zeros(3), [[0.0, np.nan, 0.0]], [[0, 0]]])
def test_plans_are_checked(plan):
    env = parallel_env(4)
    env.reset(seed=0)
    with pytest.raises(ValueError, match="`plan` must be finite"):
        env.set_plan(plan)


def test_before_the_first_reset_there_is_nothing():
    env = parallel_env(4)
    assert env.agents == []
    with pytest.raises(RuntimeError, match="reset"):
        env.state()
    with pytest.raises(RuntimeError, match="reset"):
        env.step({})


def test_options_that_are_not_read_are_named(caplog):
    parallel_env(4).reset(seed=0, options={"conditon": {}})
    assert "conditon" in caplog.text


# Pictures and the example


def test_pictures_come_from_the_view():
    def draw(process):
        return picture(process, -1, width=96, height=54, renderer="matplotlib")

    env = parallel_env(4, render_mode="rgb_array", draw=draw)
    env.reset(seed=0)
    first = env.render()
    play(env, np.tile([0.4, 0.0, 0.0], (5, 1)))
    second = env.render()
    assert first.shape == second.shape == (54, 96, 3)
    assert first.dtype == np.uint8
    assert (first != second).any()
    assert parallel_env(4).render() is None


@pytest.mark.slow
def test_the_example_runs():
    found = subprocess.run(
        [sys.executable, "-W", "error", str(EXAMPLE), "--trials", "2", "--robots", "4"],
        capture_output=True,
        text=True,
        check=True,
    )
    assert "straight   2 of 2" in found.stdout
    if "no trained weights" not in found.stdout:
        assert "guided     2 of 2" in found.stdout
