"""NumPy: plain functions of arrays, batches in front."""

from .module import Dialect

NUMPY = Dialect(
    file="numpy_model.py",
    title="NumPy",
    usage=(
        "Every argument may carry batches in front, (..., size), which broadcast against each other;",
        "results carry them too. Inside the functions entries stand in front, x[2], and batches behind.",
    ),
    imports="numpy_imports.jinja",
    helpers="numpy_helpers.jinja",
)


CASADI = Dialect(
    file="casadi_model.py",
    title="CasADi",
    usage=(
        "Every term is a casadi.Function with named inputs and outputs, vectors are columns;",
        "called with SX it inlines.",
    ),
    imports="casadi_imports.jinja",
    helpers="casadi_helpers.jinja",
)
