"""The one door to generated code."""
