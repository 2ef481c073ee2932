"""`trusted_values.json`: every generated function's value at fixed arguments, computed from the derived expressions.

Neither common subexpressions nor a printer have a part in these values: when a new SymPy writes other text, they say
whether the meaning is the same.
"""

from __future__ import annotations

from typing import Any

import mpmath
import sympy as sp
from mpmath import mpf
from sympy import Matrix, Symbol

from ..algebra.evaluation import Evaluation, NotFinite
from ..algebra.finite_field import NotRepresentable
from ..derivation import Derivation
from .arguments import arguments_of
from .quantities import Quantity

_DIGITS = 50
_NOISE = mpf("1e-30")  # of a function's largest entry; what cancels leaves less than that
_CANDIDATES = 40
_DOUBLE = 53  # bits
_ROUNDING = 4 * 2.0**-52  # of a function's largest entry
_ENOUGH = 2e-13  # of an entry


def trusted_values(derivation: Derivation, functions: list[Quantity]) -> dict[str, Any]:
    """Arguments and values of `functions` there, correctly rounded: flat for a vector, by rows for a matrix.

    Raises:
        NotRepresentable: If no configuration is found where all of them are finite.
    """
    best: tuple[float, dict[str, Any]] | None = None
    undefined = None
    for attempt in range(_CANDIDATES):
        try:
            with mpmath.workdps(_DIGITS):
                found = _at(derivation, functions, attempt)
            with mpmath.workprec(_DOUBLE):
                lost = _lost(found["values"], _at(derivation, functions, attempt)["values"])
        except (NotFinite, ZeroDivisionError) as error:
            undefined = error.args[0] if error.args else None
            continue
        if best is None or lost < best[0]:
            best = lost, found
        if lost <= _ENOUGH:
            break
    if best is None:
        raise NotRepresentable(undefined)
    return best[1]


def _lost(values: dict[str, list[Any]], rounded: dict[str, list[Any]]) -> float:
    """How much of an entry rounding costs at most: near a singularity doubles cannot agree with many digits."""
    worst = 0.0
    for name, function in values.items():
        expected, found = _flat(function), _flat(rounded[name])
        noise = _ROUNDING * max(map(abs, expected), default=0.0)
        for one, other in zip(expected, found, strict=True):
            worst = max(worst, (abs(one - other) - noise) / max(abs(one), 1e-300))
    return worst


def _flat(rows: list[Any]) -> list[float]:
    return [entry for row in rows for entry in (row if isinstance(row, list) else [row])]


def _at(derivation: Derivation, functions: list[Quantity], attempt: int) -> dict[str, Any]:
    numbers = _arguments(derivation, attempt)
    value = Evaluation(numbers, derivation.terms.definitions)
    parameters = zip(derivation.adaptive.theta, derivation.adaptive.base_parameters, strict=True)
    numbers |= {theta: float(value(expression)) for theta, expression in parameters}
    return {
        "arguments": {
            name: [numbers[symbol] for symbol in argument.entries]
            for name, argument in arguments_of(derivation).items()
        },
        "values": {function.name: _rows(function, value) for function in functions},
    }


def _arguments(derivation: Derivation, attempt: int) -> dict[Symbol, float]:
    """Ordinary numbers, other ones for each attempt; parameters within a fifth of their defaults. Not theta."""
    d, numbers = derivation, {}
    vectors = (d.state, d.dynamics.inputs, d.dynamics.loads, d.adaptive.accelerations, d.reference_velocities)
    for place, symbols in enumerate(vectors):
        for index, symbol in enumerate(symbols):
            numbers[symbol] = float(3 * _fraction(place, index, attempt) - sp.Rational(149, 100))
    for index, (symbol, default) in enumerate(d.robot.defaults.items()):
        numbers[symbol] = float(default * (sp.Rational(4, 5) + sp.Rational(2, 5) * _fraction(9, index, attempt)))
    return numbers


def _fraction(place: int, index: int, attempt: int) -> sp.Rational:
    """A number of hundredths in [0, 1), well spread over neighbouring indices."""
    return sp.Rational((17 + 29 * place + 37 * index + 13 * attempt) % 100, 100)


def _rows(function: Quantity, value: Evaluation) -> list[Any]:
    matrix: Matrix = function.expression
    numbers = [value(entry) for entry in matrix]
    noise = _NOISE * max(map(abs, numbers), default=mpf(0))
    rounded = [0.0 if abs(number) <= noise else float(number) for number in numbers]
    if function.is_vector:
        return rounded
    return [rounded[i * matrix.cols : (i + 1) * matrix.cols] for i in range(matrix.rows)]
