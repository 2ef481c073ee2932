"""A law in a robot's own loop: traced once, then run from Python or carried away as C."""
