"""CasADi: each function traced once into a `casadi.Function`, which inlines when called with SX."""

from derive.printing.module import Dialect

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
