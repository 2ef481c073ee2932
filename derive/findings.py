"""What the derivation found out about a robot, in words and numbers: for `model.json` and the report."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import sympy as sp
from sympy import Expr, Matrix

from derive.derivation import Derivation
from derive.internal_dynamics import StraightLine
from derive.linearization import relative_degree
from derive.trigonometry import factored


@dataclass(frozen=True)
class Determinant:
    """det D = det(J_h S) det(G), each as a product; where the first or the second vanishes, D is singular."""

    output_map: Expr  # det(J_h S), of the configuration and the known constants
    gain: Expr | None  # det(G) in base parameters; None where there are more motors than pseudo-velocities

    @property
    def product(self) -> Expr:
        return self.output_map if self.gain is None else sp.factor_terms(self.output_map * self.gain)


def determinant(derivation: Derivation) -> Determinant:
    """det D, factored."""
    d = derivation
    output_map = factored(d.linearization.output_map.applyfunc(d.terms.expand).det(method="berkowitz"))
    gain = d.adaptive.gain
    if gain.rows != gain.cols:
        return Determinant(output_map, None)
    if d.adaptive.kind == "inverse" and d.adaptive.inverse is not None:  # G = N^-1, and N is shorter
        effort = Matrix.hstack(*(slope * Matrix(d.adaptive.theta) for slope in d.adaptive.inverse.slopes))
        return Determinant(output_map, 1 / sp.factor(effort.det(method="berkowitz")))
    return Determinant(output_map, sp.factor(gain.det(method="berkowitz")))


def findings(derivation: Derivation) -> dict[str, Any]:
    """The findings, ready for JSON."""
    d, mobility, det = derivation, derivation.mobility, determinant(derivation)
    line = d.internal.straight_line
    involved = det.product.free_symbols
    return {
        "type": mobility.type_name,
        "degree_of_mobility": mobility.degree_of_mobility,
        "degree_of_steerability": mobility.degree_of_steerability,
        "degree_of_nonholonomy": mobility.growth.degree_of_nonholonomy,
        "growth_vector": list(mobility.growth.dimensions),
        "constraints": mobility.integrability,
        "controllable": mobility.growth.controllable,
        "constraint_rows": d.kinematics.kept,
        "holonomic_rows": list(mobility.holonomic),
        "dropped_rows": d.kinematics.dropped,
        "pseudo_velocities": {
            v.name: str(sum((c * rate for rate, c in form.items()), sp.S.Zero))
            for v, form in d.kinematics.pseudo_velocities.items()
        },
        "kinematic_singularities": [str(divisor) for divisor in d.kinematics.divisors],
        "relative_degree": {
            name: relative_degree(d.linearization.output_map[i, :] * d.adaptive.gain, d.kinematics)
            for i, name in enumerate(d.linearization.outputs)
        },
        "det_decoupling_matrix": str(det.product),
        "singular_where": singular_where(det, derivation),
        "determinant_parameters": [theta.name for theta in d.adaptive.theta if theta in involved],
        "parametrization": d.adaptive.kind,
        "parametrization_obstacle": None if d.adaptive.obstacle is None else str(d.adaptive.obstacle),
        "internal_coordinates": [z.name for z in d.internal.free],
        "internal_dynamics": None if d.internal.equation is None else _rows(d.internal.equation),
        "straight_line": None if line is None else _straight_line(line),
    }


def singular_where(det: Determinant, derivation: Derivation) -> list[str]:
    """Conditions under which D is singular, one for each factor that can vanish."""
    factors = [*sp.Mul.make_args(det.output_map)]
    if det.gain is not None:
        factors += sp.Mul.make_args(sp.fraction(sp.together(det.gain))[0])
    bases = [factor.as_base_exp()[0] for factor in factors if not factor.is_number]
    return [f"{base} = 0" for base in dict.fromkeys(bases)]


def _rows(matrix: Matrix) -> list[list[str]]:
    return [[str(entry) for entry in matrix.row(i)] for i in range(matrix.rows)]


def _straight_line(line: StraightLine) -> dict[str, Any]:
    return {
        "pseudo_velocities": [str(entry) for entry in line.pseudo_velocities],
        "matrix": _rows(line.matrix),
        "eigenvalues": [str(value) for value in line.eigenvalues],
        "eigenvalues_at_defaults": [
            float(f"{v.real:.12g}") if abs(v.imag) < 1e-12 else [float(f"{part:.12g}") for part in (v.real, v.imag)]
            for v in line.values
        ],
        "forward": line.forward,
        "backward": line.backward,
    }
