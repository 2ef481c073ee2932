"""A robot description in TOML -> a robot in symbols, every mistake in one line."""
