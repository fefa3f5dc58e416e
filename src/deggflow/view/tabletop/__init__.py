"""Pictures, videos and MuJoCo models of Task 2, the tabletop."""

from .mjcf import scene_mjcf
from .pictures import render
from .video import write_video

__all__ = ["render", "scene_mjcf", "write_video"]
