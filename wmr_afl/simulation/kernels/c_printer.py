"""CasADi SX function -> C: its instructions are a program of scalars without branches, one line of C each."""

from __future__ import annotations

from collections import Counter
from collections.abc import Iterator, Sequence
from dataclasses import dataclass, field
from enum import IntFlag
from math import copysign

import casadi as ca

from wmr_afl.errors import WmrError

# C of an operation, by its operands.
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
EXTREMES = {ca.OP_FMIN: "smaller", ca.OP_FMAX: "larger"}  # with _or, which is faster, if the first is never NaN
CIRCULAR = {ca.OP_SIN: "s", ca.OP_COS: "c"}  # the first letter of the variable that holds it


class Depends(IntFlag):
    """What a value depends on, and so how often it must be computed."""

    NOTHING = 0
    ROBOT = 1  # once for every robot
    TIME = 2  # once for every step
    BOTH = 3


@dataclass(frozen=True)
class Argument:
    """An argument of the function: C for its entry {i}, and what that depends on."""

    text: str
    depends: Depends


@dataclass
class Program:
    """The printed step: lines of C in which each value is assigned once."""

    robot: list[str] = field(default_factory=list)  # for every robot, before the first step
    time: list[str] = field(default_factory=list)  # for every step, the same for all robots
    both: list[str] = field(default_factory=list)  # for every step and robot
    held: list[str] = field(default_factory=list)  # values that `robot` leaves to `both`, which reads them by name
    timed: list[str] = field(default_factory=list)  # and those that `time` leaves
    results: list[list[str]] = field(default_factory=list)  # C of every entry of every result, for use after `both`
    reads: set[int] = field(default_factory=set)  # arguments that anything depends on

    def lines(self, depends: Depends) -> list[str]:
        """The lines that compute values with these dependencies."""
        return {Depends.BOTH: self.both, Depends.ROBOT: self.robot}.get(depends, self.time)

    def left(self, depends: Depends) -> list[str]:
        """Names of values that go from the lines of `depends` to `both`."""
        return self.held if depends == Depends.ROBOT else self.timed


def print_step(step: ca.Function, arguments: Sequence[Argument], alone: bool = False) -> Program:
    """The step as lines of C; what does not change from step to step, or from robot to robot, is computed once.

    Sine and cosine of one angle share a reduction, `sincos_of(angle, &s, &c)`. Divisions by what stays the same over a
    run become products with its inverse; also those by one divisor, unless a robot is `alone`: it would wait for both.
    Last digits may differ from those of the step.

    Raises:
        WmrError: if the function has an operation that is not printed.
    """
    return _Printer(list(instructions(step)), arguments, step.n_out(), alone).program


@dataclass(frozen=True)
class Instruction:
    """One of CasADi's instructions, with operands by the number of the instruction that computed them."""

    operation: int
    operands: tuple[int, ...]  # numbers of the instructions that made them
    place: tuple[int, int] = (0, 0)  # argument or result, and its entry
    constant: float = 0.0


def instructions(step: ca.Function) -> Iterator[Instruction]:
    """The function's instructions; CasADi gives operands by their place in its work vector, which is used again."""
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
    """A C literal that is read back to the same bits."""
    if value != value:
        return "NAN"
    text = "INFINITY" if abs(value) == float("inf") else abs(value).hex()
    return f"(-{text})" if copysign(1.0, value) < 0 else text


class _Printer:
    """Prints instruction by instruction; a value is known by the number of its instruction."""

    def __init__(
        self, instructions: list[Instruction], arguments: Sequence[Argument], results: int, alone: bool
    ) -> None:
        self.arguments, self.alone, self.program = arguments, alone, Program(results=[[] for _ in range(results)])
        self.texts: dict[int, str] = {}  # number of an instruction -> C of its value
        self.depends: dict[int, Depends] = {}
        self.angles: set[int] = set()
        self.inverses: set[int] = set()
        self.divisions = Counter(one.operands[1] for one in instructions if one.operation == ca.OP_DIV)
        for number, one in enumerate(instructions):
            self.print(number, one)

    def print(self, number: int, one: Instruction) -> None:
        if one.operation == ca.OP_CONST:
            self.texts[number], self.depends[number] = literal(one.constant), Depends.NOTHING
        elif one.operation == ca.OP_INPUT:
            argument = self.arguments[one.place[0]]
            self.program.reads.add(one.place[0])
            self.assign(number, argument.text.format(i=one.place[1]), argument.depends)
        elif one.operation == ca.OP_OUTPUT:
            self.program.results[one.place[0]].append(self.text(one.operands[0], Depends.BOTH))
        else:
            depends = Depends.NOTHING
            for operand in one.operands:
                depends |= self.depends[operand]
            self.operate(number, one, depends)

    def operate(self, number: int, one: Instruction, depends: Depends) -> None:
        """Print a value that is computed from others."""
        if one.operation in CIRCULAR:
            angle = one.operands[0]
            self.circular(angle, depends)
            self.texts[number], self.depends[number] = f"{CIRCULAR[one.operation]}{angle}", depends
        elif one.operation == ca.OP_DIV and self.inverse_pays(one.operands[1], depends):
            dividend, divisor = one.operands
            if divisor not in self.inverses:
                self.inverses.add(divisor)
                where = self.depends[divisor]
                self.program.lines(where).append(f"const double i{divisor} = 1.0 / {self.text(divisor, where)};")
            inverse = self.seen(f"i{divisor}", self.depends[divisor], depends)
            self.assign(number, f"{self.text(dividend, depends)} * {inverse}", depends)
        elif one.operation in EXTREMES:
            a, b = sorted(one.operands, key=lambda operand: self.depends[operand] == Depends.BOTH)
            function = EXTREMES[one.operation] + ("" if self.depends[a] & Depends.TIME else "_or")
            self.assign(number, f"{function}({self.text(a, depends)}, {self.text(b, depends)})", depends)
        elif one.operation in TEMPLATES:
            operands = (self.text(operand, depends) for operand in one.operands)
            self.assign(number, TEMPLATES[one.operation].format(*operands), depends)
        else:
            raise WmrError(
                f"operation number {one.operation} of the closed loop has no C", "run it with backend casadi"
            )

    def inverse_pays(self, divisor: int, depends: Depends) -> bool:
        """Whether a product with the inverse replaces a division: several times cheaper, the last digit may differ."""
        shared = self.divisions[divisor] > 1 and not self.alone
        return depends == Depends.BOTH and (self.depends[divisor] != Depends.BOTH or shared)

    def assign(self, number: int, text: str, depends: Depends) -> None:
        self.program.lines(depends).append(f"const double w{number} = {text};")
        self.texts[number], self.depends[number] = f"w{number}", depends

    def text(self, number: int, reader: Depends) -> str:
        """C of a value, for use in the lines of what depends on `reader`."""
        return self.seen(self.texts[number], self.depends[number], reader)

    def seen(self, text: str, depends: Depends, reader: Depends) -> str:
        """The name of a value in the lines of `reader`; values from other lines are noted to be left for it."""
        is_literal = not text[0].islower()
        if reader == Depends.BOTH and depends != Depends.BOTH and not is_literal:
            left = self.program.left(depends)
            if text not in left:
                left.append(text)
        return text

    def circular(self, angle: int, depends: Depends) -> None:
        if angle not in self.angles:
            self.angles.add(angle)
            self.program.lines(depends).extend(
                (f"double s{angle}, c{angle};", f"sincos_of({self.text(angle, depends)}, &s{angle}, &c{angle});")
            )
