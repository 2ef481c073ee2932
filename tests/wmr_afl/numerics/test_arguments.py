"""Arguments are compared with their annotations: what is right passes unchanged, what is wrong is named."""

from collections.abc import Callable, Iterable, Mapping, Sequence
from decimal import Decimal
from fractions import Fraction
from pathlib import Path
from typing import Any, Literal

import numpy as np
import pytest
from numpy.typing import ArrayLike

from wmr_afl.errors import ArgumentError, ShapeError
from wmr_afl.numerics.arguments import checked, real_numbers, to_write

KINDS: dict[str, tuple[Any, list[Any], list[Any], str]] = {  # annotation -> what is right, what is wrong, the remedy
    "a name or a path": (
        str | Path,
        ["a", Path("a"), ""],
        [3, None, b"a", ["a"]],
        "text or a path",
    ),
    "a name or nothing": (str | None, ["a", None], [3, False, ["a"]], "text or None"),
    "one of some names": (Literal["numpy", "casadi"], ["numpy", "else"], [3, None, ["numpy"]], "a name"),
    "a number": (
        float,
        [1, 1.5, True, np.float32(1), Fraction(1, 2), np.array(2.0)],
        ["1", 1j, [1.0], None],
        "a number",
    ),
    "a whole number": (
        int,
        [1, np.int64(3), True, np.array(3), 2.0],
        [1.5, "1", None, [1], np.ones(1)],
        "a whole number",
    ),
    "a truth value": (bool, [True, 0, "yes", None], [np.ones(2)], "True or False"),
    "a function": (Callable[[int], None], [print, int], ["print", None], "a function"),
    "names": (Iterable[str] | str | None, [["a"], ("a",), "a", {"a": 1}, None], [3, [3], np.ones(2)], "a list or text"),
    "objects": (Sequence[Path], [[Path("a")], (), []], [["a"], 3, None], "a list, each entry a path"),
    "a table": (
        Mapping[str, ArrayLike] | None,
        [{"a": [1]}, {}, None],
        [[1], "a", {1: 2}, np.ones(2)],
        "a table by name",
    ),
    "an object": (Fraction, [Fraction(1, 2)], [0.5, None, "1/2"], "a Fraction"),
    "an array": (ArrayLike, [1, [1], "a", None, Decimal(1)], [], ""),
}


@pytest.mark.parametrize("kind", KINDS)
def test_an_argument_is_taken_if_it_is_of_its_kind(kind: str) -> None:
    hint, right, wrong, remedy = KINDS[kind]

    def plain(given: Any) -> Any:
        return given

    plain.__annotations__ = {"given": hint, "return": Any}
    function = checked(plain)
    for value in right:
        np.testing.assert_equal(function(value), bool(value) if hint is bool else value)
    for value in wrong:
        with pytest.raises(ArgumentError, match=r"^given is ") as caught:
            function(given=value)
        assert remedy in caught.value.remedy


def test_what_can_be_gone_through_only_once_is_left_as_it_is() -> None:
    @checked
    def joined(names: Iterable[str]) -> str:
        return "".join(names)

    assert joined(name for name in "abc") == "abc"
    assert joined.__name__ == "joined"
    with pytest.raises(TypeError, match="names"):
        joined()  # type: ignore[call-arg]


def test_numbers_are_read_as_they_are_and_nothing_else_becomes_nan() -> None:
    for given in ([1, 2], (1.0, 2.0), np.array([1, 2]), [Decimal(1), Fraction(2)], ["1", "2"], [True, 2]):
        np.testing.assert_array_equal(real_numbers("x", given), [1.0, 2.0])
    for given in (
        None,
        [1.0, None],
        "x",
        [1.0, [2.0]],
        {},
        1j,
        [1j],
        10**400,
        np.array(["2020-01-01"], "datetime64[D]"),
    ):
        with pytest.raises(ShapeError, match=r"^x ") as caught:
            real_numbers("x", given)
        assert caught.value.remedy == "give one number for each entry"
    with pytest.raises(ShapeError, match="masked entries"):
        real_numbers("x", np.ma.masked_array([1.0, 2.0], [True, False]))
    with pytest.raises(ShapeError, match="instead of real numbers"):
        real_numbers("x", ["1"], kinds="fiu")


@pytest.mark.parametrize("given", ["a", "a/b.h5", Path("c"), ".", "with space", "ö"])
def test_what_is_to_be_written_has_any_path_that_a_file_may_have(given: str | Path) -> None:
    """A zero byte ends a path for the system, which would say so in another way."""
    assert to_write("out", given) == Path(given)
    with pytest.raises(ArgumentError, match=r"^out is .*; give a path without a zero byte$"):
        to_write("out", f"{given}\0{given}")
