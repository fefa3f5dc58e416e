"""A trial carried out action by action, in numpy: robots pull, the plank moves, exact predicates judge."""

from typing import Any

import numpy as np
from jaxtyping import Float

from deggflow.jsonl import InputError

from .codec import BLENDED
from .condition import BridgeCondition, Scales, TrialCondition
from .drive import random_goals
from .observations import Observations, contact_map, safe_value, task_value
from .process import TICK, Process, Stage
from .verdict import bridges, margins, move, on_the_way, sub_poses
from .world import DT, HORIZON

_BLEND = np.minimum(np.arange(1, HORIZON + 1) / (BLENDED + 1), 1.0)[:, None]


class Episode:
    """Where the plank is, what was executed, what is planned, and what came of it."""

    def __init__(self, condition: TrialCondition, scales: Scales) -> None:
        """At rest at the start.

        Args:
            condition: Of the trial.
            scales: Standardise the continuation in c_i.

        Raises:
            InputError: The trial is over before it begins.
        """
        pose = np.array(condition.plank, np.float64)
        start = margins(pose[None], condition.contacts)
        if start.least()[0] < 0:
            raise InputError(f"at the start {start.reason(0)}", field="condition.plank")
        if bridges(pose[None])[0]:
            raise InputError("at the start the plank bridges the gap", field="condition.plank")
        contacts = np.array(condition.contacts, np.float64)
        self.condition, self.poses = condition, [pose]
        self.twists: list[np.ndarray] = []
        self.success = False
        self.failure: str | None = None
        self._observations = Observations(contacts, np.array(condition.goal, np.float64), scales)
        self._of_contacts = contact_map(contacts)
        self._fit = np.linalg.pinv(self._of_contacts)  # G^-1 J^T
        self.q_task = task_value(pose)
        self._plan: Float[np.ndarray, "steps 3"] | None = None
        self._planned_at = 0

    @property
    def pose(self) -> Float[np.ndarray, " 3"]:
        """Of the plank."""
        return self.poses[-1]

    @property
    def twist(self) -> Float[np.ndarray, " 3"]:
        """Of the last action; zero at the start."""
        return self.twists[-1] if self.twists else np.zeros(3)

    @property
    def q_safe(self) -> float:
        """At the present pose."""
        return safe_value(self.pose, self._observations.places(self.pose))

    def advance(self, velocities: Float[np.ndarray, "robots 2"]) -> None:
        """One action: the plank follows the body twist that fits the contact points' velocities best."""
        twist = self._fit @ velocities.reshape(-1)
        after = move(self.pose, twist)
        (passed,) = on_the_way(self.pose[None], twist[None], self.condition.contacts)
        self.failure = passed.reason
        self.success = passed.reason is None and bool(bridges(after))
        self.twists.append(twist)
        self.poses.append(after)
        self.q_task = task_value(self.pose)

    def velocities_of(self, twist: Float[np.ndarray, " 3"]) -> Float[np.ndarray, "robots 2"]:
        """Velocities of the contact points when the plank moves by a body twist."""
        return (self._of_contacts @ twist).reshape(-1, 2)

    def set_plan(self, twists: Float[np.ndarray, "steps 3"] | None) -> None:
        """What the coming actions are planned to be, counted from the next one on."""
        self._plan, self._planned_at = twists, len(self.twists)

    def ahead(self) -> Float[np.ndarray, "horizon 3"]:
        """The continuation: the rest of the plan, led over to from the last action; without a plan, that action."""
        if self._plan is None:
            return np.tile(self.twist, (HORIZON, 1))
        done = len(self.twists) - self._planned_at
        rest = self._plan[np.minimum(np.arange(done, done + HORIZON), len(self._plan) - 1)]
        return self.twist + _BLEND * (rest - self.twist)

    def read(self) -> Float[np.ndarray, "robots entries"]:
        """What each robot reads, in the order of `ObservationParts`."""
        return self._observations(self.pose, self.twist, self.ahead())

    def policy_condition(self) -> BridgeCondition:
        """What a policy generated now is conditioned on; numpy arrays in float64."""
        contacts = np.array(self.condition.contacts, np.float64)
        goal, present = np.array(self.condition.goal, np.float64), np.ones(len(contacts), bool)
        leaves: Any = self.pose.copy(), self.twist.copy(), goal, contacts, present, self.ahead()
        return BridgeCondition(*leaves)

    def process(self) -> Process:
        """The trial so far, for pictures; the robots' goals beyond the gap are only there to be drawn."""
        twists = np.array(self.twists).reshape(-1, 3)
        between = sub_poses(np.array(self.poses[:-1]).reshape(-1, 3), twists, round(DT / TICK))
        plank = np.concatenate([self.poses[0][None], between.reshape(-1, 3)])
        robots = np.array([self._observations.places(pose) for pose in plank])
        goals = random_goals(robots.shape[1], np.random.default_rng(0))
        goal = np.array(self.condition.goal, np.float64)
        stage: Stage = "build"
        return Process(plank, robots, (stage,) * len(plank), goals, goal, self.failure)
