"""What stands beside the generated functions: names, units, values and formulas, and the derivation's findings."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any

import sympy as sp
from sympy import Expr

from ..algebra.formula_text import TOO_LONG, formula, readable
from ..derivation import Derivation
from ..mechanics.poses import Part, geometry
from .arguments import arguments_of, unit_text, units_of
from .findings import findings


@dataclass(frozen=True)
class Metadata:
    """Names to units, in order, and what else a user of the generated functions needs."""

    name: str
    title: str
    source: str
    state: dict[str, str]
    inputs: dict[str, str]
    motors: dict[str, dict[str, str]]  # input -> what it drives, torque gain and back-EMF as formulas of p
    outputs: dict[str, str]
    parameters: dict[str, str]
    defaults: dict[str, float]
    about: dict[str, str]
    known: dict[str, str]
    base_parameters: dict[str, str]
    base_parameter_formulas: dict[str, str]
    parametrization: str
    inverse_base_parameters: dict[str, str]
    inverse_base_parameter_formulas: dict[str, str]
    passivity_parameters: dict[str, str]
    passivity_parameter_formulas: dict[str, str]
    passivity_groups: list[dict[str, Any]]  # rows and parameters that share an uncertain factor
    passivity_obstacle: str | None  # why there are none
    effort_parameters: dict[str, str]
    effort_parameter_formulas: dict[str, str]
    gain_ratio_formulas: dict[str, str]  # input -> its motor's gain by that of the first one in the same rows; not ones
    effort_obstacle: str | None  # why there are none
    geometry: dict[str, dict[str, Part]]
    further_constraints: int  # that no wheel makes
    slip_rows: list[dict[str, str]]  # of each row of the slip matrix the wheel and its direction, or the joint
    findings: dict[str, Any]


def describe(derivation: Derivation) -> Metadata:
    """The metadata of a derived robot."""
    d, arguments, units = derivation, arguments_of(derivation), units_of(derivation)

    def table(argument: str) -> dict[str, str]:
        one = arguments[argument]
        return {symbol.name: unit for symbol, unit in zip(one.entries, one.units, strict=True)}

    def expanded(expression: Expr) -> str:
        return readable(sp.factor_terms(d.terms.expand(expression))) or TOO_LONG

    def numbered(parameters: Sequence[Expr]) -> dict[str, Expr]:
        return {f"pi{k}": parameter for k, parameter in enumerate(parameters, 1)}

    def unit_table(named: Mapping[str, Expr]) -> dict[str, str]:
        return {name: unit_text(e, units, d) for name, e in named.items()}

    inverse = numbered(d.adaptive.inverse.base_parameters if d.adaptive.inverse else ())
    pi = numbered(d.passive.parameters if d.passive else ())
    effort = numbered(d.efforts.parameters if d.efforts else ())
    return Metadata(
        name=d.robot.name,
        title=d.robot.title,
        source=d.robot.source,
        state=table("x"),
        inputs=table("u"),
        motors={
            motor.input: {
                "drives": str(motor.wheel or motor.joint),
                "torque_gain": formula(motor.torque_gain),
                "back_emf": formula(motor.back_emf),
            }
            for motor in d.robot.motors
        },
        outputs={name: unit_text(h, units, d) for name, h in d.robot.outputs.items()},
        parameters=table("p"),
        defaults={p.name: float(d.robot.defaults[p]) for p in d.robot.parameters},
        about=d.robot.about,
        known=table("c"),
        base_parameters=table("theta"),
        base_parameter_formulas={
            s.name: expanded(e) for s, e in zip(d.adaptive.theta, d.adaptive.base_parameters, strict=True)
        },
        parametrization=d.adaptive.kind,
        inverse_base_parameters=unit_table(inverse),
        inverse_base_parameter_formulas={name: expanded(e) for name, e in inverse.items()},
        passivity_parameters=unit_table(pi),
        passivity_parameter_formulas={name: expanded(e) for name, e in pi.items()},
        passivity_groups=[
            {
                "rows": list(group.rows),
                "parameters": [list(pi)[k] for k in group.parameters],
                "scale": expanded(group.scale),
            }
            for group in (d.passive.groups if d.passive else ())
        ],
        passivity_obstacle=d.passivity if isinstance(d.passivity, str) else None,
        effort_parameters=unit_table(effort),
        effort_parameter_formulas={name: expanded(e) for name, e in effort.items()},
        gain_ratio_formulas={
            motor.input: formula(ratio)
            for motor, ratio in zip(d.robot.motors, d.efforts.gain_ratios if d.efforts else (), strict=False)
            if ratio != 1
        },
        effort_obstacle=d.effort if isinstance(d.effort, str) else None,
        geometry=geometry(d.robot),
        further_constraints=len(d.robot.constraints),
        slip_rows=[row.about for row in d.kinematics.slip_rows],
        findings=findings(derivation),
    )
