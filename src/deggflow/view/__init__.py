"""Pictures: what tasks share here, what draws each task in a folder of its own."""
