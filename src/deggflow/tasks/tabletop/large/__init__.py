"""Large scenes: tabletop scenes of any number of objects, types repeating, at a cost per object that does not grow.

The table is divided into windows of about the size of the table the field was trained on; each object's z is its place
in its own window. Field and requirements look at neighbours within a cut-off radius alone, across windows. What a finished
large scene is judged by is the same exact geometry as any scene's.
"""

from .condition import is_large
from .generator import LargeSceneGenerator, large_scene_guidance, large_scenes_like, make_scenes

__all__ = [
    "LargeSceneGenerator",
    "is_large",
    "large_scene_guidance",
    "large_scenes_like",
    "make_scenes",
]
