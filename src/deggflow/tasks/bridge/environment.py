"""The manipulation stage as a PettingZoo parallel environment, so that other policies can be compared.

Robots move their contact points; the plank follows the body twist that fits all of them best. Motion is
integrated exactly, and every action is judged by the same exact predicates as deggflow's own trials.
"""

import logging
from collections.abc import Callable, Mapping
from dataclasses import replace
from typing import Any, NamedTuple

import numpy as np
from jaxtyping import Bool, Float, UInt8

from deggflow.jsonl import InputError

from .condition import BridgeCondition, Scales, TrialCondition
from .episode import Episode
from .formats import parse_condition
from .observations import ObservationParts
from .process import Process
from .scenes import random_condition
from .world import DT, MAX_ROBOTS, MIN_ROBOTS, ROBOT_SPEED

try:
    from gymnasium.spaces import Box
    from pettingzoo import ParallelEnv
except ModuleNotFoundError as error:
    raise ImportError(
        "The bridge's environment needs PettingZoo and Gymnasium: pip install 'deggflow[env]'"
    ) from error

MAX_ACTIONS = 240  # of a trial, 48 s: deggflow's own trials have no more
OPTIONS = ("condition", "plan")

_log = logging.getLogger(__name__)

Draw = Callable[[Process], UInt8[np.ndarray, "height width 3"]]


class RewardWeights(NamedTuple):
    """Weights of the shared reward; q_task falls from about 14 at a typical start to 0 at the bridge."""

    progress: float = 1.0  # per unit by which an action lowers q_task
    success: float = 10.0  # when the plank bridges the gap
    failure: float = 10.0  # subtracted when something fails


REWARD, UNSCALED = RewardWeights(), Scales()


class Outcome(NamedTuple):
    """What `step` returns, in PettingZoo's order."""

    observations: dict[str, np.ndarray]
    rewards: dict[str, float]
    terminations: dict[str, bool]
    truncations: dict[str, bool]
    infos: dict[str, dict[str, Any]]


class BridgeParallelEnv(ParallelEnv[str, np.ndarray, np.ndarray]):
    """Robots "robot_1" to "robot_N" carry the plank until it bridges the gap or something fails.

    *Action* of a robot: velocity of its contact point in the plank's frame (m/s) during 0.2 s; what goes
    beyond the action space is clipped to it, and `infos` says so ("clipped").

    *Observation* of a robot: the paper's vectors, concatenated as described by `observation_parts`:
    lambda_i (23), pi_ij of the other robots in the order of their numbers (8 each), c_i (45). The last 40
    entries of c_i are the contact point's velocities in the coming 20 actions as the previous plan left
    them. Without a plan, they repeat the last action. A policy that plans several actions passes its plan to
    `set_plan`. They are then the rest of the plan (its last twist held), blended from the last action over 5
    actions; after 4 executed actions, this is the paper's continuation sequence.

    *Reward*, the same for all: see `RewardWeights`. *Termination* of all: success, or the first failure.
    *Truncation* after `max_actions`.

    `infos`: "success", "failure" (reason or None), "q_task", "q_safe" (both at the present pose), "twist"
    (m/s, m/s, rad/s, as executed), "pose" (m, m, rad), "clipped".

    Pictures: with `from deggflow.view.bridge import picture, write_process_video`, pass
    `render_mode="rgb_array", draw=lambda process: picture(process, -1)`; a video of the trial so far is
    `write_process_video(path, env.process())`.
    """

    metadata = {  # noqa: RUF012
        "name": "bridge_v0",
        "render_modes": ["rgb_array"],
        "render_fps": round(1 / DT),
        "is_parallelizable": True,
    }

    def __init__(
        self,
        robots: int = 6,
        *,
        scales: Scales = UNSCALED,
        max_actions: int = MAX_ACTIONS,
        reward: RewardWeights = REWARD,
        render_mode: str | None = None,
        draw: Draw | None = None,
    ) -> None:
        """The environment; `reset` starts a trial.

        Args:
            robots: In every trial, 2 to 8.
            scales: Standardise the continuation in c_i, in m/s if not given; a trained field has its own.
            max_actions: After which a trial is truncated.
            reward: Its weights.
            render_mode: None or "rgb_array".
            draw: Function that draws the trial so far, for "rgb_array".
        """
        if not MIN_ROBOTS <= robots <= MAX_ROBOTS:
            raise ValueError(
                f"`robots` must be in [{MIN_ROBOTS}, {MAX_ROBOTS}], as in all trials; got {robots}."
            )
        if max_actions < 1:
            raise ValueError(f"`max_actions` must be positive; got {max_actions}.")
        if render_mode not in (None, "rgb_array"):
            raise ValueError(f'`render_mode` must be None or "rgb_array"; got {render_mode!r}.')
        if render_mode is not None and draw is None:
            raise ValueError('`draw` must make the pictures of "rgb_array"; got None.')
        self.scales, self.max_actions, self.reward = scales, max_actions, reward
        self.render_mode, self.draw = render_mode, draw
        self.possible_agents = [f"robot_{i + 1}" for i in range(robots)]
        self.agents: list[str] = []
        self.observation_parts = ObservationParts.of(robots)
        self.observation_spaces = {
            agent: _unbounded(self.observation_parts.contact.stop) for agent in self.possible_agents
        }
        self.action_spaces = {
            agent: Box(-ROBOT_SPEED, ROBOT_SPEED, (2,), np.float32)
            for agent in self.possible_agents
        }
        self.state_space = _unbounded(9 + 2 * robots)
        self._rng = np.random.default_rng()
        self._last: Episode | None = None

    def observation_space(self, agent: str) -> Box:
        """The same object at every call."""
        return self.observation_spaces[agent]

    def action_space(self, agent: str) -> Box:
        """The same object at every call."""
        return self.action_spaces[agent]

    def reset(
        self, seed: int | None = None, options: Mapping[str, Any] | None = None
    ) -> tuple[dict[str, np.ndarray], dict[str, dict[str, Any]]]:
        """Starts a trial.

        Args:
            seed: Determines this and the following random trials; if None, the sequence continues.
            options: "condition": a `TrialCondition`, or an object as it stands in files of conditions;
                a random trial without one. "plan": as `set_plan` takes it. As PettingZoo
                requires, other options are accepted; they are ignored with a log message.

        Raises:
            InputError: The condition is invalid, has another number of robots, or its trial is over before it
                begins.
        """
        if seed is not None:
            self._rng = np.random.default_rng(seed)
        settings = {} if options is None else options
        if unread := [key for key in settings if key not in OPTIONS]:
            _log.warning("options %s are not read, only %s are", unread, list(OPTIONS))
        plan = _checked_plan(settings.get("plan"))
        self._last = Episode(self._condition(settings.get("condition")), self.scales)
        self._last.set_plan(plan)
        self.agents = self.possible_agents.copy()
        return self._observations(), self._infos(np.zeros(len(self.agents), bool))

    def step(self, actions: Mapping[str, Any]) -> Outcome:
        """Executes one action of every robot.

        Raises:
            ValueError: An action is missing, superfluous or not a velocity; the state is unchanged.
            RuntimeError: No trial is under way.
        """
        trial = self._trial
        if not self.agents:
            raise RuntimeError("the trial is over: call `reset`")
        commands = self._velocities(actions)
        limit = float(self.action_spaces[self.agents[0]].high[0])  # 0.86 as float32 has it
        velocities, before = np.clip(commands, -limit, limit), trial.q_task
        trial.advance(velocities)
        over = trial.rollout.over
        late = not over and len(trial.rollout.twists) >= self.max_actions
        reward = self.reward.progress * (before - trial.q_task)
        if over:
            reward += self.reward.success if trial.rollout.bridged else -self.reward.failure
        out = Outcome(
            self._observations(),
            dict.fromkeys(self.agents, reward),
            dict.fromkeys(self.agents, over),
            dict.fromkeys(self.agents, late),
            self._infos((velocities != commands).any(axis=-1)),
        )
        if over or late:
            self.agents = []
        return out

    def set_plan(self, twists: Any) -> None:
        """Sets the planned coming actions, for the continuation in c_i; None: no plan.

        Robots do not follow the plan by themselves. It starts with the next action and appears
        in the observations until it is set again or the trial is over.

        Args:
            twists: Body twists [v_x, v_y, omega] of at least one action (m/s, m/s, rad/s).
        """
        self._trial.set_plan(_checked_plan(twists))

    def velocities_of(self, twist: Any) -> dict[str, np.ndarray]:
        """The actions by which the robots carry out a body twist [v_x, v_y, omega]."""
        velocities = self._trial.velocities_of(np.asarray(twist, np.float64))
        return dict(zip(self.possible_agents, velocities, strict=True))

    def policy_condition(self) -> BridgeCondition:
        """The condition of a deggflow policy generated now; numpy arrays in float64."""
        return self._trial.policy_condition()

    def state(self) -> Float[np.ndarray, " entries"]:
        """Plank's pose, its twist, the goal's pose, contact points in the plank's frame; SI units, radians."""
        trial = self._trial
        contacts = np.ravel(trial.rollout.condition.contacts)
        parts = (trial.rollout.pose, trial.rollout.twist, trial.rollout.condition.goal, contacts)
        return np.concatenate(parts).astype(np.float32)

    def process(self) -> Process:
        """The trial so far, for pictures; the robots' goals beyond the gap serve only for drawing."""
        return self._trial.process()

    def render(self) -> UInt8[np.ndarray, "height width 3"] | None:
        """A picture made by `draw`; None without `render_mode`."""
        if self.render_mode is None or self.draw is None:
            return None
        return self.draw(self.process())

    @property
    def _trial(self) -> Episode:
        if self._last is None:
            raise RuntimeError("no trial has begun: call `reset`")
        return self._last

    def _condition(self, value: Any) -> TrialCondition:
        robots = len(self.possible_agents)
        if value is None:
            return random_condition(robots, self._rng)
        if isinstance(value, TrialCondition):
            value = replace(value, given=None).to_json()
        condition = parse_condition(value, "condition")
        if len(condition.contacts) != robots:
            raise InputError(
                f"the environment has {robots} robots; got {len(condition.contacts)} contact points",
                field="condition.contacts",
            )
        return condition

    def _velocities(self, actions: Mapping[str, Any]) -> Float[np.ndarray, "robots 2"]:
        if missing := [agent for agent in self.agents if agent not in actions]:
            raise ValueError(f"every robot needs an action; {', '.join(missing)} got none.")
        if len(actions) > len(self.agents):
            unknown = sorted(str(key) for key in set(actions) - set(self.agents))
            raise ValueError(f"actions are for {self.agents}; got one for {', '.join(unknown)}.")
        try:
            velocities = np.array([actions[agent] for agent in self.agents], np.float64)
        except (TypeError, ValueError):
            velocities = np.empty(0)
        if velocities.shape != (len(self.agents), 2) or not np.isfinite(velocities).all():
            return np.array([_velocity(agent, actions[agent]) for agent in self.agents])
        return velocities

    def _observations(self) -> dict[str, np.ndarray]:
        return dict(zip(self.agents, self._trial.read().astype(np.float32), strict=True))

    def _infos(self, clipped: Bool[np.ndarray, " robots"]) -> dict[str, dict[str, Any]]:
        trial = self._trial
        common = {
            "success": trial.rollout.bridged,
            "failure": trial.rollout.failure,
            "q_task": trial.q_task,
            "q_safe": trial.q_safe,
            "twist": trial.rollout.twist.copy(),
            "pose": trial.rollout.pose.copy(),
        }
        flags = clipped.tolist()
        return {agent: {**common, "clipped": flags[k]} for k, agent in enumerate(self.agents)}


parallel_env = BridgeParallelEnv  # the name under which PettingZoo's tools look for a constructor


def _unbounded(size: int) -> Box:
    return Box(-np.inf, np.inf, (size,), np.float32)


def _velocity(agent: str, action: Any) -> Float[np.ndarray, " 2"]:
    try:
        velocity = np.asarray(action, np.float64)
    except (TypeError, ValueError):
        velocity = np.empty(0)
    if velocity.shape != (2,) or not np.isfinite(velocity).all():
        raise ValueError(
            f"the action of {agent} must be two finite velocities (m/s); got {action!r}."
        )
    return velocity


def _checked_plan(twists: Any) -> Float[np.ndarray, "steps 3"] | None:
    if twists is None:
        return None
    plan = np.array(twists, np.float64)
    if plan.ndim != 2 or len(plan) == 0 or plan.shape[1] != 3 or not np.isfinite(plan).all():
        raise ValueError(f"`plan` must be finite, of shape (actions, 3); got shape {plan.shape}.")
    return plan
