"""Input-output linearization (17)-(22): outputs, their rates and Lie derivatives along the kinematics."""

from __future__ import annotations

from dataclasses import dataclass

from sympy import Expr, Matrix, Symbol

from ..algebra.finite_field import NotRepresentable
from ..mechanics.kinematics import Kinematics


@dataclass(frozen=True)
class Linearization:
    """y = h(q), y' = L_f h = E v with E = J_h S, y'' = L_f^2 h + E v'."""

    outputs: dict[str, Expr]
    output_jacobian: Matrix  # J_h, (n-m, n)
    output_map: Matrix  # E = J_h S, (n-m, n-m)
    output_map_rate: Matrix  # E' along q' = S v, (n-m, n-m)
    output_rate: Matrix  # L_f h (19), (n-m, 1)
    lie_f2_h: Matrix  # L_f^2 h = d/dq(J_h S v) S v, (n-m, 1)


def linearize(kinematics: Kinematics) -> Linearization:
    """The input-output map of a robot, for relative degree 2 in every output.

    Raises:
        InputError: If the number of outputs is wrong, they depend on each other, or E is singular everywhere.
    """
    robot, terms, v = kinematics.robot, kinematics.terms, kinematics.v
    _check_number(kinematics)
    h = Matrix(list(robot.outputs.values()))
    jacobian = h.jacobian(kinematics.q)
    product = jacobian * kinematics.kinematic_matrix
    names = list(robot.outputs)

    def entry(i: int, j: int) -> Expr:
        value = terms.simplified(product[i, j])
        return terms.name(f"{names[i]}_dot_{v[j].name}", value)

    output_map = Matrix(*product.shape, entry)
    _check_regular(jacobian, output_map, kinematics)
    rate = output_map.applyfunc(lambda e: terms.rate(e, kinematics.rates))
    return Linearization(
        outputs=dict(robot.outputs),
        output_jacobian=jacobian,
        output_map=output_map,
        output_map_rate=rate,
        output_rate=output_map * Matrix(v),
        lie_f2_h=rate * Matrix(v),
    )


def relative_degree(row: Matrix, kinematics: Kinematics) -> int | None:
    """How often an output is differentiated until the inputs appear, for its row of D; None for more than twice.

    y' = E v holds no input, because v is part of the state; y'' does where the row of D = E G does not vanish.
    """
    return None if all(kinematics.terms.is_zero(entry) for entry in row) else 2


def _check_number(kinematics: Kinematics) -> None:
    reader, count, wanted = kinematics.robot.reader, len(kinematics.robot.outputs), len(kinematics.v)
    if count > wanted:
        names = ", ".join(v.name for v in kinematics.v)
        raise reader.mistake("[outputs]", f"{count} outputs for {wanted} pseudo-velocities ({names})", f"keep {wanted}")
    if count < wanted:
        raise reader.mistake("[outputs]", f"{count} outputs for {wanted} pseudo-velocities", f"add {wanted - count}")
    for name, output in kinematics.robot.outputs.items():
        if output.free_symbols.isdisjoint(kinematics.q):
            raise reader.mistake(f"[outputs] {name}", "depends on no coordinate", "write a function of coordinates")


def _check_regular(jacobian: Matrix, output_map: Matrix, kinematics: Kinematics) -> None:
    terms, robot = kinematics.terms, kinematics.robot
    try:
        if terms.rank(jacobian) < jacobian.rows:
            names = ", ".join(robot.outputs)
            raise robot.reader.mistake("[outputs]", f"{names} depend on each other", "choose independent outputs")
        if terms.rank(output_map) < output_map.rows:
            unseen = _unseen(output_map, kinematics.v, terms.rank(output_map), kinematics)
            raise robot.reader.mistake(
                "[outputs]",
                f"the decoupling matrix is singular everywhere: the outputs do not see {unseen}, so their relative "
                "degree is not 2",
                "move an output ahead of the axle (look-ahead point), extend the input dynamically, "
                "or derive the model without a controller (controller = false at the top)",
            )
    except NotRepresentable:
        raise robot.reader.mistake(
            "[outputs]", "are not defined at a random state", "check roots and quotients"
        ) from None


def _unseen(output_map: Matrix, v: tuple[Symbol, ...], rank: int, kinematics: Kinematics) -> str:
    """The pseudo-velocities that can be left out without losing rank."""
    terms = kinematics.terms
    idle = []
    for j, symbol in enumerate(v):
        others = output_map.copy()
        others.col_del(j)
        if terms.rank(others) == rank:
            idle.append(symbol.name)
    return " or ".join(idle) if idle else "every motion"
