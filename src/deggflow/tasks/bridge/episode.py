"""A trial under any policies: robots move the plank, exact predicates judge it, and robots observe."""

from typing import Any

import numpy as np
from jaxtyping import Float

from deggflow.jsonl import InputError

from .codec import BLENDED
from .condition import BridgeCondition, Scales, TrialCondition
from .drive import random_goals
from .observations import Observations, contact_map, safe_value, task_value
from .process import TICK, Process, Stage
from .rollout import STARTS_BROKEN, Rollout
from .verdict import execute, sub_poses
from .world import DT, HORIZON

_BLEND = np.minimum(np.arange(1, HORIZON + 1) / (BLENDED + 1), 1.0)[:, None]


class Episode:
    """A rollout, what the robots plan, and what they observe.

    Attributes:
        rollout: Poses of the plank, executed actions, and the outcome.
        q_task: At the current pose.
    """

    def __init__(self, condition: TrialCondition, scales: Scales) -> None:
        """At rest at the start.

        Args:
            condition: Of the trial.
            scales: Standardise the continuation in c_i.

        Raises:
            InputError: The trial is over before it begins.
        """
        self.rollout = Rollout(condition)
        if self.rollout.over:
            reason = self.rollout.failure or f"{STARTS_BROKEN}the plank bridges the gap"
            raise InputError(reason, field="condition.plank")
        contacts = np.array(condition.contacts, np.float64)
        self._observations = Observations(contacts, np.array(condition.goal, np.float64), scales)
        self._of_contacts = contact_map(contacts)
        self._fit = np.linalg.pinv(self._of_contacts)  # G^-1 J^T
        self.q_task = task_value(self.rollout.pose)
        self._plan: Float[np.ndarray, "steps 3"] | None = None
        self._planned_at = 0

    @property
    def q_safe(self) -> float:
        """At the present pose."""
        return safe_value(self.rollout.pose, self._observations.places(self.rollout.pose))

    def advance(self, velocities: Float[np.ndarray, "robots 2"]) -> None:
        """One action: the plank follows the body twist that fits the contact points' velocities best."""
        twists = (self._fit @ velocities.reshape(-1))[None]
        verdict = execute(self.rollout.pose, twists, self.rollout.condition.contacts)
        self.rollout.carry_out(twists, verdict)
        self.q_task = task_value(self.rollout.pose)

    def velocities_of(self, twist: Float[np.ndarray, " 3"]) -> Float[np.ndarray, "robots 2"]:
        """Velocities of the contact points when the plank moves by a body twist."""
        return (self._of_contacts @ twist).reshape(-1, 2)

    def set_plan(self, twists: Float[np.ndarray, "steps 3"] | None) -> None:
        """Sets the planned actions, starting with the next one."""
        self._plan, self._planned_at = twists, len(self.rollout.twists)

    def ahead(self) -> Float[np.ndarray, "horizon 3"]:
        """The continuation: the rest of the plan, blended from the last action; without a plan, the last action."""
        if self._plan is None:
            return np.tile(self.rollout.twist, (HORIZON, 1))
        elapsed = len(self.rollout.twists) - self._planned_at
        rest = self._plan[np.minimum(np.arange(elapsed, elapsed + HORIZON), len(self._plan) - 1)]
        return self.rollout.twist + _BLEND * (rest - self.rollout.twist)

    def read(self) -> Float[np.ndarray, "robots entries"]:
        """Each robot's observation, in the order of `ObservationParts`."""
        return self._observations(self.rollout.pose, self.rollout.twist, self.ahead())

    def policy_condition(self) -> BridgeCondition:
        """The condition of a policy generated now; numpy arrays in float64."""
        contacts = np.array(self.rollout.condition.contacts, np.float64)
        goal, present = (
            np.array(self.rollout.condition.goal, np.float64),
            np.ones(len(contacts), bool),
        )
        leaves: Any = (
            self.rollout.pose.copy(),
            self.rollout.twist.copy(),
            goal,
            contacts,
            present,
            self.ahead(),
        )
        return BridgeCondition(*leaves)

    def process(self) -> Process:
        """The trial so far, for pictures; the robots' goals beyond the gap serve only for drawing."""
        twists = self.rollout.executed()
        between = sub_poses(
            np.array(self.rollout.poses[:-1]).reshape(-1, 3), twists, round(DT / TICK)
        )
        plank = np.concatenate([self.rollout.poses[0][None], between.reshape(-1, 3)])
        robots = np.array([self._observations.places(pose) for pose in plank])
        goals = random_goals(robots.shape[1], np.random.default_rng(0))
        goal = np.array(self.rollout.condition.goal, np.float64)
        stage: Stage = "build"
        return Process(plank, robots, (stage,) * len(plank), goals, goal, self.rollout.failure)
