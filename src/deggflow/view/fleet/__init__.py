"""Pictures and videos of plans."""
