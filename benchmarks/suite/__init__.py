"""The benchmark suite: what is measured, one subject a file; `run.py` is the command."""
