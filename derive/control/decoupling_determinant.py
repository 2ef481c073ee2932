"""The determinant of the decoupling matrix, factored, and the set where it vanishes."""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property

import sympy as sp
from sympy import Expr, Matrix, Symbol

from ..algebra.constants import is_constant
from ..algebra.formula_text import readable
from ..algebra.trigonometry import factored
from ..mechanics.dynamics import Dynamics
from ..mechanics.kinematics import Kinematics
from .adaptive_form import AdaptiveForm
from .linearization import Linearization

_LONGEST = 100  # operations; longer determinants are left as they are


_READABLE = 25  # operations; longer denominators stand apart


_MOST_OPERATIONS = 4000  # longer determinants are not told, and nothing is done to make them shorter


DENOMINATOR = Symbol("Delta")


@dataclass(frozen=True)
class Determinant:
    """det D = det(J_h S) det(G); with more motors than outputs det(D D^T) = det(J_h S)^2 det(G G^T)."""

    is_square: bool
    output_map: Expr  # det(J_h S), of the configuration and the known constants
    gain: Expr  # det(G) or det(G G^T), of state and base parameters
    actuation: Expr  # det(Bbar K1), or of its product with its transpose: where the motors do not reach every motion

    @cached_property
    def whole(self) -> Expr:
        output_map = self.output_map if self.is_square else self.output_map**2
        whole = output_map * self.gain
        return sp.factor_terms(whole) if sp.count_ops(whole) <= _MOST_OPERATIONS else whole

    @cached_property
    def product(self) -> Expr:
        """The determinant, with `DENOMINATOR` in the place of a long denominator."""
        numerator, denominator = sp.fraction(self.whole)
        return numerator / (denominator if sp.count_ops(denominator) <= _READABLE else DENOMINATOR)

    @cached_property
    def text(self) -> str | None:
        """The determinant as text; None if it is too long to be read."""
        return readable(self.product)

    @cached_property
    def denominator(self) -> Expr | None:
        """What `DENOMINATOR` stands for: an inertia's determinant, which does not vanish."""
        denominator = sp.fraction(self.whole)[1]
        return None if sp.count_ops(denominator) <= _READABLE else denominator

    @cached_property
    def is_long(self) -> bool:
        """Whether the denominator is too long to be read."""
        return int(sp.count_ops(sp.fraction(self.whole)[1])) > _LONGEST

    @cached_property
    def denominator_text(self) -> str | None:
        """The denominator as text, for those who compute with it; None if it is too long to be read."""
        return None if self.denominator is None else readable(self.denominator)

    @cached_property
    def singular_where(self) -> list[str]:
        """Conditions, one for each factor that can vanish and is not too long to be read."""
        return [f"{text} = 0" for text in map(readable, self._factors) if text is not None]

    @cached_property
    def is_singular_elsewhere(self) -> bool:
        """Whether a factor is too long to be read: where it vanishes is not told."""
        return any(readable(factor) is None for factor in self._factors)

    @cached_property
    def _factors(self) -> list[Expr]:
        """What can vanish."""
        numerators = [self.output_map, sp.fraction(self.gain)[0], self.actuation]
        factors = [factor.as_base_exp()[0] for e in numerators for factor in sp.Mul.make_args(e)]
        state_or_theta = [
            factor
            for factor in factors
            if not all(map(is_constant, factor.free_symbols)) and not isinstance(factor, sp.exp)
        ]
        return list(dict.fromkeys(state_or_theta))


def decoupling_determinant(
    kinematics: Kinematics, dynamics: Dynamics, linearization: Linearization, form: AdaptiveForm
) -> Determinant:
    """det D of a robot in base parameters."""
    terms = kinematics.terms
    output_map = factored(_determinant(linearization.output_map.applyfunc(terms.expand)))
    reach = dynamics.input_matrix
    is_square = form.gain.rows == form.gain.cols
    if form.inverse is not None and form.kind == "inverse":  # G = N^-1, and N is shorter
        effort = Matrix.hstack(*(slope * Matrix(len(form.theta), 1, form.theta) for slope in form.inverse.slopes))
        gain = 1 / _factored(terms.expand(_determinant(effort)))
    elif form.kind == "physical":
        mass = _determinant(dynamics.inertia_matrix)
        gain = terms.expand(_determinant(_squared(reach)) / (mass if is_square else mass**2))
    else:
        gain = _factored(terms.expand(_determinant(_squared(form.gain))))
    moving = _factored(terms.expand(_determinant(_squared(reach))))
    coordinates = set(kinematics.q)
    actuation = sp.Mul(*(f for f in sp.Mul.make_args(moving) if not f.free_symbols.isdisjoint(coordinates)))
    return Determinant(is_square, output_map, gain, actuation if form.kind != "forward" else sp.S.One)


def _squared(matrix: Matrix) -> Matrix:
    return matrix if matrix.rows == matrix.cols else matrix * matrix.T


def _determinant(matrix: Matrix) -> Expr:
    return matrix.det(method="berkowitz")


def _factored(expression: Expr) -> Expr:
    return factored(expression) if sp.count_ops(expression) <= _LONGEST else expression
