"""The target languages, a folder each: its dialect, imports and helpers."""

from .casadi import CASADI
from .numpy import NUMPY

TARGETS = (NUMPY, CASADI)
