"""What an experiment's TOML may hold: one kind of table a file."""
