"""
# Robots share a floor

Six disc robots cross a conveyor hall at once. A flow generates smooth paths for all of them; guidance moves the paths
until every requirement holds at all times, between waypoints too. [The guide](../fleet.md) has the maps, the method and
results.
"""

# %%
import numpy as np
from matplotlib import pyplot

from deggflow.tasks.fleet.drawn import random_conditions
from deggflow.tasks.fleet.field import load_field
from deggflow.tasks.fleet.generator import FleetGenerator
from deggflow.tasks.fleet.options import FleetFieldOptions
from deggflow.tasks.fleet.verdict import judge
from deggflow.view.fleet.topview import pixels, plan_figure

# %%
# ## One plan
#
# On the command line: `deggflow fleet generate --size 6 --map conveyor --scheme own --out plans.jsonl`, and `deggflow
# fleet render plans.jsonl`.

[condition] = random_conditions(6, 1, "conveyor", "own", seed=1)
generator = FleetGenerator(load_field(), FleetFieldOptions())
[plan] = generator.plans([condition], seed=1, max_draws=4)
print(plan.certificate.table())

# %%
# Dark is early, light is late; rings are starts and crosses are goals.

_, axes = pyplot.subplots(figsize=(5, 5))
axes.imshow(pixels(plan_figure(plan)))
axes.axis("off")

# %%
# ## What the plan must satisfy
#
# Guidance follows a sum of [named requirements](requirements.md), `apart + inside + speed + outside`, which has one V and
# one row for each robot. The verdict has the least margin of each by itself, in map units. Starts and goals hold exactly.

ends, *others = plan.verdict().misses
for least in others:
    print(
        f"{least.kind:8} {least.margin:.3f}  robot {least.robot + 1}, from waypoint {least.step + 1} on"
    )

# %%
# ## Paths made elsewhere
#
# The verdict has a closed form and shares no code with guidance. It judges any paths of shape (robots, 64, 2), here
# straight lines at constant speed, and names the worst miss.

time = np.linspace(0.0, 1.0, 64)[:, None]
starts, goals = condition.starts[:, None], condition.goals[:, None]
straight = starts + time * (goals - starts)
straight[:, -1] = condition.goals
[verdict] = judge([condition], [straight])
print(verdict.reason())
print(
    f"V of the straight lines: {verdict.violation:.3f}; of the plan: {plan.certificate.violation:.2g}"
)
assert plan.certificate.satisfied
assert not verdict.satisfied
