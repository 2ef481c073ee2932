"""Safe reading of what people write: TOML files and arithmetic expressions, with errors that name the remedy.

`derive` and `wmr_afl` both import this package; it imports neither. It holds the project's one family of exceptions.
"""

from wmr_input.errors import InputError, WmrError, closest, nearest
from wmr_input.expression import LONGEST_FORMULA, Algebra, ExpressionError, evaluate
from wmr_input.toml_file import read_toml

__all__ = [
    "LONGEST_FORMULA",
    "Algebra",
    "ExpressionError",
    "InputError",
    "WmrError",
    "closest",
    "evaluate",
    "nearest",
    "read_toml",
]
