"""The certificate game: random problems, and a judge in NumPy that shares no code with deggflow."""
