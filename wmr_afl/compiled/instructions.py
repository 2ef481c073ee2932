"""The instructions of a CasADi SX function, each with the instructions that made its operands, and their C."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass
from math import copysign

import casadi as ca

TEMPLATES = {
    ca.OP_ASSIGN: "{0}",
    ca.OP_NEG: "-{0}",
    ca.OP_SQ: "{0} * {0}",
    ca.OP_TWICE: "{0} + {0}",
    ca.OP_INV: "1.0 / {0}",
    ca.OP_SQRT: "sqrt({0})",
    ca.OP_FABS: "fabs({0})",
    ca.OP_SIGN: "sign({0})",
    ca.OP_NOT: "(double)({0} == 0.0)",
    ca.OP_EXP: "exp({0})",
    ca.OP_LOG: "log({0})",
    ca.OP_TAN: "tan({0})",
    ca.OP_TANH: "tanh({0})",
    ca.OP_ASIN: "asin({0})",
    ca.OP_ACOS: "acos({0})",
    ca.OP_ATAN: "atan({0})",
    ca.OP_FLOOR: "floor({0})",
    ca.OP_CEIL: "ceil({0})",
    ca.OP_ADD: "{0} + {1}",
    ca.OP_SUB: "{0} - {1}",
    ca.OP_MUL: "{0} * {1}",
    ca.OP_DIV: "{0} / {1}",
    ca.OP_POW: "pow({0}, {1})",
    ca.OP_CONSTPOW: "pow({0}, {1})",
    ca.OP_ATAN2: "atan2({0}, {1})",
    ca.OP_LT: "(double)({0} < {1})",
    ca.OP_LE: "(double)({0} <= {1})",
    ca.OP_EQ: "(double)({0} == {1})",
    ca.OP_NE: "(double)({0} != {1})",
    ca.OP_AND: "(double)({0} != 0.0 && {1} != 0.0)",
    ca.OP_OR: "(double)({0} != 0.0 || {1} != 0.0)",
    ca.OP_IF_ELSE_ZERO: "({0} != 0.0 ? {1} : 0.0)",
}
EXTREMES = {ca.OP_FMIN: "smaller", ca.OP_FMAX: "larger"}  # with _or where the first is a number for sure
CIRCULAR = {ca.OP_SIN: "s", ca.OP_COS: "c"}


@dataclass(frozen=True)
class Instruction:
    operation: int
    operands: tuple[int, ...]  # numbers of the instructions that made them
    place: tuple[int, int] = (0, 0)  # argument or result, and its entry
    constant: float = 0.0


def instructions(step: ca.Function) -> Iterator[Instruction]:
    """The function's instructions, with operands by the number of the instruction that made them, not by place."""
    made_by: dict[int, int] = {}  # work vector's place -> number of the instruction that wrote it last
    for number in range(step.n_instructions()):
        operation = step.instruction_id(number)
        given, made = step.instruction_input(number), step.instruction_output(number)
        if operation == ca.OP_OUTPUT:
            yield Instruction(operation, (made_by[given[0]],), place=(made[0], made[1]))
            continue
        if operation == ca.OP_INPUT:
            yield Instruction(operation, (), place=(given[0], given[1]))
        elif operation == ca.OP_CONST:
            yield Instruction(operation, (), constant=step.instruction_constant(number))
        else:
            yield Instruction(operation, tuple(made_by[place] for place in given))
        made_by[made[0]] = number


def literal(value: float) -> str:
    """A literal that reads back to the bit."""
    if value != value:
        return "NAN"
    text = "INFINITY" if abs(value) == float("inf") else abs(value).hex()
    return f"(-{text})" if copysign(1.0, value) < 0 else text
