"""Dual numbers a + b e with e^2 = 0 over any field; nested, they carry mixed derivatives of any order exactly."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any


class Dual:
    """real + tangent * e. Parts are field elements or again Duals; a tangent of plain 0 costs nothing."""

    __slots__ = ("real", "tangent")

    def __init__(self, real: Any, tangent: Any) -> None:
        self.real, self.tangent = real, tangent

    def __add__(self, other: Any) -> Dual:
        if isinstance(other, Dual):
            return Dual(self.real + other.real, _sum(self.tangent, other.tangent))
        return Dual(self.real + other, self.tangent)

    __radd__ = __add__

    def __neg__(self) -> Dual:
        return Dual(-self.real, -self.tangent)

    def __sub__(self, other: Any) -> Dual:
        return self + (-other)

    def __rsub__(self, other: Any) -> Dual:
        return -self + other

    def __mul__(self, other: Any) -> Dual:
        if isinstance(other, Dual):
            return Dual(
                self.real * other.real, _sum(_product(self.real, other.tangent), _product(self.tangent, other.real))
            )
        return Dual(self.real * other, _product(self.tangent, other))

    __rmul__ = __mul__

    def reciprocal(self) -> Dual:
        inverse = 1 / self.real
        return Dual(inverse, _product(_product(inverse, inverse), -self.tangent))

    def __truediv__(self, other: Any) -> Dual:
        return self * (other.reciprocal() if isinstance(other, Dual) else 1 / other)

    def __rtruediv__(self, other: Any) -> Dual:
        return self.reciprocal() * other

    def __pow__(self, exponent: int) -> Any:
        result: Any = 1
        for _ in range(exponent):
            result = self * result
        return result

    def rotated(self, unit: Any, factor: Any) -> Dual:
        """exp(factor self), where `unit` is exp(factor base(self))."""
        turned = self.real.rotated(unit, factor) if isinstance(self.real, Dual) else unit
        return Dual(turned, _product(turned, _product(factor, self.tangent)))

    def square_root(self, root_of_base: Callable[[Any], Any]) -> Dual:
        root = self.real.square_root(root_of_base) if isinstance(self.real, Dual) else root_of_base(self.real)
        return Dual(root, _product(self.tangent, 1 / (2 * root)))


def base(value: Any) -> Any:
    """`value` without any infinitesimal part."""
    while isinstance(value, Dual):
        value = value.real
    return value


def _is_plain_zero(value: Any) -> bool:
    return isinstance(value, int) and value == 0


def _sum(a: Any, b: Any) -> Any:
    return b if _is_plain_zero(a) else a if _is_plain_zero(b) else a + b


def _product(a: Any, b: Any) -> Any:
    return 0 if _is_plain_zero(a) or _is_plain_zero(b) else a * b
