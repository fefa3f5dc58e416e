"""The world as a process: it holds the plank, and moves it as robots' commands say."""

import json
import time
from collections.abc import Sequence
from hashlib import sha256
from typing import Any

import numpy as np
from jaxtyping import Float

from deggflow.runtime import TeamError, Timing, Transport

from .condition import TrialCondition
from .observations import contact_map
from .rollout import Rollout
from .verdict import execute
from .world import EXECUTED

PREFIX = b"dgfworld"  # of all messages between robots and world
LARGEST = 10.0  # m/s, of a commanded velocity
SINGULAR = 1e-6  # least singular value of a team that holds the plank


def encode(**values: Any) -> bytes:
    """The bytes of a message between robots and world; numbers keep all digits."""
    return PREFIX + json.dumps(values).encode()


def decode(message: bytes | None, trial: str, kind: str) -> dict[str, Any] | None:
    """A message of a trial and of one kind; None for any other."""
    if message is None:
        return None
    try:
        values = json.loads(message[len(PREFIX) :])
    except ValueError:
        return None
    if not isinstance(values, dict) or (values.get("trial"), values.get("kind")) != (trial, kind):
        return None
    return values


def trial_name(condition: TrialCondition, number: int) -> str:
    """Tells a trial from others, of other runs too."""
    digest = sha256(json.dumps(condition.to_json(), sort_keys=True).encode()).hexdigest()
    return f"{number}-{digest[:16]}"


class World:
    """One trial: what robots command, and where the plank goes.

    The plank follows the body twist that fits the commanded velocities of the contact points best, by least squares; the
    body of a robot that commands nothing is carried along.

    Attributes:
        rollout: The trial so far.
        policy: Number of the policy that is awaited.
    """

    def __init__(self, condition: TrialCondition, number: int) -> None:
        """Args: condition: of the trial; number: of the trial in its run."""
        self.rollout, self.policy = Rollout(condition), 0
        self._name = trial_name(condition, number)
        self._of_contacts = contact_map(np.array(condition.contacts, np.float64)).reshape(-1, 2, 3)
        self._commands: dict[int, Float[np.ndarray, "actions 2"]] = {}
        self._lost: set[int] = set()
        self._done: set[int] = set()
        self._executed: Float[np.ndarray, "actions 3"] = np.zeros((0, 3))
        self._stopped = False

    @property
    def over(self) -> bool:
        """Whether the trial is over."""
        return self._stopped or self.rollout.over

    @property
    def waiting(self) -> bool:
        """Whether some robots have commanded, and others have not."""
        return bool(self._commands)

    @property
    def everybody_is_done(self) -> bool:
        """Whether all robots that are not lost know how the trial ended."""
        return self._members() <= self._done

    def state(self) -> bytes:
        """What robots are told: which policy is awaited, and the twists that were executed of the one before."""
        return encode(
            kind="state", trial=self._name, policy=self.policy, twists=self._executed.tolist(),
            over=self.over,
        )  # fmt: skip

    def take(self, message: bytes) -> None:
        """A message of a robot; what is of another trial, policy or form is dropped."""
        done = decode(message, self._name, "done")
        if done is not None and done.get("robot") in self._members():
            self._done.add(done["robot"])
        command = decode(message, self._name, "command")
        if command is None or command.get("policy") != self.policy or self.over:
            return
        robot, lost = command.get("robot"), command.get("lost")
        velocities = _velocities(command.get("velocities"))
        if not isinstance(robot, int) or not isinstance(lost, list):
            return
        if robot not in range(len(self._of_contacts)):
            return
        self._lost |= set(lost) - {robot}
        if command.get("stop"):
            self._stopped = True
        elif velocities is not None:
            self._commands[robot] = velocities
            if self._members() <= self._commands.keys():
                self.act()

    def act(self) -> None:
        """Executes what has been commanded, though commands of some robots may be missing."""
        here = sorted(self._commands)
        jacobian = self._of_contacts[here].reshape(-1, 3)
        singular = np.linalg.svd(jacobian, compute_uv=False)
        if len(singular) < 3 or singular[-1] < SINGULAR:  # a twist has three components
            self._stopped = True
            return
        wanted = np.stack([self._commands[k] for k in here], axis=1).reshape(EXECUTED, -1)
        twists = wanted @ np.linalg.pinv(jacobian).T
        verdict = execute(self.rollout.pose, twists, self.rollout.condition.contacts)
        self.rollout.carry_out(twists, verdict)
        self._executed, self._commands = twists, {}
        self.policy += 1

    def _members(self) -> set[int]:
        return set(range(len(self._of_contacts))) - self._lost


def _velocities(value: Any) -> Float[np.ndarray, "actions 2"] | None:
    try:
        velocities = np.array(value, np.float64)
    except (TypeError, ValueError):
        return None
    fits = velocities.shape == (EXECUTED, 2) and bool(np.all(np.abs(velocities) <= LARGEST))
    return velocities if fits else None


def run_world(
    condition: TrialCondition, number: int, transport: Transport, timing: Timing
) -> Rollout:
    """Plays one trial with robots that are other processes, until it is over.

    Args:
        condition: Of the trial.
        number: Of the trial in its run.
        transport: To the robots, for messages that begin with `PREFIX`.
        timing: How long to wait for some robots once others have commanded (`deadline`), and for all of them (`join`).

    Raises:
        TeamError: No robot commands anything.
    """
    world = World(condition, number)
    last_heard = first_command = next_tick = time.monotonic()
    while not (world.over and world.everybody_is_done):
        now = time.monotonic()
        if now >= next_tick:
            transport.broadcast(world.state())
            next_tick = now + timing.tick
        message = transport.receive(max(next_tick - now, 0.0))
        before, waited = world.policy, world.waiting
        if message is not None:
            world.take(message)
            last_heard = time.monotonic()
        if world.waiting and not waited:
            first_command = time.monotonic()
        if world.waiting and time.monotonic() - first_command > timing.deadline:
            world.act()
        if world.policy != before:
            next_tick = 0.0
        silent = time.monotonic() - last_heard
        if world.over and silent > timing.deadline:
            break
        if silent > timing.join:
            raise TeamError(f"no robot was heard for {timing.join:g} s.")
    return world.rollout


class ToWorld:
    """A robot's link to the world.

    Attributes:
        robot: Number of the robot.
    """

    def __init__(self, robot: int, transport: Transport, timing: Timing) -> None:
        """Args: robot: its number; transport: for messages that begin with `PREFIX`; timing: repetitions and patience."""
        self.robot, self._transport, self._timing, self._trial = robot, transport, timing, ""

    def begin(self, condition: TrialCondition, number: int) -> None:
        """Waits until the world has begun a trial.

        Raises:
            TeamError: It does not.
        """
        self._trial = trial_name(condition, number)
        self._await(lambda state: state["policy"] == 0 and not state["over"], b"")

    def execute(
        self, policy: int, velocities: Float[np.ndarray, "actions 2"], lost: Sequence[int]
    ) -> Float[np.ndarray, "actions 3"]:
        """Commands the robot's own contact point; returns the plank's body twists as the world executed them.

        Raises:
            TeamError: The world does not answer.
        """
        command = self._command(policy, lost, velocities=velocities.tolist())
        state = self._await(lambda state: state["policy"] == policy + 1, command)
        return np.array(state["twists"], np.float64).reshape(-1, 3)

    def stop(self, policy: int, lost: Sequence[int]) -> None:
        """Ends the trial where it stands."""
        self._await(lambda state: state["over"], self._command(policy, lost, stop=True))

    def finish(self) -> None:
        """Tells the world that this robot knows how the trial ended."""
        for _ in range(3):
            self._transport.broadcast(encode(kind="done", trial=self._trial, robot=self.robot))

    def _command(self, policy: int, lost: Sequence[int], **values: Any) -> bytes:
        common = {"trial": self._trial, "policy": policy, "robot": self.robot, "lost": list(lost)}
        return encode(kind="command", **common, **values)

    def _await(self, wanted: Any, command: bytes) -> dict[str, Any]:
        """Repeats a command until the world is in a wanted state."""
        end, next_tick = time.monotonic() + self._timing.join, 0.0
        while True:
            now = time.monotonic()
            if now > end:
                raise TeamError(f"the world did not answer within {self._timing.join:g} s.")
            if command and now >= next_tick:
                self._transport.broadcast(command)
                next_tick = now + self._timing.tick
            message = self._transport.receive(self._timing.tick)
            state = decode(message, self._trial, "state")
            if state is not None and wanted(state):
                return state
