"""NumPy: plain functions of arrays, batches in front."""

from pathlib import Path

from ..dialect import FilledResult


class _Arrays(FilledResult):
    def called(self, function: str) -> str:
        """What the decorator has wrapped: inside, entries stand in front."""
        return f"{function}.__wrapped__"


NUMPY = _Arrays(
    folder=Path(__file__).parent,
    file="numpy_model.py",
    title="NumPy",
    usage=(
        "Every argument may carry batches in front, (..., size), which broadcast against each other;",
        "results carry them too. Inside the functions entries stand in front, x[2], and batches behind.",
    ),
    reserved=("np", "math", "functools", "out"),
)
