"""What the derivation found out about a robot, in words and numbers: for `model.json` and the report."""

from __future__ import annotations

from typing import Any

import sympy as sp
from sympy import Matrix

from ..algebra.formula_text import TOO_LONG, formula
from ..control.internal_dynamics import StraightLine
from ..control.linearization import relative_degree
from ..control.nonlinearity import Obstacle
from ..derivation import Control, Derivation

_READABLE = 60  # operations; longer denominators are given by their name


def findings(derivation: Derivation) -> dict[str, Any]:
    """The findings, ready for JSON."""
    d, mobility = derivation, derivation.mobility
    growth = mobility.growth
    return {
        "type": mobility.type_name,
        "degree_of_mobility": mobility.degree_of_mobility,
        "degree_of_steerability": mobility.degree_of_steerability,
        "degree_of_nonholonomy": 0 if growth is None else growth.degree_of_nonholonomy,
        "growth_vector": [] if growth is None else list(growth.dimensions),
        "constraints": mobility.integrability,
        "controllable": False if growth is None else growth.controllable,
        "constraint_rows": d.kinematics.kept,
        "holonomic_rows": list(mobility.holonomic),
        "dropped_rows": d.kinematics.dropped,
        "pseudo_velocities": {
            v.name: formula(sum((c * rate for rate, c in form.items()), sp.S.Zero))
            for v, form in d.kinematics.pseudo_velocities.items()
        },
        "degenerate_configurations": None
        if mobility.degenerate is None
        else [" and ".join(f"{formula(condition)} = 0" for condition in one) for one in mobility.degenerate],
        "kinematic_singularities": [f"{formula(factor)} = 0" for factor in d.kinematics.singularities],
        "parametrization": d.adaptive.kind,
        "parametrization_obstacle": None if d.adaptive.obstacle is None else _obstacle(d, d.adaptive.obstacle),
        **({} if d.control is None else _of_control(d, d.control)),
        **({"not_found_out": missed} if (missed := _missed(d)) else {}),
    }


def _missed(d: Derivation) -> dict[str, str]:
    """What was not found out or is not told, and why."""
    missed = dict(d.missed)
    if d.control is not None:
        determinant = d.control.determinant
        if determinant.text is None:
            missed["det_decoupling_matrix"] = TOO_LONG
        if determinant.is_singular_elsewhere:
            missed["singular_where"] = "a factor is too long to be read"
    return missed


def _of_control(d: Derivation, control: Control) -> dict[str, Any]:
    """What the outputs and the decoupling matrix are like."""
    det, internal = control.determinant, control.internal
    line = internal.straight_line
    return {
        "relative_degree": {
            name: relative_degree(control.linearization.output_map[i, :] * d.adaptive.gain, d.kinematics)
            for i, name in enumerate(control.linearization.outputs)
        },
        "determinant_of": "D" if det.is_square else "D D^T",
        "det_decoupling_matrix": det.text or TOO_LONG,
        "det_denominator": None if det.text is None else det.denominator_text,
        "singular_where": det.singular_where,
        "determinant_parameters": [theta.name for theta in d.adaptive.theta if theta in det.gain.free_symbols],
        "internal_coordinates": [z.name for z in internal.free],
        "internal_dynamics": None if internal.equation is None else _rows(internal.equation),
        "straight_line": None if line is None else _straight_line(line),
    }


def _obstacle(d: Derivation, obstacle: Obstacle) -> dict[str, Any]:
    denominator = sp.fraction(obstacle.factor)[1]
    expanded = d.terms.expand(denominator)
    return {
        "denominator": formula(expanded if sp.count_ops(expanded) <= _READABLE else denominator),
        "mixes_state_and_parameters": obstacle.is_mixed,
        "rank_of_values": obstacle.rank,
        "states_and_parameter_sets": obstacle.samples,
        "is_proof": obstacle.is_proof,
    }


def _rows(matrix: Matrix) -> list[list[str]]:
    return [[formula(entry) for entry in matrix.row(i)] for i in range(matrix.rows)]


def _straight_line(line: StraightLine) -> dict[str, Any]:
    return {
        "pseudo_velocities": [formula(entry) for entry in line.pseudo_velocities],
        "matrix": _rows(line.matrix),
        "eigenvalues": [formula(value) for value in line.eigenvalues],
        "eigenvalues_at_defaults": [
            float(f"{v.real:.12g}") if abs(v.imag) < 1e-12 else [float(f"{part:.12g}") for part in (v.real, v.imag)]
            for v in line.values
        ],
        "forward": line.forward,
        "backward": line.backward,
    }
