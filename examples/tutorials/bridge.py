"""
# Robots build a bridge

Robots push a plank over a gap and cross it, in closed loop: a flow generates a policy of twenty actions, four of them are
executed, and the next policy is generated. All robots share two requirements, progress and safety along the motion.
[The guide](../bridge.md) has the modelling choices and results.
"""

# %%
import numpy as np
from matplotlib import pyplot

from deggflow.tasks.bridge.field import load_field
from deggflow.tasks.bridge.generator import BridgeGenerator
from deggflow.tasks.bridge.requirements import bridge_guidance
from deggflow.tasks.bridge.scenes import random_conditions

# %%
# ## Two trials of four robots
#
# On the command line: `deggflow bridge generate --size 4 --count 2 --out trials.jsonl`, and `deggflow bridge render
# trials.jsonl --video`.

field = load_field()
conditions = random_conditions(4, 2, seed=1)
trials = BridgeGenerator(field, bridge_guidance(field.scales)).trials(conditions, seed=1)
for trial in trials:
    certificate = trial.certificate
    print(
        f"satisfied: {certificate.satisfied}, least margin {certificate.min_margin:.3f} m, {len(trial.twists)} actions"
    )

# %%
# ## The plank's way
#
# Every policy that was executed has its record in the trial's certificate: both factors below their bounds at its end.

_, axes = pyplot.subplots(figsize=(7, 3))
for trial in trials:
    x, y, _ = np.asarray(trial.poses).T
    axes.plot(x, y, ".-", label=f"trial {trials.index(trial) + 1}")
axes.set(xlabel="x of the plank (m)", ylabel="y (m)")
axes.legend()
policy = trials[0].certificate.policies[0]
print(
    f"first policy: q_task {policy.q_task:.2f} <= {policy.bound:.2f}, q_safe {policy.q_safe:.2f} <= 0"
)
