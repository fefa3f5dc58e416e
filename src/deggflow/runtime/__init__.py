"""Every agent its own process: each computes its own input from states, and survivors agree on who was lost."""
