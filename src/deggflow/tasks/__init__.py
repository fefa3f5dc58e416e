"""Tasks built on the core, independent of each other."""
