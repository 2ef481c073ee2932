"""Experiments: read from TOML, assembled into closed loops, run."""
