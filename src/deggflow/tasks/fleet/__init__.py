"""Disc robots share a floor: paths from starts to goals among obstacles."""
