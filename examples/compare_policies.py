"""Compares policies in the bridge's PettingZoo environment by their successes over the same random trials.

Run `pip install 'deggflow[env]'`, then `python examples/compare_policies.py --trials 20 --robots 6`. Your own policy can
be a function like `straight`, or an object with a memory like `Generated`. Random trials have an unobstructed straight
path to the goal, so `straight` solves them. For harder comparisons, pass your own conditions to `reset`.
"""

from collections import Counter

import jax
import numpy as np
import tyro

from deggflow.redraw import Candidate, redraw_until_satisfied
from deggflow.statistics import Rate
from deggflow.tasks.bridge.condition import HALF_Y
from deggflow.tasks.bridge.environment import parallel_env
from deggflow.tasks.bridge.field import SHIPPED, load_field
from deggflow.tasks.bridge.policies import PolicyGenerator, initial_noise
from deggflow.tasks.bridge.requirements import bridge_guidance
from deggflow.tasks.bridge.scenes import random_conditions
from deggflow.tasks.bridge.world import CONTACT_SIDE, DT, EXECUTED, PLANK_LENGTH

DRAWS = 8  # at most, per guided policy


def straight(env, observations, trial, action):
    """Each robot moves straight to the goal while turning, based only on its own c_i."""
    actions = {}
    for robot, observation in observations.items():
        r_x, side, ahead, aside, turn = observation[env.observation_parts.contact][:5]
        x, y, angle = ahead * PLANK_LENGTH, aside * HALF_Y, turn * np.pi / 3
        pace = 0.35 / max(np.hypot(x, y), 0.35)  # 1/s: at 0.35 m/s, slower near the goal
        spin = np.clip(pace * angle, -0.3, 0.3)
        turning = spin * np.array([-side * CONTACT_SIDE, r_x * PLANK_LENGTH / 2])
        actions[robot] = pace * np.array([x, y]) + turning
    return actions


class Generated:
    """The shipped field, nominal or guided: 20 actions are generated and 4 executed before the next generation."""

    def __init__(self, guided):
        field = load_field()
        self.guided = guided
        self.generator = PolicyGenerator(field, bridge_guidance(field.scales) if guided else None)

    def __call__(self, env, observations, trial, action):
        """The robots' velocities; None if no draw of a guided policy meets its bounds, and the team stops."""
        if action % EXECUTED == 0:
            now = jax.tree.map(lambda leaf: leaf[None], env.policy_condition())

            def attempt(_, draw):
                noise = initial_noise(0, np.array([trial]), action // EXECUTED, draw)
                policy = self.generator.batch(noise, now)
                met = policy.q_task[0] <= policy.bound[0] and policy.q_safe[0] <= 0
                return [Candidate(policy.twists[0], met or not self.guided, 0.0)]

            (result,) = redraw_until_satisfied(attempt, 1, DRAWS)
            if not result.satisfied:
                return None
            self.plan = result.sample
            env.set_plan(self.plan)
        return env.velocities_of(self.plan[action % EXECUTED])


def play(policy, env, condition, trial):
    """The outcome of a trial and its duration in seconds."""
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
    """Prints each policy's successes with a 95% Wilson interval, and the outcomes of the other trials."""
    policies = {"straight": straight}
    if SHIPPED.exists():
        policies |= {"nominal": Generated(guided=False), "guided": Generated(guided=True)}
    else:
        print("this package has no trained weights; deggflow's own policies are skipped")
    conditions = random_conditions(robots, trials, seed)
    env = parallel_env(robots)
    for name, policy in policies.items():
        outcomes = [play(policy, env, condition, k) for k, condition in enumerate(conditions)]
        counts = Counter(outcome for outcome, _ in outcomes)
        rate = Rate(counts.pop("bridged", 0), trials)
        durations = [seconds for outcome, seconds in outcomes if outcome == "bridged"]
        notes = [f"in {np.mean(durations):.1f} s"] if durations else []
        notes += [f"{count} x {outcome}" for outcome, count in counts.most_common()]
        print(
            f"{name:9}{rate.successes:3} of {rate.cases}  {rate!s:24} {', '.join(notes)}",
            flush=True,
        )


if __name__ == "__main__":
    tyro.cli(main)
