"""
# Large scenes

The work per agent need not grow with the number of agents, if each depends on its neighbours only. The tabletop shows
this with up to thousands of objects, from the field that was trained on four to six. [The guide](../halls.md) explains
windows, neighbour lists and local shares.
"""

# %%
from matplotlib import pyplot

from deggflow.tasks.tabletop.changes import random_conditions
from deggflow.tasks.tabletop.field import load_field
from deggflow.tasks.tabletop.large.generator import LargeSceneGenerator
from deggflow.view.tabletop.topview import topview_image

# %%
# ## Forty objects
#
# On the command line: `deggflow tabletop generate --size 40 --out scenes.jsonl`.

condition = random_conditions(40, 1, "changed", seed=1)[0]
scene = LargeSceneGenerator(load_field()).scene(condition, seed=1, number=0)
print(scene.certificate.table())

# %%
# ## A picture
#
# What is red violates a requirement; regions that must stay free are shaded.

_, axes = pyplot.subplots(figsize=(7, 5))
axes.imshow(topview_image(condition, scene.poses, scene.verdict(), 1400, 1000))
axes.axis("off")
