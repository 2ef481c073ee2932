"""Exact algebra over symbols; it knows no robot."""
