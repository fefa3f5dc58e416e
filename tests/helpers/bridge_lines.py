"""A bridge condition and a trial as their lines have them, and copies with one entry changed."""

import copy
import json

CONDITION = {
    "plank": {"x": -3.2, "y": 0.5, "theta": 0.1},
    "goal": {"x": -0.2, "y": 0, "theta": 0},
    "contacts": [[-2.4, 0.36], [-2.4, -0.36], [1.0, 0.36]],
}
POLICY = {
    "q_task": -0.5,
    "bound": -0.4,
    "q_safe": -1.5,
    "draws": 2,
    "accepted": True,
    "speed": 0.31,
}
REQUIREMENT = {
    "name": "q_task",
    "value": -0.5,
    "limit": -0.4,
    "excess": -0.01,
    "active_points": 40,
    "smallest_ell_norm": 0.02,
}
MADE = {
    "hypotheses_hold": False,
    "first_failure": "robot 2 did not meet its row of q_safe at 3 points",
    "requirements": [REQUIREMENT, {**REQUIREMENT, "name": "q_safe", "smallest_ell_norm": None}],
    "steps": 51,
    "refused_steps": 2,
    "forced_steps": 0,
    "least_opposed_sine": 0.125,
    "largest_input_norm": 3.5,
    "largest_step": 3.5,
}
TRIAL = {
    "condition": CONDITION,
    "dt": 0.2,
    "twists": [[0.1, 0.0, -0.2], [0.2, 0, 0]],
    "poses": [[-3.2, 0.5, 0.1], [-3.18, 0.5, 0.06], [-3.14, 0.5, 0.06]],
    "outcome": {"success": False, "reason": "robot 1 enters the gap"},
    "certificate": {
        "satisfied": False,
        "min_margin": -0.01,
        "violation": 0,
        "draws": 2,
        "reason": "robot 1 enters the gap",
        "policies": [POLICY],
    },
    "seed": 7,
}


def line(value):
    return json.dumps(value).encode()  # NaN and Infinity as Python writes them


def edited(value, path, new):
    """A copy with one entry replaced or added; `...` removes it."""
    out = copy.deepcopy(value)
    *way, last = path
    place = out
    for key in way:
        place = place[key]
    if new is ...:
        del place[last]
    else:
        place[last] = new
    return out
