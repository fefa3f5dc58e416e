"""Plans as episodes of a LeRobot data set."""

from itertools import product

import numpy as np

from deggflow.tables.lerobot import ACTION, ENVIRONMENT, STATE, Episode, EpisodeFormat

from .plan import Plan


def format_of(plan: Plan) -> EpisodeFormat:
    """Of a data set of plans with as many robots as this one; one frame is one step, which has no unit of time."""
    robots = range(1, len(plan.condition.robots) + 1)
    features = {
        name: [f"{quantity}_{k}" for k, quantity in product(robots, quantities)]
        for name, quantities in (
            (STATE, ("x", "y")),
            (ENVIRONMENT, ("goal_x", "goal_y")),
            (ACTION, ("v_x", "v_y")),
        )
    }
    features[ENVIRONMENT] += ["radius", "speed_limit"]
    return EpisodeFormat("disc robots on a floor", 1, features)


def episode(plan: Plan) -> Episode:
    """A plan as an episode: where robots are and go, and the step that each takes next, in map units.

    The last waypoint, at which no step follows, is not a frame. The episode's task names the map.
    """
    condition, paths = plan.condition, plan.paths.swapaxes(0, 1)  # waypoints x robots x 2
    steps = np.diff(paths, axis=0)
    goals = [each for robot in condition.robots for each in robot.goal]
    around = np.array([*goals, condition.radius, condition.speed_limit])
    name = condition.map if isinstance(condition.map, str) else "of its own"
    satisfied = plan.certificate.satisfied
    return Episode(
        {
            STATE: paths[:-1].reshape(len(steps), -1),
            ENVIRONMENT: np.broadcast_to(around, (len(steps), len(around))),
            ACTION: steps.reshape(len(steps), -1),
        },
        satisfied,
        satisfied,
        f"Reach the goals on the map {name}.",
    )
