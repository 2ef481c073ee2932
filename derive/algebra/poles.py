"""Which divisors leave a pole: functions are looked at where a divisor vanishes, to many digits.

What was divided by in a derivation may cancel later, and may vanish nowhere. So it is a singularity of what came out
only if that has no value, or a huge one, next to a zero of the divisor.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator, Mapping, Sequence
from itertools import pairwise

import mpmath
from mpmath import mpf
from sympy import Expr, Pow, Symbol

from .evaluation import Evaluation, NotFinite
from .named_terms import Terms, sorted_symbols

_DIGITS = 60
_STEP = mpf("1e-20")  # from a zero to where a pole is noticed
_HUGE = mpf("1e8")  # the square root of a divisor grows to 1e10 at that step
_GRID = 96  # places along a coordinate where a change of sign is looked for
_REACH = mpf("3.2")  # rad or m: angles all around
_DRAWS = 6  # of the other coordinates and of the parameters
_HALVINGS = 50
_SECANTS = 6  # each doubles the digits, or nearly so
_CANCELLED = mpf("1e-40")  # a divisor this small is zero


def leaves_a_pole(
    divisor: Expr,
    functions: Sequence[Expr],
    coordinates: Sequence[Symbol],
    numbers: Mapping[Symbol, Expr],
    terms: Terms,
) -> bool:
    """Whether one of `functions` is not defined next to a zero of `divisor`, for parameters around `numbers`."""
    with mpmath.workdps(_DIGITS):
        place = _Places(divisor, coordinates, numbers, terms)
        return any(place.is_undefined(functions, zero, moving) for zero, moving in place.zeros())


class _Places:
    """Configurations where a divisor vanishes."""

    def __init__(
        self, divisor: Expr, coordinates: Sequence[Symbol], numbers: Mapping[Symbol, Expr], terms: Terms
    ) -> None:
        self.divisor, self.terms = divisor, terms
        self.coordinates = list(coordinates)
        self.moving = sorted_symbols(terms.atoms(divisor) & set(coordinates))
        self.numbers = numbers

    def zeros(self) -> Iterator[tuple[dict[Symbol, mpf], Symbol]]:
        """Configurations of zeros, each with the coordinate along which it was found."""
        for draw in range(_DRAWS):
            for moving in self.moving:
                parameters = {s: _generic(number, k, draw) for k, (s, number) in enumerate(self.numbers.items())}
                place = parameters | {q: self._number(k, draw) for k, q in enumerate(self.coordinates)}
                for root in self._roots(place, moving):
                    yield place | {moving: root}, moving

    def _number(self, index: int, draw: int) -> mpf:
        """An ordinary number in (-1, 1), another one for each coordinate and draw."""
        return mpf((29 + 37 * index + 53 * draw) % 101) * 2 / 101 - 1

    def _roots(self, place: dict[Symbol, mpf], moving: Symbol) -> Iterator[mpf]:
        def value(number: mpf) -> mpf | None:
            return _value(self.divisor, place | {moving: number}, self.terms)

        grid = [_REACH * (2 * mpf(k) / _GRID - 1) + mpf("0.0123") for k in range(_GRID + 1)]
        values = [value(number) for number in grid]
        for (low, high), (low_value, high_value) in zip(pairwise(grid), pairwise(values), strict=True):
            if low_value is None or high_value is None or low_value * high_value > 0:
                continue
            root = _refined(value, low, high)
            if root is not None:
                yield root

    def is_undefined(self, functions: Sequence[Expr], zero: dict[Symbol, mpf], moving: Symbol) -> bool:
        """Whether one of `functions` has no value at a zero, or a huge one next to it."""
        if abs(_value(self.divisor, zero, self.terms) or 0) > _CANCELLED:
            return False  # a change of sign through a pole of the divisor itself
        for side in (_STEP, -_STEP):
            evaluation = Evaluation(zero | {moving: zero[moving] + side}, self.terms.definitions)
            for function in functions:
                try:
                    if abs(evaluation(function)) > _HUGE:
                        return True
                except (NotFinite, ZeroDivisionError):
                    return True
        return any(self._divides(function, zero) for function in functions)

    def _divides(self, function: Expr, zero: Mapping[Symbol, mpf]) -> bool:
        """Whether the text of `function` divides by zero there, even if the quotient has a limit."""
        whole = [function, *self.terms.needed([function]).values()]
        bases = {power.base for one in whole for power in one.atoms(Pow) if power.exp.is_negative}
        values = [_value(base, zero, self.terms) for base in bases]
        return any(value is not None and abs(value) < _CANCELLED for value in values)


def _generic(number: Expr, index: int, draw: int) -> mpf:
    """A parameter's number, at first moved a little, so that nothing cancels by chance, then by factors up to 4."""
    moved = mpf(4) ** (mpf((13 + 29 * index + 47 * draw) % 97) / 48 - 1) if draw else 1 + mpf(29 * index % 97) / 1000
    return moved * Evaluation({}, {})(number) if number != 0 else moved / 10


def _value(expression: Expr, numbers: Mapping[Symbol, mpf], terms: Terms) -> mpf | None:
    try:
        return Evaluation(numbers, terms.definitions)(expression)
    except (NotFinite, ZeroDivisionError):
        return None


def _refined(value: Callable[[mpf], mpf | None], low: mpf, high: mpf) -> mpf | None:
    """The zero between two places of opposite signs: halved to a double's digits, then by secants."""
    low_value = value(low)
    for _ in range(_HALVINGS):
        middle = (low + high) / 2
        middle_value = value(middle)
        if middle_value is None or low_value is None:
            return None
        if middle_value * low_value > 0:
            low, low_value = middle, middle_value
        else:
            high = middle
    first, second = low, high
    for _ in range(_SECANTS):
        one, two = value(first), value(second)
        if one is None or two is None or one == two:
            break
        first, second = second, second - two * (second - first) / (two - one)
    return second
