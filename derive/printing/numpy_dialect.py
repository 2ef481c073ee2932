"""NumPy: plain functions of arrays, batches in front."""

from derive.printing.module import Dialect

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
