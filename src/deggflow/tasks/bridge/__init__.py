"""Robots push a plank over a gap and cross it (paper, Task 1)."""
