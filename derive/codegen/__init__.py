"""A derivation -> files: generated modules, model.json, derivation.md."""
