"""Robots that follow a plan in MuJoCo's dynamics, and how closely they do."""

from dataclasses import dataclass
from typing import Any

import numpy as np
from jaxtyping import Float

from deggflow.tasks.fleet.clearance import clearance
from deggflow.tasks.fleet.plan import Plan
from deggflow.view.stage import import_physics

from .mjcf import TIMESTEP, Scale, fleet_mjcf
from .robots import Drive, wheel_speeds

TICK = 0.01  # s, from a command to the next
GAIN = 4.0  # 1/s, velocity by which a robot makes up for its distance to the plan
FASTEST = 1.5  # largest commanded speed, over the speed limit
REST = 1.0  # s, after the last waypoint

Positions = Float[np.ndarray, "ticks robots 2"]


@dataclass(frozen=True)
class Playback:
    """A motion that follows a plan.

    Attributes:
        plan: What is followed.
        drive: Of the robots.
        scale: Metres of a map unit, and seconds from a waypoint to the next.
        states: MuJoCo's generalised positions at every tick, the first one at the start.
        commands: Of the servos from each tick to the next.
        positions: Of the robots' centres at every tick, in m.
    """

    plan: Plan
    drive: Drive
    scale: Scale
    states: Float[np.ndarray, "ticks coordinates"]
    commands: Float[np.ndarray, "moves servos"]
    positions: Positions

    @property
    def time(self) -> Float[np.ndarray, " ticks"]:
        """Of every tick, in s."""
        return TICK * np.arange(len(self.positions))

    def deviations(self) -> Float[np.ndarray, " ticks"]:
        """Largest distance of a robot from where the plan has it at each tick, in m."""
        where = np.array([reference(self.plan, self.scale, t).place for t in self.time])
        return np.linalg.norm(self.positions - where, axis=-1).max(1)

    def gaps(self) -> Float[np.ndarray, " ticks"]:
        """Least distance between two discs at each tick, in m; infinite for one robot, negative where discs overlap."""
        least = np.full(len(self.positions), np.inf)
        for robot in range(1, self.positions.shape[1]):
            away = self.positions[:, :robot] - self.positions[:, robot, None]
            least = np.minimum(least, np.linalg.norm(away, axis=-1).min(1))
        return least - 2 * self.plan.condition.radius * self.scale.metres

    def clearances(self) -> Float[np.ndarray, " ticks"]:
        """Least distance of a disc from an obstacle or the bounds at each tick, in m; negative where it reaches into them."""
        floor, places = self.plan.condition.floor, self.positions / self.scale.metres
        low, high = np.reshape(floor.bounds, (2, 2))
        room = np.minimum(places - low, high - places).min(-1)
        room = np.minimum(room, clearance(floor, places)).min(1)
        return (room - self.plan.condition.radius) * self.scale.metres

    def text(self) -> str:
        """The largest deviation and the least distances in a line, in mm and in map units."""

        def both(length: float) -> str:
            return f"{1e3 * length:.1f} mm ({length / self.scale.metres:.2g} map units)"

        kind = {"omni": "omnidirectional", "differential": "differential-drive"}[self.drive]
        apart = (
            f"{both(self.gaps().min())} from each other and " if len(self.plan.paths) > 1 else ""
        )
        return (
            f"{kind} robots in MuJoCo are never more than {both(self.deviations().max())} away from the plan; "
            f"their discs keep {apart}{both(self.clearances().min())} from obstacles and bounds "
            f"(a map unit is {self.scale.metres:g} m, a step {self.scale.seconds:g} s)"
        )


@dataclass(frozen=True)
class Reference:
    """Where a plan has its robots at a time.

    Attributes:
        place: In m.
        velocity: Until the next waypoint, in m/s.
    """

    place: Float[np.ndarray, "robots 2"]
    velocity: Float[np.ndarray, "robots 2"]


def reference(plan: Plan, scale: Scale, time: float) -> Reference:
    """Where a plan has its robots at a time (s): on straight lines between waypoints, then at the goals."""
    paths, steps = scale.metres * plan.paths, plan.paths.shape[1] - 1
    if time >= steps * scale.seconds:
        return Reference(paths[:, -1], np.zeros_like(paths[:, -1]))
    step = min(int(time / scale.seconds), steps - 1)
    move = paths[:, step + 1] - paths[:, step]
    return Reference(
        paths[:, step] + (time / scale.seconds - step) * move,
        move / scale.seconds,
    )


def play(plan: Plan, drive: Drive = "omni", scale: Scale | None = None) -> Playback:
    """Robots follow a plan in MuJoCo: servos get the plan's velocity and `GAIN` times the distance to it, every `TICK`.

    No robot is told to move faster than `FASTEST` times the speed limit. Robots start at rest, those with a differential drive with their front in the direction of their first step. Discs
    collide with each other, with obstacles and with walls at the bounds.

    Args:
        plan: What is followed.
        drive: Of the robots.
        scale: Metres of a map unit, and seconds from a waypoint to the next.

    Raises:
        InputError: If the robots are too small or too large to be driven.

    Example:
        >>> from deggflow.certificate import Certificate
        >>> from deggflow.tasks.fleet.condition import FleetCondition, Robot
        >>> condition = FleetCondition("empty", (Robot((0.0, 0.0), (0.5, 0.0)),))
        >>> straight = np.linspace(condition.starts, condition.goals, 64, axis=1)
        >>> plan = Plan(condition, straight, Certificate(True, 0.1, 0.0, 1, None), seed=0)
        >>> bool(play(plan).deviations().max() < 0.005)
        True
    """
    scale = Scale() if scale is None else scale
    mujoco = import_physics()
    model = mujoco.MjModel.from_xml_string(fleet_mjcf(plan, drive, scale))
    data = mujoco.MjData(model)
    fastest = FASTEST * plan.condition.speed_limit * scale.metres / scale.seconds
    duration = (plan.paths.shape[1] - 1) * scale.seconds + REST
    states, commands, positions = [data.qpos.copy()], [], [_places(data, drive)]
    for tick in range(round(duration / TICK)):
        target = reference(plan, scale, tick * TICK)
        velocity = target.velocity + GAIN * (target.place - positions[-1])
        speed = np.linalg.norm(velocity, axis=-1, keepdims=True)
        velocity *= fastest / np.maximum(speed, fastest)
        if drive == "differential":
            velocity = wheel_speeds(velocity, _headings(data), plan.condition.radius * scale.metres)
        data.ctrl[:] = velocity.ravel()
        mujoco.mj_step(model, data, round(TICK / TIMESTEP))
        commands.append(velocity.ravel())
        states.append(data.qpos.copy())
        positions.append(_places(data, drive))
    return Playback(plan, drive, scale, np.array(states), np.array(commands), np.array(positions))


_COORDINATES = {"omni": 2, "differential": 9}  # of a robot: x, y; or place, quaternion, wheels


def _places(data: Any, drive: Drive) -> Float[np.ndarray, "robots 2"]:
    """Of the robots' centres, in m."""
    return data.qpos.reshape(-1, _COORDINATES[drive])[:, :2].copy()


def _headings(data: Any) -> Float[np.ndarray, " robots"]:
    """Directions (rad) of the fronts of robots with a differential drive."""
    w, x, y, z = data.qpos.reshape(-1, _COORDINATES["differential"])[:, 3:7].T
    return np.arctan2(2 * (w * z + x * y), 1 - 2 * (y**2 + z**2))
