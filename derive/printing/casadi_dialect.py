"""CasADi: each function traced once into a `casadi.Function`, which inlines when called with SX."""

from derive.printing.module import Dialect

CASADI = Dialect(
    file="casadi_model.py",
    template="casadi_model.py.jinja",
    read="{argument}[{index}]",
    write_vector="out[{row}]",
    write_matrix="out[{row}, {column}]",
)
