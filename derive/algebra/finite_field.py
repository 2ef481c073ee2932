"""Exact answers without simplification: evaluate at random points of a finite field.

An expression that vanishes at a few random points of a field with 2^61 elements vanishes identically, but for
odds of about 1e-18 (Schwartz, Zippel). Ranks, linear dependencies and zero tests thus cost one evaluation each, where
symbolic simplification may take minutes and still not decide.

An angle a is represented by the unit z = exp(i a): the field is chosen to hold i, the square roots of small
numbers and roots of unity, so that cos a = (z + 1/z)/2, sin a = (z - 1/z)/(2 i) and every trigonometric identity holds.
"""

import hashlib
from collections.abc import Callable, Iterator, Mapping
from functools import cache
from math import gcd
from typing import Any

import sympy as sp
from sympy import Expr, Symbol
from sympy.ntheory.residue_ntheory import sqrt_mod
from sympy.polys.matrices import DomainMatrix
from sympy.polys.polyerrors import NotInvertible

from .dual_numbers import Dual, base

_FRACTIONS = 720720  # angles occur as multiples of this part of pi: halves, thirds, ... sixteenths


# 1 + a multiple of 8, of 2 _FRACTIONS, of 17 and of 19, close to 2^61; all primes below 100 have roots modulo it.
PRIME = 2304643347494167681


# Units of angles are drawn as this power. What denominators have in common with PRIME - 1, up to twelve decimals,
# divides it, so that every rational multiple has a unit, and sin(a), sin(0.37 a) and sin(1.37 a) keep their identities.
_STEPS = 2**12 * 3**6 * 5**12 * 7**2 * 11 * 13 * 17 * 19


FIELD = sp.FF(PRIME, symmetric=False)


_POINTS_A_DRAW, _DRAWS = 8, 250  # of what is drawn once: tried until a value exists


SEEDS = 4  # points a zero test looks at


TRIED_POINTS = 400  # points tried to find some at which roots exist; each root exists at every other point


Element = Any  # of FIELD, or a Dual over it


class NotRepresentable(ArithmeticError):
    """`expression` has no value at this point: a division by zero or a root that the field lacks."""

    def __init__(self, expression: Expr | None = None) -> None:
        self.expression = expression  # None while it is not known which one
        super().__init__(expression)


def _hashed(*key: object) -> int:
    digest = hashlib.blake2b(repr(key).encode(), digest_size=16).digest()
    return 1 + int.from_bytes(digest, "big") % (PRIME - 1)


@cache
def _root_of_unity(order: int) -> int:
    """The same primitive root of unity at every call: exp(2 pi i / order)."""
    factors = sp.primefactors(PRIME - 1)
    generator = next(g for g in range(2, 1000) if all(pow(g, (PRIME - 1) // q, PRIME) != 1 for q in factors))
    return pow(generator, (PRIME - 1) // order, PRIME)


@cache
def _root_of_prime(prime: int) -> int:
    """sqrt(prime); up to 19 by Gauss's sum over roots of unity, so that 2 cos(pi/6) = sqrt(3) holds with its sign."""
    if prime == 2:
        unit = _root_of_unity(8)
        return (unit + pow(unit, -1, PRIME)) % PRIME
    if prime <= 19:  # each of these divides PRIME - 1
        unit = _root_of_unity(prime)
        gauss = sum(sp.legendre_symbol(k, prime) * pow(unit, k, PRIME) for k in range(1, prime)) % PRIME
        return gauss if prime % 4 == 1 else gauss * pow(_root_of_unity(4), -1, PRIME) % PRIME
    return _any_root(prime)


def _any_root(number: int) -> int:
    root = sqrt_mod(number, PRIME)
    if root is None:
        raise NotRepresentable
    return int(root)


def _root_of_constant(basis: Expr, value: Element) -> Element:
    """sqrt(basis) for nested radicals: those that occur are cosines up to sqrt(q), as sin(pi/5)."""
    for order in (16, 20, 24):  # fractions of pi; with them 5, 8, 10 and 12
        unit = FIELD(_root_of_unity(2 * order))
        for k in range(1, order // 2):
            scale = sp.nsimplify(sp.N(basis / sp.cos(k * sp.pi / order) ** 2, 30), rational=True, tolerance=1e-20)
            cosine = _HALF * (unit**k + 1 / unit**k)
            if scale.q <= 1000 and Point(0)(scale) * cosine * cosine == value:
                return Point(0)(sp.sqrt(scale)) * cosine
    return FIELD(_any_root(int(value)))


IMAGINARY = FIELD(_root_of_unity(4))


_HALF = 1 / FIELD(2)


class Point:
    """A random point: every symbol has a value drawn from the seed and its name, unless `values` gives one."""

    def __init__(
        self,
        seed: int,
        definitions: Mapping[Symbol, Expr] | None = None,
        values: Mapping[Symbol, Element] | None = None,
    ) -> None:
        self.seed = seed
        self.definitions = definitions or {}
        self._memo: dict[Expr, Element] = dict(values or {})
        self._turned: dict[Expr, tuple[Element, Element]] = {}

    def __call__(self, expression: Expr) -> Element:
        """The value of `expression` here.

        Raises:
            NotRepresentable: If it has none in the field.
        """
        if expression not in self._memo:
            try:
                self._memo[expression] = self._value(expression)
            except (ZeroDivisionError, NotInvertible):
                raise NotRepresentable(expression) from None
            except NotRepresentable as error:
                raise NotRepresentable(error.expression or expression) from None
        return self._memo[expression]

    def rank(self, matrix: sp.Matrix) -> int:
        """The rank of `matrix` here."""
        rows = [[self(entry) for entry in matrix.row(i)] for i in range(matrix.rows)]
        return DomainMatrix(rows, matrix.shape, FIELD).rank()

    def determinant(self, matrix: sp.Matrix) -> int:
        """The determinant of `matrix` here."""
        rows = [[self(entry) for entry in matrix.row(i)] for i in range(matrix.rows)]
        return int(DomainMatrix(rows, matrix.shape, FIELD).det())

    def _value(self, expression: Expr) -> Element:
        if expression.is_Symbol:
            defined = self.definitions.get(expression)
            if defined is not None:
                return self(defined)
            return FIELD(_hashed(self.seed, expression.name)) ** 2  # a square, so that sqrt(a b) exists everywhere
        if expression.is_Rational:
            if expression.q % PRIME == 0:
                raise NotRepresentable(expression)
            return FIELD(expression.p) / FIELD(expression.q)
        if expression.is_Add:
            return sum((self(term) for term in expression.args), FIELD(0))
        if expression.is_Mul:
            product = FIELD(1)
            for factor in expression.args:
                product = product * self(factor)
            return product
        if expression.is_Pow:
            return self._power(*expression.args)
        if isinstance(expression, sp.sin | sp.cos | sp.tan):
            unit, inverse = self._units(expression.args[0])
            cosine, sine = _HALF * (unit + inverse), _HALF / IMAGINARY * (unit - inverse)
            return cosine if expression.func == sp.cos else sine if expression.func == sp.sin else sine / cosine
        if isinstance(expression, sp.exp):
            return self._exponential(expression.args[0])
        if expression is sp.E:
            return self._exponential(sp.S.One)
        if isinstance(expression, sp.tanh):
            squared = self._exponential(2 * expression.args[0])
            return (squared - 1) / (squared + 1)
        if isinstance(expression, sp.Abs):
            return _size(self(expression.args[0]))
        if isinstance(expression, sp.sign):
            value = self(expression.args[0])
            return _size(value) / value
        return self._opaque(expression)

    def _power(self, basis: Expr, exponent: Expr) -> Element:
        if exponent.is_Integer:
            value = self(basis)
            return value ** int(exponent) if exponent > 0 else 1 / value ** int(-exponent)
        if exponent.is_Rational and exponent.q == 2:
            return self._root(basis) ** int(exponent.p) if exponent > 0 else 1 / self._root(basis) ** int(-exponent.p)
        return self._opaque(basis**exponent)

    def _root(self, basis: Expr) -> Element:
        if basis.is_Rational:  # prime by prime, so that sqrt(2) sqrt(3) = sqrt(6)
            root = FIELD(1)
            for prime, power in sp.factorint(basis).items():
                factor = FIELD(_root_of_prime(int(prime))) ** abs(power)
                root = root * factor if power > 0 else root / factor
            return root
        value = self(basis)
        return _square_root(value) if basis.free_symbols else _root_of_constant(basis, value)

    def _exponential(self, exponent: Expr) -> Element:
        """exp, term by term, so that exp(a + 2 b) = exp(a) exp(b)^2."""
        product: Element = FIELD(1)
        for term in sp.Add.make_args(sp.expand(exponent)):
            factor, rest = term.as_coeff_Mul()
            if not factor.is_Integer:
                factor, rest = sp.S.One, term
            value = self(rest)
            drawn = FIELD(_hashed("exp", int(base(value)))) ** abs(int(factor))
            drawn = drawn if factor > 0 else 1 / drawn
            product = product * (value.rotated(drawn, self(factor)) if isinstance(value, Dual) else drawn)
        return product

    def _units(self, angle: Expr) -> tuple[Element, Element]:
        """exp(i angle) and exp(-i angle); sine and cosine share them."""
        if angle not in self._turned:
            unit = self._unit(angle)
            self._turned[angle] = unit, 1 / unit
        return self._turned[angle]

    def _unit(self, angle: Expr) -> Element:
        """exp(i angle)."""
        unit: Element = FIELD(1)
        for term in sp.Add.make_args(sp.expand(angle)):
            factor, rest = term.as_coeff_Mul()
            steps = factor * _FRACTIONS
            if rest == sp.pi and steps.is_Integer:
                unit = unit * FIELD(_root_of_unity(2 * _FRACTIONS)) ** (int(steps) % (2 * _FRACTIONS))
                continue
            if factor.is_Integer and rest.func in _UNITS:
                turned = _UNITS[rest.func](*map(self, rest.args))
                unit = unit * (turned if factor > 0 else 1 / turned) ** abs(int(factor))
                continue
            exponent = _exponent(factor)
            if exponent is None:
                factor, rest, exponent = sp.S.One, term, _exponent(sp.S.One)
            value = self(rest)
            turned = FIELD(_hashed("unit", int(base(value)))) ** exponent
            unit = unit * (value.rotated(turned, IMAGINARY * self(factor)) if isinstance(value, Dual) else turned)
        return unit

    def _opaque(self, expression: Expr) -> Element:
        """A function without algebraic identities: a value that depends on its arguments' values alone."""
        values = [self(argument) for argument in expression.args]
        if not any(isinstance(value, Dual) for value in values):
            return _drawn(expression.func.__name__, values)
        if expression.func not in _SLOPES:
            raise NotRepresentable(expression)
        return _continued(expression.func.__name__, values, _SLOPES[expression.func])


def _exponent(factor: sp.Rational) -> int | None:
    """What turns the unit of a part of an angle into that of its `factor`-fold; None if the field has no such root."""
    steps = _STEPS * factor
    if not steps.is_Rational or gcd(int(steps.q), PRIME - 1) != 1:
        return None
    return int(steps.p) * pow(int(steps.q), -1, PRIME - 1) % (PRIME - 1)


def _square_root(value: Element) -> Element:
    if isinstance(value, Dual):
        return value.square_root(lambda number: FIELD(_any_root(int(number))))
    return FIELD(_any_root(int(value)))


def _size(value: Element) -> Element:
    """|value|: the root of its square that depends on the square alone."""
    return _square_root(value * value)


def _drawn(name: str, values: list[Element]) -> Element:
    return FIELD(_hashed(name, *(int(value) for value in values)))


def _continued(name: str, values: list[Element], slopes: Callable[..., list[Element]]) -> Element:
    """A function without algebraic identities at dual numbers: its derivatives do have values."""
    if not any(isinstance(value, Dual) for value in values):
        return _drawn(name, values)
    reals = [value.real if isinstance(value, Dual) else value for value in values]
    change: Element = 0
    for value, slope in zip(values, slopes(*reals), strict=True):
        if isinstance(value, Dual) and not (isinstance(value.tangent, int) and value.tangent == 0):
            change = slope * value.tangent + change
    return Dual(_continued(name, reals, slopes), change)


def _towards(x: Element, y: Element) -> Element:
    """exp(i a) of the angle a from the x axis to (x, y)."""
    return (x + IMAGINARY * y) / _square_root(x * x + y * y)


_UNITS: dict[Any, Callable[..., Element]] = {  # exp(i a) where a is the value of an inverse function
    sp.atan: lambda f: _towards(1 + 0 * f, f),
    sp.atan2: lambda y, x: _towards(x, y),
    sp.asin: lambda f: _square_root(1 - f * f) + IMAGINARY * f,
    sp.acos: lambda f: f + IMAGINARY * _square_root(1 - f * f),
}


_SLOPES: dict[Any, Callable[..., list[Element]]] = {  # their derivatives
    sp.atan: lambda f: [1 / (1 + f * f)],
    sp.atan2: lambda y, x: [x / (x * x + y * y), -y / (x * x + y * y)],
    sp.asin: lambda f: [1 / _square_root(1 - f * f)],
    sp.acos: lambda f: [-1 / _square_root(1 - f * f)],
}


def with_constants(value: Callable[[int, int], Any], wanted: int, tried: int) -> list[Any]:
    """The first `wanted` of `value(draw, 0)`, `value(draw, 1)`, ... that exist, for the first `draw` that has one.

    What is drawn once for all values, as known constants, may lack roots at every point.

    Raises:
        NotRepresentable: If there are not as many.
    """

    def draw_of(number: int) -> int:
        draw, point = divmod(number, _POINTS_A_DRAW)
        value(draw, point)
        return draw

    draw = next(usable(draw_of, 1, _POINTS_A_DRAW * _DRAWS))
    return list(usable(lambda point: value(draw, point), wanted, tried))


def usable(values: Callable[[int], Any], wanted: int, tried: int) -> Iterator[Any]:
    """The first `wanted` of `values(0)`, `values(1)`, ... that exist; each root exists at every other random point.

    Raises:
        NotRepresentable: If there are not as many among the `tried` first ones.
    """
    found, last = 0, None
    for number in range(tried):
        try:
            value = values(number)
        except NotRepresentable as error:
            last = error.expression
            continue
        yield value
        found += 1
        if found == wanted:
            return
    raise NotRepresentable(last)


def vanishes(expression: Expr, definitions: Mapping[Symbol, Expr] | None = None) -> bool:
    """Whether `expression` is zero everywhere."""
    if expression.is_Number:
        return bool(expression == 0)
    points = usable(lambda seed: Point(seed, definitions)(expression), SEEDS, TRIED_POINTS)
    return all(value == 0 for value in points)
