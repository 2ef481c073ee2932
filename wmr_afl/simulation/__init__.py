"""A closed loop and its numbers -> trajectories; it knows no TOML."""
