"""Small trigonometric simplification: early, on short expressions, and kept only where it helps."""

import sympy as sp
from sympy import Expr

_LONGEST = 60  # operations; longer expressions are left to named terms


_HIGHEST_MULTIPLE = 6  # of an angle


_SEARCHED = 25  # operations; up to here SymPy's search among equivalent forms is cheap


def normal_form(expression: Expr) -> Expr:
    """Expanded, sums of angles resolved, with sin^2 = 1 - cos^2 divided out; zero becomes 0."""
    expanded = sp.expand(without_sums_of_angles(expression))

    def reduced(power: Expr) -> Expr:
        sine, exponent = power.as_base_exp()
        return (1 - sp.cos(sine.args[0]) ** 2) ** (exponent // 2) * sine ** (exponent % 2)

    even = expanded.replace(
        lambda e: e.is_Pow and isinstance(e.base, sp.sin) and e.exp.is_Integer and e.exp >= 2, reduced
    )
    return expanded if even == expanded else sp.expand(even)


def without_sums_of_angles(expression: Expr) -> Expr:
    """Sums and multiples of angles resolved, but for high multiples, which would explode."""
    angles = [function.args[0] for function in expression.atoms(sp.sin, sp.cos, sp.tan)]
    coefficients = [term.as_coeff_Mul()[0] for angle in angles for term in sp.Add.make_args(angle)]
    return expression if any(abs(c) > _HIGHEST_MULTIPLE for c in coefficients) else sp.expand_trig(expression)


def shortest(expression: Expr) -> Expr:
    """The shortest of a few equivalent forms of a short expression."""
    if not _may_simplify(expression):
        return expression
    numerator, denominator = sp.fraction(sp.together(expression))
    plain = normal_form(numerator) / normal_form(denominator)
    candidates = [expression, plain]
    if plain != 0:
        candidates += [sp.factor_terms(plain), sp.cancel(plain)]
        if sp.count_ops(plain) <= _SEARCHED:
            candidates.append(sp.trigsimp(plain))
    return min(candidates, key=lambda candidate: (sp.count_ops(candidate), candidate.sort_key()))


def factored(expression: Expr) -> Expr:
    """Product form of a trigonometric polynomial, its angles gathered (sin a cos b - cos a sin b = sin(a - b))."""
    return _gathered(sp.factor(normal_form(expression)))


def _gathered(expression: Expr) -> Expr:
    factors = []
    for factor in sp.Mul.make_args(expression):
        base, exponent = factor.as_base_exp()
        factors.append(shortest(base) ** exponent if base.is_Add else factor)
    return sp.Mul(*factors)


def _may_simplify(expression: Expr) -> bool:
    """Only a sum that multiplies sines and cosines of related angles, or a quotient, can become shorter."""
    if not expression.has(sp.sin, sp.cos) or sp.count_ops(expression) > _LONGEST:
        return False
    angles = [f.args[0] for f in expression.atoms(sp.sin, sp.cos, sp.tan)]
    related = len(angles) > len({symbol for angle in angles for symbol in angle.free_symbols})
    return (bool(expression.has(sp.Add, sp.tan)) and related) or any(
        power.exp.is_Integer and power.exp != 1 for power in expression.atoms(sp.Pow) if power.has(sp.sin, sp.cos)
    )
