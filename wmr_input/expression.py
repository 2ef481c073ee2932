"""Safe arithmetic: text -> Python's syntax tree -> a value in any algebra, by a whitelist of nodes.

`eval`, `sympy.sympify` and `sympy.parse_expr` would run whatever the text says; here nothing of it is run.
"""

import ast
import operator
import warnings
from collections.abc import Callable, Mapping
from dataclasses import dataclass
from fractions import Fraction
from typing import Any

from wmr_input.errors import WmrError, closest

LONGEST_FORMULA = 1_000_000  # characters of a formula in model.json, which the derivation generates
LONGEST_TEXT = 2000  # characters; a longer text is a mistake or an attack, never a robot
HIGHEST_POWER = 16  # product of nested exponents; without it 9**9**9 would fill the memory
DEEPEST_FUNCTION = 3  # levels of functions in functions; derivatives of deeper ones explode
DEEPEST_GENERATED = 8  # the same in a generated formula, where an angle stands under one more function
OF_TWO = {"atan2": 2}  # functions of two arguments; all others take one
DEEPEST_PARENTHESIS = 40  # levels, far below Python's recursion limit
LONGEST_NUMBER = 40  # characters of one literal; a double needs 24
HIGHEST_EXPONENT = 30  # decimal exponent of one literal; products of a few stay within the range of a double
_BINARY: dict[type[ast.operator], Callable[[Any, Any], Any]] = {  # powers are checked apart
    ast.Add: operator.add,
    ast.Sub: operator.sub,
    ast.Mult: operator.mul,
    ast.Div: operator.truediv,
}
_UNARY: dict[type[ast.unaryop], Callable[[Any], Any]] = {ast.UAdd: operator.pos, ast.USub: operator.neg}


class ExpressionError(WmrError):
    """A text that is not arithmetic over the declared names."""


@dataclass(frozen=True)
class Algebra:
    """What an expression is read into: values by name, functions by name, and the constructor of an exact number."""

    names: Mapping[str, Any]
    functions: Mapping[str, Callable[..., Any]]
    number: Callable[[Fraction], Any]


def evaluate(text: str, algebra: Algebra, longest: int = LONGEST_TEXT) -> Any:
    """The value of `text` in `algebra`.

    `longest` [characters]: generated formulas may be longer than what a person writes.

    Raises:
        ExpressionError: if the text is not arithmetic over the algebra's names and functions.
    """
    if len(text) > longest:
        raise ExpressionError(f"expression of {len(text)} characters", f"use at most {longest}")
    if _depth(text) > DEEPEST_PARENTHESIS:
        raise ExpressionError(f"parentheses {_depth(text)} deep", f"use at most {DEEPEST_PARENTHESIS}")
    try:
        with warnings.catch_warnings():  # Python warns of odd literals, which are refused below
            warnings.simplefilter("ignore")
            tree = ast.parse(text.strip(), mode="eval")
        deepest = DEEPEST_FUNCTION if longest <= LONGEST_TEXT else DEEPEST_GENERATED
        return _Walk(text.strip(), algebra, deepest).value(tree.body, HIGHEST_POWER)
    except SyntaxError as error:
        raise ExpressionError(f"{_shown(text)} is not an expression ({error.msg})", "write arithmetic") from None
    except (ValueError, RecursionError, MemoryError):
        raise ExpressionError(f"{_shown(text)} is not an expression", "write arithmetic over declared names") from None
    except ZeroDivisionError:
        raise ExpressionError(f"division by zero in {_shown(text)}", "remove it") from None


class _Walk:
    """One walk down one syntax tree."""

    def __init__(self, text: str, algebra: Algebra, deepest: int = DEEPEST_FUNCTION) -> None:
        self.text, self.algebra, self.deepest = text, algebra, deepest
        self.functions_open = 0

    def value(self, node: ast.expr, power_left: int) -> Any:
        match node:
            case ast.Constant():
                return self.algebra.number(self.number(node))
            case ast.Name(id=name):
                return self.name(name)
            case ast.UnaryOp(op=op, operand=operand) if type(op) in _UNARY:
                return _UNARY[type(op)](self.value(operand, power_left))
            case ast.BinOp(left=left, op=ast.Pow(), right=right):
                exponent = self.exponent(right)
                power_left //= max(1, abs(exponent.numerator))
                if power_left < 1:
                    raise ExpressionError(f"power too high in {_shown(self.text)}", f"stay within {HIGHEST_POWER}")
                return self.value(left, power_left) ** self.algebra.number(exponent)
            case ast.BinOp(left=left, op=op, right=right) if type(op) in _BINARY:
                return _BINARY[type(op)](self.value(left, power_left), self.value(right, power_left))
            case ast.BinOp(op=ast.BitXor()):
                raise ExpressionError(f"'^' in {_shown(self.text)}", "write powers with **")
            case ast.Call(func=ast.Name(id=name), args=arguments, keywords=keywords):
                function, count = self.function(name), OF_TWO.get(name, 1)
                if keywords or len(arguments) != count:
                    problem = f"function {name!r} takes {'one argument' if count == 1 else 'two arguments'}"
                    raise ExpressionError(problem, f"write {name}(...)" if count == 1 else f"write {name}(y, x)")
                return self.called(function, arguments, power_left)
        raise ExpressionError(
            f"{_shown(ast.get_source_segment(self.text, node) or self.text)} is not arithmetic",
            "only numbers, declared names, + - * / ** and " + ", ".join(sorted(self.algebra.functions)) + " are read",
        )

    def called(self, function: Callable[..., Any], arguments: list[ast.expr], power_left: int) -> Any:
        self.functions_open += 1
        if self.functions_open > self.deepest:
            problem = f"functions in functions more than {self.deepest} deep in {_shown(self.text)}"
            raise ExpressionError(problem, "flatten them")
        values = [self.value(argument, power_left) for argument in arguments]
        self.functions_open -= 1
        return function(*values)

    def number(self, node: ast.Constant) -> Fraction:
        literal = ast.get_source_segment(self.text, node) or ""
        if isinstance(node.value, bool) or not isinstance(node.value, int | float):
            raise ExpressionError(f"{_shown(literal)} is not a number", "write a decimal number or a declared name")
        if len(literal) > LONGEST_NUMBER or _decimal_exponent(literal) > HIGHEST_EXPONENT:
            raise ExpressionError(
                f"number {_shown(literal)} is out of range",
                f"use at most {LONGEST_NUMBER} digits and exponents up to {HIGHEST_EXPONENT}",
            )
        return Fraction(node.value) if isinstance(node.value, int) else Fraction(literal.replace("_", ""))

    def exponent(self, node: ast.expr) -> Fraction:
        match node:
            case ast.UnaryOp(op=ast.USub(), operand=operand):
                return -self.exponent(operand)
            case ast.BinOp(left=left, op=ast.Div(), right=right):
                return self.exponent(left) / self.exponent(right)
            case ast.Constant():
                number = self.number(node)
                if number.denominator <= 2 and abs(number) <= HIGHEST_POWER:
                    return number
        raise ExpressionError(
            f"exponent {_shown(ast.get_source_segment(self.text, node) or '')} in {_shown(self.text)}",
            "exponents are small whole or half numbers",
        )

    def name(self, name: str) -> Any:
        if name in self.algebra.names:
            return self.algebra.names[name]
        if name in self.algebra.functions:
            raise ExpressionError(f"function {name!r} without an argument", f"write {name}(...)")
        raise ExpressionError(f"unknown name {name!r}", closest(name, self.algebra.names))

    def function(self, name: str) -> Callable[..., Any]:
        if name in self.algebra.functions:
            return self.algebra.functions[name]
        raise ExpressionError(f"unknown function {name!r}", closest(name, self.algebra.functions))


def _shown(text: str) -> str:
    return repr(text if len(text) <= 60 else text[:57] + "...")


def _depth(text: str) -> int:
    deepest = depth = 0
    for letter in text:
        depth += (letter in "([{") - (letter in ")]}")
        deepest = max(deepest, depth)
    return deepest


def _decimal_exponent(literal: str) -> int:
    mantissa, _, exponent = literal.lower().partition("e")
    return abs(int(exponent)) if exponent and not mantissa.startswith("0x") else 0
