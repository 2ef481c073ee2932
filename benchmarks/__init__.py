"""Timed comparisons: ratios within one run, after checking that the contenders agree. Never part of the tests."""
