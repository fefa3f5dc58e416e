"""States of random trials, and the twists that generative states stand for, robot by robot."""

import numpy as np

from deggflow.tasks.bridge.codec import spline_matrix
from deggflow.tasks.bridge.condition import BridgeCondition, Scales
from deggflow.tasks.bridge.scenes import random_conditions

AGENTS, T, K = 6, 20, 8
SCALES = Scales(eta=tuple(np.random.default_rng(0).uniform(0.02, 0.2, 3 * K).tolist()))


def random_state(robots, seed):
    """A random trial in motion, with a continuation; numpy arrays in float64."""
    rng = np.random.default_rng([seed, robots])
    trial = random_conditions(robots, 1, seed)[0]
    contacts, mask = np.zeros((AGENTS, 2)), np.arange(AGENTS) < robots
    contacts[:robots] = trial.contacts
    ahead = rng.normal(size=3) * [0.15, 0.1, 0.08] + 0.02 * rng.normal(size=(T, 3))
    plank, goal = np.array(trial.plank), np.array(trial.goal)
    return BridgeCondition(plank, ahead[0], goal, contacts, mask, ahead)


def at_rest(robots, seed):
    zero = np.zeros((T, 3))
    return random_state(robots, seed)._replace(twist=zero[0], continuation=zero)


def decoded(z, state, scales):
    """The team's twists, robot by robot."""
    g, pull = np.zeros((3, 3)), np.zeros((K, 3))
    for i in np.flatnonzero(state.mask):
        r = state.contacts[i]
        jacobian = np.array([[1.0, 0.0, -r[1]], [0.0, 1.0, r[0]]])
        g += jacobian.T @ jacobian
        pull += (z[i] * scales.eta).reshape(K, 3) @ (jacobian.T @ jacobian)
    return state.continuation + spline_matrix() @ np.linalg.solve(g, pull.T).T
