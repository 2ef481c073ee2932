"""NumPy: plain functions of arrays, batches in front."""

from pathlib import Path

from ..dialect import FilledResult

NUMPY = FilledResult(
    folder=Path(__file__).parent,
    file="numpy_model.py",
    title="NumPy",
    usage=(
        "Every argument may carry batches in front, (..., size), which broadcast against each other;",
        "results carry them too. Inside the functions entries stand in front, x[2], and batches behind.",
    ),
    reserved=("np", "math", "functools", "out"),
)
