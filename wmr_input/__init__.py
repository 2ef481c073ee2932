"""What people write, read safely: TOML files and arithmetic expressions, with errors that name the remedy.

Both sides of the house stand on this package and it knows neither: `derive` turns expressions into SymPy,
`wmr_afl` into CasADi. It holds the one exception family of the project.
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
