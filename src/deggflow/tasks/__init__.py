"""Tasks built on the core; a task knows nothing of another."""
