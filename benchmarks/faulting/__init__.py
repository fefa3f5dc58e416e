"""Faults in the middle of commands: what is run, and what happens to it."""
