"""Policies side by side in the bridge's PettingZoo environment: successes over the same random trials.

After `pip install 'deggflow[env]'`: `python examples/compare_policies.py --trials 20 --robots 6`. Your own policy
is a function like `straight`, or an object with a memory like `Generated`. Random trials have a straight way to
the goal, so `straight` bridges them; give conditions of your own to `reset` to tell policies apart further.
"""

from collections import Counter

import jax
import numpy as np
import tyro

from deggflow.redraw import Candidate, redraw_until_satisfied
from deggflow.statistics import Rate
from deggflow.tasks.bridge.condition import HALF_Y
from deggflow.tasks.bridge.environment import parallel_env
from deggflow.tasks.bridge.field import load_field, shipped_weights
from deggflow.tasks.bridge.policies import PolicyGenerator, initial_noise
from deggflow.tasks.bridge.requirements import bridge_guidance
from deggflow.tasks.bridge.scenes import random_conditions
from deggflow.tasks.bridge.world import CONTACT_SIDE, DT, EXECUTED, PLANK_LENGTH

DRAWS = 8  # of a guided policy, at most


def straight(env, observations, trial, action):
    """Every robot by itself, from its c_i alone: straight to the goal, turning on the way."""
    actions = {}
    for robot, seen in observations.items():
        r_x, side, ahead, aside, turn = seen[env.observation_parts.contact][:5]
        x, y, angle = ahead * PLANK_LENGTH, aside * HALF_Y, turn * np.pi / 3
        pace = 0.35 / max(np.hypot(x, y), 0.35)  # 1/s: at 0.35 m/s, slower near the goal
        spin = np.clip(pace * angle, -0.3, 0.3)
        turning = spin * np.array([-side * CONTACT_SIDE, r_x * PLANK_LENGTH / 2])
        actions[robot] = pace * np.array([x, y]) + turning
    return actions


class Generated:
    """The shipped field, nominal or guided: 20 actions are generated, 4 of them executed, and again."""

    def __init__(self, guided):
        field = load_field()
        self.guided = guided
        self.generator = PolicyGenerator(field, bridge_guidance(field.scales) if guided else None)

    def __call__(self, env, observations, trial, action):
        """None where no draw meets its bounds: a guided team stops."""
        if action % EXECUTED == 0:
            now = jax.tree.map(lambda leaf: leaf[None], env.policy_condition())

            def attempt(_, draw):
                noise = initial_noise(0, np.array([trial]), action // EXECUTED, draw)
                found = self.generator.batch(noise, now)
                met = found.q_task[0] <= found.bound[0] and found.q_safe[0] <= 0
                return [Candidate(found.twists[0], met or not self.guided, 0.0)]

            (drawn,) = redraw_until_satisfied(attempt, 1, DRAWS)
            if not drawn.satisfied:
                return None
            self.plan = drawn.sample
            env.set_plan(self.plan)
        return env.velocities_of(self.plan[action % EXECUTED])


def play(policy, env, condition, trial):
    """How a trial ends, and after how many seconds."""
    observations, infos = env.reset(options={"condition": condition})
    action = 0
    while env.agents:
        actions = policy(env, observations, trial, action)
        if actions is None:
            return "stopped by its policy", action * DT
        observations, _, _, _, infos = env.step(actions)
        action += 1
    end = infos["robot_1"]
    return "bridged" if end["success"] else end["failure"] or "out of time", action * DT


def main(trials: int = 20, robots: int = 6, seed: int = 1) -> None:
    """Prints every policy's successes with a 95% Wilson interval, and how the other trials ended."""
    policies = {"straight": straight}
    if shipped_weights().exists():
        policies |= {"nominal": Generated(guided=False), "guided": Generated(guided=True)}
    else:
        print("no trained weights in this package: deggflow's own policies are left out")
    conditions = random_conditions(robots, trials, seed)
    env = parallel_env(robots)
    for name, policy in policies.items():
        ended = [play(policy, env, condition, k) for k, condition in enumerate(conditions)]
        counts = Counter(end for end, _ in ended)
        rate = Rate(counts.pop("bridged", 0), trials)
        took = [seconds for end, seconds in ended if end == "bridged"]
        notes = [f"in {np.mean(took):.1f} s"] if took else []
        notes += [f"{count} x {end}" for end, count in counts.most_common()]
        print(
            f"{name:9}{rate.successes:3} of {rate.cases}  {rate!s:24} {', '.join(notes)}",
            flush=True,
        )


if __name__ == "__main__":
    tyro.cli(main)
