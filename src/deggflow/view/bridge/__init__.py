"""Pictures, videos and plots of Task 1, the bridge."""

from .figures import SuccessBars, picture_column, success_bars
from .pictures import compare, picture, snapshots
from .plots import BoundPanel, PathGroup, bounds_figure, draw_bounds, draw_paths
from .video import write_process_video

__all__ = [
    "BoundPanel",
    "PathGroup",
    "SuccessBars",
    "bounds_figure",
    "compare",
    "draw_bounds",
    "draw_paths",
    "picture",
    "picture_column",
    "snapshots",
    "success_bars",
    "write_process_video",
]
