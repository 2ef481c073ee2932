"""CasADi SX function -> C: its instructions are a program of scalars without branches, one line of C each."""

from __future__ import annotations

from collections import Counter
from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass, field
from enum import IntFlag
from math import copysign

import casadi as ca

from wmr_afl.errors import WmrError

# C of an operation, by its operands; {real}, {zero} and {one} as the target writes them.
TEMPLATES = {
    ca.OP_ASSIGN: "{0}",
    ca.OP_NEG: "-{0}",
    ca.OP_SQ: "{0} * {0}",
    ca.OP_TWICE: "{0} + {0}",
    ca.OP_INV: "{one} / {0}",
    ca.OP_NOT: "({real})({0} == {zero})",
    ca.OP_ADD: "{0} + {1}",
    ca.OP_SUB: "{0} - {1}",
    ca.OP_MUL: "{0} * {1}",
    ca.OP_DIV: "{0} / {1}",
    ca.OP_LT: "({real})({0} < {1})",
    ca.OP_LE: "({real})({0} <= {1})",
    ca.OP_EQ: "({real})({0} == {1})",
    ca.OP_NE: "({real})({0} != {1})",
    ca.OP_AND: "({real})(({0} != {zero}) && ({1} != {zero}))",
    ca.OP_OR: "({real})(({0} != {zero}) || ({1} != {zero}))",
    ca.OP_IF_ELSE_ZERO: "({0} != {zero}) ? {1} : {zero}",
}
FUNCTIONS = {  # of the C library
    ca.OP_SQRT: "sqrt",
    ca.OP_FABS: "fabs",
    ca.OP_EXP: "exp",
    ca.OP_LOG: "log",
    ca.OP_TAN: "tan",
    ca.OP_TANH: "tanh",
    ca.OP_ASIN: "asin",
    ca.OP_ACOS: "acos",
    ca.OP_ATAN: "atan",
    ca.OP_FLOOR: "floor",
    ca.OP_CEIL: "ceil",
    ca.OP_POW: "pow",
    ca.OP_CONSTPOW: "pow",
    ca.OP_ATAN2: "atan2",
}
SIGN = {ca.OP_SIGN: "sign"}  # a function of ours
EXTREMES = {ca.OP_FMIN: "smaller", ca.OP_FMAX: "larger"}  # with _or, which is faster, if the first is never NaN
CIRCULAR = {ca.OP_SIN: "s", ca.OP_COS: "c"}  # the first letter of the variable that holds it


class Depends(IntFlag):
    """What a value depends on, and so how often it must be computed."""

    NOTHING = 0
    ROBOT = 1  # once for every robot
    TIME = 2  # once for every step
    BOTH = 3


def hexadecimal(value: float) -> str:
    """A C literal that is read back to the same bits."""
    if value != value:
        return "NAN"
    text = "INFINITY" if abs(value) == float("inf") else abs(value).hex()
    return f"(-{text})" if copysign(1.0, value) < 0 else text


@dataclass(frozen=True)
class Target:
    """How the scalars of a program are written in C."""

    real: str = "double"
    literal: Callable[[float], str] = hexadecimal
    suffix: str = ""  # of the C library's functions for this type
    prefix: str = ""  # of our functions that stand beside the program: sincos_of, larger, smaller, sign
    own: Mapping[int, str] = field(default_factory=dict)  # more of them, instead of the C library's, by operation


@dataclass(frozen=True)
class Argument:
    """An argument of the function: C for its entry {i}, or for each of its entries, and what that depends on."""

    text: str | Sequence[str]
    depends: Depends

    def entry(self, i: int) -> str:
        """C for its entry i."""
        return self.text.format(i=i) if isinstance(self.text, str) else self.text[i]


@dataclass
class Program:
    """The printed step: lines of C in which each value is assigned once."""

    robot: list[str] = field(default_factory=list)  # for every robot, before the first step
    time: list[str] = field(default_factory=list)  # for every step, the same for all robots
    both: list[str] = field(default_factory=list)  # for every step and robot
    held: list[str] = field(default_factory=list)  # values that `robot` leaves to `both`, which reads them by name
    timed: list[str] = field(default_factory=list)  # and those that `time` leaves
    results: list[list[str]] = field(default_factory=list)  # C of every entry of every result, for use after `both`
    rests: dict[int, str] = field(default_factory=dict)  # C of the remainder of a compensated entry of result 0
    calls: set[str] = field(default_factory=set)  # functions that the lines call, without suffix and prefix
    reads: set[int] = field(default_factory=set)  # arguments that anything depends on

    def lines(self, depends: Depends) -> list[str]:
        """The lines that compute values with these dependencies."""
        return {Depends.BOTH: self.both, Depends.ROBOT: self.robot}.get(depends, self.time)

    def left(self, depends: Depends) -> list[str]:
        """Names of values that go from the lines of `depends` to `both`."""
        return self.held if depends == Depends.ROBOT else self.timed


def print_step(
    step: ca.Function,
    arguments: Sequence[Argument],
    alone: bool = False,
    target: Target | None = None,
    compensated: Mapping[int, str] | None = None,
) -> Program:
    """The step as lines of C; what does not change from step to step, or from robot to robot, is computed once.

    Sine and cosine of one angle share a reduction, `sincos_of(angle, &s, &c)`. Divisions by what stays the same over a
    run become products with its inverse; also those by one divisor, unless a robot is `alone`: it would wait for both.
    Last digits may differ from those of the step.

    `compensated`: entries of argument 0 that are sums over many steps, with C of the remainder of each. The sums that
    lead from such an entry to the same entry of result 0 are carried with what rounding leaves (Kahan), so that small
    changes add up in single precision, too.

    Raises:
        WmrError: if the function has an operation that is not printed.
    """
    return _Printer(list(instructions(step)), arguments, step.n_out(), alone, target or Target(), compensated).program


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


class _Printer:
    """Prints instruction by instruction; a value is known by the number of its instruction."""

    def __init__(
        self,
        instructions: list[Instruction],
        arguments: Sequence[Argument],
        results: int,
        alone: bool,
        target: Target,
        compensated: Mapping[int, str] | None,
    ) -> None:
        self.target = target
        self.names = {"real": target.real, "zero": target.literal(0.0), "one": target.literal(1.0)}
        self.rests: dict[int, str] = {}  # number of an instruction -> C of what rounding has left of it
        self.carrying = _sums(instructions, compensated) if compensated else set[int]()
        self.compensated = compensated or {}
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
            self.texts[number], self.depends[number] = self.target.literal(one.constant), Depends.NOTHING
        elif one.operation == ca.OP_INPUT:
            argument = self.arguments[one.place[0]]
            self.program.reads.add(one.place[0])
            self.assign(number, argument.entry(one.place[1]), argument.depends)
            if number in self.carrying:
                self.rests[number] = self.compensated[one.place[1]]
        elif one.operation == ca.OP_OUTPUT:
            self.program.results[one.place[0]].append(self.text(one.operands[0], Depends.BOTH))
            if one.place[0] == 0 and one.place[1] in self.compensated:
                self.program.rests[one.place[1]] = self.rests.get(one.operands[0], self.names["zero"])
        else:
            depends = Depends.NOTHING
            for operand in one.operands:
                depends |= self.depends[operand]
            self.operate(number, one, depends)

    def operate(self, number: int, one: Instruction, depends: Depends) -> None:
        """Print a value that is computed from others."""
        if number in self.carrying:
            self.carry(number, one, depends)
        elif one.operation in CIRCULAR:
            angle = one.operands[0]
            self.circular(angle, depends)
            self.texts[number], self.depends[number] = f"{CIRCULAR[one.operation]}{angle}", depends
        elif one.operation == ca.OP_DIV and self.inverse_pays(one.operands[1], depends):
            dividend, divisor = one.operands
            if divisor not in self.inverses:
                self.inverses.add(divisor)
                where = self.depends[divisor]
                self.program.lines(where).append(
                    f"const {self.target.real} i{divisor} = {self.names['one']} / {self.text(divisor, where)};"
                )
            inverse = self.seen(f"i{divisor}", self.depends[divisor], depends)
            self.assign(number, f"{self.text(dividend, depends)} * {inverse}", depends)
        elif one.operation in EXTREMES:
            a, b = sorted(one.operands, key=lambda operand: self.depends[operand] == Depends.BOTH)
            function = EXTREMES[one.operation] + ("" if self.depends[a] & Depends.TIME else "_or")
            self.call(number, self.target.prefix + function, (a, b), depends)
        elif one.operation in SIGN:
            self.call(number, self.target.prefix + SIGN[one.operation], one.operands, depends)
        elif one.operation in self.target.own:
            self.call(number, self.target.prefix + self.target.own[one.operation], one.operands, depends)
        elif one.operation in FUNCTIONS:
            self.call(number, FUNCTIONS[one.operation] + self.target.suffix, one.operands, depends)
        elif one.operation in TEMPLATES:
            operands = (self.text(operand, depends) for operand in one.operands)
            self.assign(number, TEMPLATES[one.operation].format(*operands, **self.names), depends)
        else:
            raise WmrError(
                f"operation number {one.operation} of the closed loop has no C", "run it with backend casadi"
            )

    def call(self, number: int, function: str, operands: Sequence[int], depends: Depends) -> None:
        self.program.calls.add(function)
        self.assign(number, f"{function}({', '.join(self.text(one, depends) for one in operands)})", depends)

    def carry(self, number: int, one: Instruction, depends: Depends) -> None:
        """A value on the way of a compensated sum, with what rounding leaves of it."""
        carried = [base for base in _bases(one) if base in self.rests]
        texts, zero = [self.text(operand, depends) for operand in one.operands], self.names["zero"]
        add, rest = self.program.lines(depends).append, f"r{number}"
        if one.operation in (ca.OP_ADD, ca.OP_SUB) and len(carried) == 1:
            sum_before = carried[0]
            other = one.operands[1] if one.operands[0] == sum_before else one.operands[0]
            sign = "-" if one.operation == ca.OP_SUB else "+"
            add(f"const {self.target.real} d{number} = {self.rests[sum_before]} {sign} {self.text(other, depends)};")
            self.assign(number, f"{self.text(sum_before, depends)} + d{number}", depends)
            left = f"d{number} - (w{number} - {self.text(sum_before, depends)})"
        elif one.operation == ca.OP_ADD:  # of two choices, of which one is zero
            self.assign(number, " + ".join(texts), depends)
            left = " + ".join(self.rests[operand] for operand in carried)
        elif one.operation == ca.OP_IF_ELSE_ZERO:
            self.assign(number, TEMPLATES[one.operation].format(*texts, **self.names), depends)
            left = f"({texts[0]} != {zero}) ? {self.rests[carried[0]]} : {zero}"
        else:  # an extreme: at the bound nothing is left
            function = self.target.prefix + EXTREMES[one.operation]
            self.call(number, function, one.operands, depends)
            left = f"(w{number} == {self.text(carried[0], depends)}) ? {self.rests[carried[0]]} : {zero}"
        add(f"const {self.target.real} {rest} = {left};")
        self.rests[number] = rest

    def inverse_pays(self, divisor: int, depends: Depends) -> bool:
        """Whether a product with the inverse replaces a division: several times cheaper, the last digit may differ."""
        shared = self.divisions[divisor] > 1 and not self.alone
        return depends == Depends.BOTH and (self.depends[divisor] != Depends.BOTH or shared)

    def assign(self, number: int, text: str, depends: Depends) -> None:
        self.program.lines(depends).append(f"const {self.target.real} w{number} = {text};")
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
            function = f"{self.target.prefix}sincos_of"
            self.program.calls.add(function)
            self.program.lines(depends).extend(
                (
                    f"{self.target.real} s{angle};",
                    f"{self.target.real} c{angle};",
                    f"{function}({self.text(angle, depends)}, &s{angle}, &c{angle});",
                )
            )


def _bases(one: Instruction) -> tuple[int, ...]:
    """The operands that a sum may go on from: not what is subtracted, and not a condition."""
    if one.operation == ca.OP_IF_ELSE_ZERO:
        return one.operands[1:]
    return one.operands[:1] if one.operation == ca.OP_SUB else one.operands


def _sums(instructions: Sequence[Instruction], compensated: Mapping[int, str]) -> set[int]:
    """The numbers of the instructions between these entries of argument 0 and the same entries of result 0."""
    passed_on = {ca.OP_ADD, ca.OP_SUB, ca.OP_IF_ELSE_ZERO, *EXTREMES}
    onward: dict[int, set[int]] = {}  # number -> entries whose sum it may be a part of
    for number, one in enumerate(instructions):
        if one.operation == ca.OP_INPUT and one.place[0] == 0 and one.place[1] in compensated:
            onward[number] = {one.place[1]}
        elif one.operation in passed_on:
            found = set[int]().union(*(onward.get(base, set()) for base in _bases(one)))
            if found:
                onward[number] = found
    wanted: dict[int, set[int]] = {}
    carrying = set[int]()
    for number in reversed(range(len(instructions))):
        one = instructions[number]
        if one.operation == ca.OP_OUTPUT and one.place[0] == 0 and one.place[1] in compensated:
            wanted.setdefault(one.operands[0], set()).add(one.place[1])
        elif wanted.get(number, set()) & onward.get(number, set()):
            carrying.add(number)
            for operand in one.operands:
                wanted.setdefault(operand, set()).update(wanted[number])
    return carrying
