"""Pictures, videos and plots of Task 1, the bridge."""

from .pictures import compare, picture, snapshots
from .plots import BoundPanel, PathGroup, draw_bounds, draw_paths
from .video import write_process_video

__all__ = [
    "BoundPanel",
    "PathGroup",
    "compare",
    "draw_bounds",
    "draw_paths",
    "picture",
    "snapshots",
    "write_process_video",
]
