"""A robot from its log: reading, checks, base parameters by weak form and output error, physical parameters."""
