"""CasADi SX function -> C: its instructions are a straight-line program of scalars, one line of C each."""

from __future__ import annotations

from dataclasses import dataclass

import casadi as ca

from wmr_afl.errors import WmrError

_UNARY = {
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
}
_BINARY = {
    ca.OP_ADD: "{0} + {1}",
    ca.OP_SUB: "{0} - {1}",
    ca.OP_MUL: "{0} * {1}",
    ca.OP_DIV: "{0} / {1}",
    ca.OP_POW: "pow({0}, {1})",
    ca.OP_CONSTPOW: "pow({0}, {1})",
    ca.OP_ATAN2: "atan2({0}, {1})",
    ca.OP_FMIN: "smaller({0}, {1})",
    ca.OP_FMAX: "larger({0}, {1})",
    ca.OP_LT: "(double)({0} < {1})",
    ca.OP_LE: "(double)({0} <= {1})",
    ca.OP_EQ: "(double)({0} == {1})",
    ca.OP_NE: "(double)({0} != {1})",
    ca.OP_AND: "(double)({0} != 0.0 && {1} != 0.0)",
    ca.OP_OR: "(double)({0} != 0.0 || {1} != 0.0)",
    ca.OP_IF_ELSE_ZERO: "({0} != 0.0 ? {1} : 0.0)",
}
_CIRCULAR = {ca.OP_SIN: "sine", ca.OP_COS: "cosine"}


@dataclass(frozen=True)
class Program:
    """Lines of C: what is the same for all robots of a block, then what is done for each."""

    shared: list[str]
    each: list[str]


def print_step(step: ca.Function, arguments: list[str], results: list[str], shared: int) -> Program:
    """The step as lines of C.

    `arguments` and `results` are templates over {i}, one for each of the function's; argument number `shared` is the
    same for all robots (time), and so is what follows from it alone. Every value is assigned once; sine and cosine of
    one angle share a reduction, `sincos_of(angle, &s, &c)`.
    Raises: WmrError, where the function does what is not printed.
    """
    walk = _Walk(step, arguments, results, shared)
    walk.run()
    return Program(walk.shared_lines, walk.each_lines)


class _Walk:
    def __init__(self, step: ca.Function, arguments: list[str], results: list[str], shared: int) -> None:
        self.step, self.arguments, self.results, self.shared = step, arguments, results, shared
        self.shared_lines: list[str] = []
        self.each_lines: list[str] = []
        self.held: dict[int, str] = {}  # work vector's place -> the C name of its present value
        self.same: set[str] = set()  # names of values that are the same for all robots
        self.turned: dict[str, int] = {}  # angle's C name -> number of its sine and cosine
        self.count = 0

    def run(self) -> None:
        for k in range(self.step.n_instructions()):
            operation = self.step.instruction_id(k)
            given, made = self.step.instruction_input(k), self.step.instruction_output(k)
            if operation == ca.OP_OUTPUT:
                self.each_lines.append(f"{self.results[made[0]].format(i=made[1])} = {self.held[given[0]]};")
            elif operation == ca.OP_INPUT:
                self.assign(made[0], self.arguments[given[0]].format(i=given[1]), given[0] == self.shared)
            elif operation == ca.OP_CONST:
                self.assign(made[0], _constant(self.step.instruction_constant(k)), True)
            elif operation in _CIRCULAR:
                self.circular(operation, self.held[given[0]], made[0])
            elif operation in _UNARY:
                self.operate(made[0], _UNARY[operation], self.held[given[0]])
            elif operation in _BINARY:
                self.operate(made[0], _BINARY[operation], *(self.held[place] for place in given))
            else:
                raise WmrError(f"operation number {operation} of the closed loop has no C; run it with backend casadi")

    def operate(self, place: int, template: str, *operands: str) -> None:
        self.assign(place, template.format(*operands), self.same.issuperset(operands))

    def assign(self, place: int, text: str, is_same: bool) -> None:
        self.count += 1
        name = self.held[place] = f"w{self.count}"
        (self.shared_lines if is_same else self.each_lines).append(f"const double {name} = {text};")
        if is_same:
            self.same.add(name)

    def circular(self, operation: int, angle: str, place: int) -> None:
        if angle not in self.turned:
            number = self.turned[angle] = len(self.turned)
            if angle in self.same:
                lines, function = self.shared_lines, "sincos_far"
                self.same |= {f"s{number}", f"c{number}"}
            else:
                lines, function = self.each_lines, "sincos_of"
            lines += [f"double s{number}, c{number};", f"{function}({angle}, &s{number}, &c{number});"]
        self.held[place] = f"{'s' if operation == ca.OP_SIN else 'c'}{self.turned[angle]}"


def _constant(value: float) -> str:
    """A literal that reads back to the bit."""
    return float(value).hex() if value == value and abs(value) != float("inf") else _special(value)


def _special(value: float) -> str:
    return "NAN" if value != value else "INFINITY" if value > 0 else "(-INFINITY)"
