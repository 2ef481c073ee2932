"""Printers: named expressions -> files. They know nothing of robots."""
