"""Models: the only way to generated code."""
