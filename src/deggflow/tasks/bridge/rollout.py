"""A trial executed action by action: poses of the plank, executed actions, and the outcome."""

import numpy as np
from jaxtyping import Float

from .condition import TrialCondition
from .verdict import Verdict, bridges, margins

STARTS_BROKEN = "at the start "


class Rollout:
    """A trial in progress.

    Attributes:
        condition: Of the trial.
        poses: Of the plank, the initial one and one after each action (m, m, rad).
        twists: Executed body twists (m/s, m/s, rad/s).
        bridged: Whether the plank bridges the gap.
        failure: The first failure, or why the team stopped; None otherwise.
    """

    def __init__(
        self, condition: TrialCondition, twist: Float[np.ndarray, " 3"] | None = None
    ) -> None:
        """Args: condition: of the trial; twist: the plank's at the start, zero by default."""
        self.condition = condition
        self.poses = [np.array(condition.plank, np.float64)]
        self.twists: list[Float[np.ndarray, " 3"]] = []
        self._first_twist = np.zeros(3) if twist is None else twist
        start = margins(self.pose[None], condition.contacts)
        broken = bool(start.least()[0] < 0)
        self.failure: str | None = STARTS_BROKEN + str(start.reason(0)) if broken else None
        self.bridged = not broken and bool(bridges(self.pose))

    @property
    def pose(self) -> Float[np.ndarray, " 3"]:
        """The plank's current pose."""
        return self.poses[-1]

    @property
    def twist(self) -> Float[np.ndarray, " 3"]:
        """The plank's current twist: that of the last action."""
        return self.twists[-1] if self.twists else self._first_twist

    @property
    def over(self) -> bool:
        """Whether the gap is bridged, something failed, or the team stopped."""
        return self.bridged or self.failure is not None

    def executed(self) -> Float[np.ndarray, "actions 3"]:
        """All executed twists."""
        return np.array(self.twists).reshape(-1, 3)

    def carry_out(self, twists: Float[np.ndarray, "actions 3"], verdict: Verdict) -> None:
        """Executes actions until the verdict by `execute` from the current pose ends them."""
        self.twists += list(twists[: verdict.actions])
        self.poses += list(verdict.poses[1:])
        self.bridged, self.failure = verdict.bridged, verdict.reason

    def stop(self, reason: str) -> None:
        """The team stops at its current pose."""
        self.failure = reason
