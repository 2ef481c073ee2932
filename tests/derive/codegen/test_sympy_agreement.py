"""Generated code equals SymPy's own evaluation of the derived expressions at 30 digits."""

import mpmath
import numpy as np
import sympy as sp

from derive.codegen.quantities import quantities
from derive.derivation import Derivation
from wmr_afl.model.laws import Situation


def test_generated_code_equals_sympy_at_30_digits(derivation: Derivation, situation: Situation) -> None:
    count = 3
    for quantity in quantities(derivation):
        arguments = [situation.arguments[argument.name][:count] for argument in quantity.arguments]
        generated = situation.numpy.functions()[quantity.name](*arguments).reshape(count, *quantity.expression.shape)
        exact = np.zeros(generated.shape)
        for row in range(count):
            values = {
                symbol: mpmath.mpf(float(number))
                for argument, given in zip(quantity.arguments, arguments, strict=True)
                for symbol, number in zip(argument.entries, given[row], strict=True)
            }
            exact[row] = evaluated(derivation, quantity.expression, values)
        scale = np.maximum(np.abs(exact).max(axis=0), 1e-3)
        assert np.all(np.abs(generated - exact) <= 1e-12 * scale), quantity.name


def evaluated(derivation: Derivation, matrix: sp.Matrix, values: dict[sp.Symbol, mpmath.mpf]) -> np.ndarray:
    """`matrix` in 30-digit arithmetic, definition by definition."""
    values = dict(values)
    with mpmath.workdps(30):
        for symbol, definition in derivation.terms.needed(list(matrix)).items():
            values[symbol] = _number(definition, values)
        return np.array([float(_number(entry, values)) for entry in matrix]).reshape(matrix.shape)


def _number(expression: sp.Expr, values: dict[sp.Symbol, mpmath.mpf]) -> mpmath.mpf:
    symbols = sorted(expression.free_symbols, key=lambda symbol: symbol.name)
    return sp.lambdify(symbols, expression, "mpmath")(*(values[symbol] for symbol in symbols))
