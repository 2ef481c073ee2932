"""Junk that callers hand in: wrong types, wrong shapes, numbers that no robot has, names that nothing has."""

from __future__ import annotations

import random
from collections.abc import Callable
from dataclasses import fields, is_dataclass
from decimal import Decimal
from fractions import Fraction
from pathlib import Path
from typing import Any

import casadi as ca
import numpy as np

from wmr_afl import BatchResult, WmrError
from wmr_input.errors import InputErrors

NUMBERS = (0, 1, -1, 2, 7, 0.5, -0.0, 1e-300, 5e-324, 1e300, -1e300, 2**63, 10**400, float("nan"), float("inf"))
TEXTS = ("", " ", "x", "AFL", "numpy", "theta_hat", "m_C", "nowhere", "a\nb", "a\0b", "\udcff", "1", "é" * 300)
ODD: tuple[Callable[[], Any], ...] = (
    lambda: None,
    lambda: True,
    lambda: False,
    lambda: 1j,
    lambda: b"AFL",
    lambda: Path("nowhere"),
    lambda: Path(),
    lambda: Decimal("NaN"),
    lambda: Decimal("1e5000"),
    lambda: Fraction(1, 3),
    lambda: ...,
    lambda: int,
    lambda: range(3),
    lambda: (one for one in (1.0, 2.0)),
    lambda: {1, 2},
    lambda: object(),
    lambda: np.float32("nan"),
    lambda: np.array(None),
    lambda: np.array("x"),
    lambda: np.zeros((0, 3)),
    lambda: np.zeros((2, 0)),
    lambda: np.array([1.0, None], dtype=object),
    lambda: np.array([1 + 2j, 3]),
    lambda: np.array(["2020-01-01"], dtype="datetime64[D]"),
    lambda: np.ma.masked_array([1.0, 2.0], [True, False]),
    lambda: np.ones(5, dtype=bool),
    lambda: np.full(5, np.nan),
    lambda: np.full((3, 5), np.inf),
    lambda: np.full(6, 1e300),
    lambda: np.zeros(5),
    lambda: np.zeros((2, 5)),
    lambda: np.arange(5),
    lambda: ca.SX.sym("s", 5),
    lambda: ca.MX.sym("m"),
    lambda: ca.DM([1.0, 2.0]),
)


def junk(chosen: random.Random, depth: int = 2) -> Any:
    """One value."""
    kind = chosen.choice(
        ["number", "text", "odd", "odd", "list", "table", "array"] if depth else ["number", "text", "odd"]
    )
    if kind == "number":
        return chosen.choice(NUMBERS)
    if kind == "text":
        return chosen.choice(TEXTS)
    if kind == "odd":
        return chosen.choice(ODD)()
    size = chosen.choice([0, 1, 2, 3, 5, 6])
    if kind == "table":
        return {chosen.choice(TEXTS): junk(chosen, depth - 1) for _ in range(size)}
    if kind == "list":
        same = junk(chosen, depth - 1)
        return [same] * size if chosen.random() < 0.5 else [junk(chosen, depth - 1) for _ in range(size)]
    return np.array([chosen.choice(NUMBERS[:9]) for _ in range(size)], dtype=float)


def shown(value: Any) -> str:
    """A value in a message of a test."""
    try:
        return ascii(value)[:100]
    except Exception:
        return f"a {type(value).__name__}"


def answered(what: str, act: Callable[[], Any]) -> tuple[Any, str]:
    """What a call gives, and the text in which it ends otherwise, one line a mistake; any other end is a fault."""
    said = None
    try:
        return act(), ""
    except WmrError as error:
        said = error
    except Exception as error:
        raise AssertionError(f"{what} ends in {type(error).__name__}: {error}") from error
    for line in said.mistakes if isinstance(said, InputErrors) else (said,):
        assert line.remedy, f"{what}: {line} has no remedy"
        assert "\n" not in str(line), f"{what}: {line} has several lines"
        assert len(str(line)) < 2000, f"{what}: the message has {len(str(line))} characters"
    return None, str(said)


def is_finite(result: Any) -> bool:
    """Whether all numbers of a result are finite; symbols are, and what is no number."""
    if isinstance(result, BatchResult):  # what it says of runs that failed is infinite, and NaN the failure of others
        numbers = {one.name: getattr(result, one.name) for one in fields(result)}
        return all(
            is_finite(numbers[name][~result.failed]) for name in set(numbers) - {"failure_time", "failure_cause"}
        )
    if isinstance(result, dict):
        return all(map(is_finite, result.values()))
    if isinstance(result, list | tuple):
        return all(map(is_finite, result))
    if isinstance(result, ca.DM):
        return is_finite(result.full())
    if isinstance(result, float | np.ndarray | np.generic):
        array = np.asarray(result)
        return array.dtype.kind not in "fc" or bool(np.isfinite(array).all())
    return not is_dataclass(result) or all(is_finite(getattr(result, one.name)) for one in fields(result))
