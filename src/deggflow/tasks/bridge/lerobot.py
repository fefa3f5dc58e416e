"""Trials as episodes of a LeRobot data set."""

import numpy as np

from deggflow.tables.lerobot import ACTION, ENVIRONMENT, STATE, Episode, EpisodeFormat

from .trial import Trial
from .world import DT, MAX_ROBOTS

_POSE = ("x", "y", "theta")
_CONTACTS = [f"{name}_{k}" for k in range(1, MAX_ROBOTS + 1) for name in ("r_x", "r_y", "present")]

_FORMAT = EpisodeFormat(
    "plank carried by robots",
    round(1 / DT),
    {
        STATE: _POSE,
        ENVIRONMENT: [*(f"goal_{name}" for name in _POSE), *_CONTACTS],
        ACTION: ("v_x", "v_y", "omega"),
    },
)


def format_of(trial: Trial) -> EpisodeFormat:
    """The same for all trials."""
    return _FORMAT


def episode(trial: Trial) -> Episode:
    """A trial as an episode: the plank's pose, the goal and the contact points, and the executed body twist.

    The last pose, at which no action follows, is not a frame. Contact points of absent robots are zero.
    """
    frames = len(trial.twists)
    contacts = np.zeros((MAX_ROBOTS, 3))
    contacts[: len(trial.condition.contacts)] = [(*r, 1.0) for r in trial.condition.contacts]
    around = np.concatenate([trial.condition.goal, contacts.reshape(-1)])
    features = {
        STATE: trial.poses[:-1],
        ENVIRONMENT: np.broadcast_to(around, (frames, len(around))),
        ACTION: trial.twists,
    }
    task = "Push the plank over the gap until it bridges it."
    return Episode(features, trial.success, trial.certificate.satisfied, task)
