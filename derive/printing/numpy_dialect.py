"""NumPy: plain functions of arrays, batches in front."""

from derive.printing.module import Dialect

NUMPY = Dialect(
    file="numpy_model.py",
    template="numpy_model.py.jinja",
    read="{argument}[..., {index}]",
    write_vector="out[..., {row}]",
    write_matrix="out[..., {row}, {column}]",
)
