"""Pictures, videos and plots of Task 1, the bridge."""

from .paths import PathGroup, draw_paths
from .pictures import compare, picture, snapshots
from .video import write_process_video

__all__ = [
    "PathGroup",
    "compare",
    "draw_paths",
    "picture",
    "snapshots",
    "write_process_video",
]
