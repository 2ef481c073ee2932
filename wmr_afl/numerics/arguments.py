"""What callers hand in, looked at where it comes in: what cannot be used is named in one line, with what can."""

from __future__ import annotations

import functools
import inspect
import operator
from collections.abc import Callable, Iterable, Mapping, Sequence
from os import PathLike
from pathlib import Path
from types import NoneType, UnionType
from typing import Any, Literal, ParamSpec, TypeVar, Union, get_args, get_origin, get_type_hints

import numpy as np

from wmr_afl.errors import ArgumentError, ShapeError
from wmr_afl.numerics.arrays import Floats
from wmr_input.errors import shown

Given = ParamSpec("Given")
Found = TypeVar("Found")
_UNFIT = object()  # what stands for an argument that is not of its kind


def checked(function: Callable[Given, Found]) -> Callable[Given, Found]:
    """The same function, whose arguments are first compared with their annotations.

    Raises:
        ArgumentError: if an argument is of another kind.
    """
    signature = inspect.signature(function)
    several = (inspect.Parameter.VAR_POSITIONAL, inspect.Parameter.VAR_KEYWORD)
    single = [name for name, one in signature.parameters.items() if one.kind not in several]

    @functools.cache
    def hints() -> dict[str, Any]:  # read at the first call: an annotation may name what is defined further below
        found = get_type_hints(function)
        return {name: found[name] for name in single if name in found}

    @functools.wraps(function)
    def door(*arguments: Given.args, **named: Given.kwargs) -> Found:
        given = signature.bind(*arguments, **named)
        for name, hint in hints().items():
            if name in given.arguments:
                value = given.arguments[name]
                given.arguments[name] = _taken(value, hint)
                if given.arguments[name] is _UNFIT:
                    raise ArgumentError(f"{name} is {shown(value)}", f"give {_words(hint)}")
        return function(*given.args, **given.kwargs)

    return door


def real_numbers(
    name: str, given: Any, expected: str = "give one number for each entry", kinds: str = "fiubOUS"
) -> Floats:
    """Real numbers as an array; `kinds`: of NumPy's types that are read as numbers, if they can be.

    Raises:
        ShapeError: if something else is among them.
    """
    if isinstance(given, np.ma.MaskedArray) and np.ma.getmaskarray(given).any():
        raise ShapeError(f"{name} has masked entries", f"{expected}, or leave the masked ones out")
    try:
        array = np.asarray(given)
        if array.dtype.kind == "O":  # such as Decimal; None, which NumPy reads as NaN, is refused
            array = np.array([float(one) for one in array.ravel()]).reshape(array.shape)
        elif array.dtype.kind in kinds:
            return array.astype(np.float64)
    except Exception:  # what cannot become an array of numbers may raise anything
        raise ShapeError(f"{name} is not an array of numbers: {shown(given)}", expected) from None
    if array.dtype.kind not in kinds:
        raise ShapeError(f"{name} holds {array.dtype} instead of real numbers", expected)
    return array


def to_write(name: str, given: str | Path) -> Path:
    """The path of what is to be written.

    Raises:
        ArgumentError: if no file can have it, for the system's calls would raise another kind of error.
    """
    if "\0" in str(given):
        raise ArgumentError(f"{name} is {shown(given)}", "give a path without a zero byte")
    return Path(given)


def _taken(value: Any, hint: Any) -> Any:
    """The value as this kind of argument; _UNFIT if it is none. Kinds that are not known here take everything."""
    kind = get_origin(hint) or hint
    if kind in (Union, UnionType):
        found = (_taken(value, one) for one in get_args(hint))
        return next((one for one in found if one is not _UNFIT), _UNFIT)
    if kind in _KINDS:
        try:
            return _KINDS[kind][1](value, get_args(hint))
        except Exception:  # objects that only look like what they should be may raise anything
            return _UNFIT
    if not isinstance(kind, type) or getattr(kind, "_is_protocol", False) or isinstance(value, kind):
        return value
    return _UNFIT


def _words(hint: Any) -> str:
    """What may be given, in words."""
    options = get_args(hint) if get_origin(hint) in (Union, UnionType) else (hint,)
    return " or ".join(_word(get_origin(option) or option, get_args(option)) for option in options)


def _word(kind: Any, inside: tuple[Any, ...]) -> str:
    entries = f", each entry {_words(inside[0])}" if kind is Sequence and inside else ""
    return f"{_KINDS[kind][0] if kind in _KINDS else f'a {kind.__name__}'}{entries}"


def _number(value: Any, _: Any) -> Any:
    return _UNFIT if isinstance(value, str | bytes) or np.ndim(value) else float(value)


def _whole(value: Any, _: Any) -> Any:
    if isinstance(value, float) and value.is_integer():
        return int(value)
    return operator.index(value)


def _text(value: Any, _: Any) -> Any:
    return value if isinstance(value, str) else _UNFIT


def _path(value: Any, _: Any) -> Any:
    return value if isinstance(value, PathLike) else _UNFIT


def _table(value: Any, inside: tuple[Any, ...]) -> Any:
    content = dict(value.items())
    is_fit = all(isinstance(name, str) for name in content) and (
        len(inside) < 2 or all(_taken(one, inside[1]) is not _UNFIT for one in content.values())
    )
    return value if is_fit else _UNFIT


def _several(value: Any, inside: tuple[Any, ...]) -> Any:
    if not inside or iter(value) is value:  # which can be gone through only once
        return value
    return value if all(_taken(one, inside[0]) is not _UNFIT for one in value) else _UNFIT


_KINDS: dict[Any, tuple[str, Callable[[Any, Any], Any]]] = {  # annotation -> what is wanted, the value if it is that
    str: ("text", _text),
    Literal: ("a name", _text),
    Path: ("a path", _path),
    NoneType: ("None", lambda value, _: value if value is None else _UNFIT),
    float: ("a number", _number),
    int: ("a whole number", _whole),
    bool: ("True or False", lambda value, _: bool(value)),
    Callable: ("a function", lambda value, _: value if callable(value) else _UNFIT),
    Mapping: ("a table by name", _table),
    Iterable: ("a list", _several),
    Sequence: ("a list", _several),
}
