"""CasADi: functions with named inputs and outputs."""

from pathlib import Path

from ..dialect import FilledResult

CASADI = FilledResult(
    folder=Path(__file__).parent,
    file="casadi_model.py",
    title="CasADi",
    usage=(
        "Every term is a casadi.Function with named inputs and outputs, vectors are columns;",
        "called with SX it inlines.",
    ),
    reserved=("SX", "Function", "out"),
)
