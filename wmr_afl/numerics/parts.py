"""Parts of a closed loop by name: the numbers and states of each stand under its own name, `friction.viscous`."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Iterator, Mapping
from types import SimpleNamespace
from typing import Any, ClassVar, Generic, TypeVar

import numpy as np

from wmr_afl.errors import WmrError
from wmr_afl.numerics.arrays import Floats

Fault = tuple[Any, Callable[[SimpleNamespace], tuple[str, str]]]
NOTHING = SimpleNamespace()  # numbers or states of a part that has none


class _BuiltOnce(type):
    """Makes what it builds fixed as soon as its constructor is done."""

    def __call__(cls, *arguments: Any, **named: Any) -> Any:
        one = super().__call__(*arguments, **named)
        one.__dict__["_is_built"] = True
        return one


class Fixed(metaclass=_BuiltOnce):
    """Cannot be changed once it is built: what was traced from it, and others that share it, would not notice."""

    def __setattr__(self, name: str, value: Any) -> None:
        if self.__dict__.get("_is_built"):
            raise AttributeError(f"a {type(self).__name__} is fixed once it is built; build another one")
        super().__setattr__(name, value)


class Part(Fixed):
    """Something with numbers that may differ from robot to robot, and with states that change from sample to sample."""

    name: ClassVar[str]

    @property
    def values(self) -> dict[str, Floats]:
        """Numbers by name."""
        return {}

    @property
    def states(self) -> dict[str, Floats]:
        """States at the start, by name."""
        return {}

    def faults(self, k: SimpleNamespace) -> Iterator[Fault]:
        """What numbers may not be: whether they are, (...), and problem and remedy, as text, for one robot.

        `k` holds numbers by name, (..., size): those of one robot, or of many with robots in front.
        """
        return iter(())

    def check_numbers(self) -> None:
        """Checks the part's own numbers.

        Raises:
            WmrError: if they make no sense.
        """
        k = SimpleNamespace(**self.values)
        for is_wrong, describe in self.faults(k):
            if np.any(is_wrong):
                raise WmrError(*describe(k))


AnyPart = TypeVar("AnyPart", bound=Part)


class Parts(Generic[AnyPart]):
    """Parts in the order in which they act; a second one of a kind is numbered, `friction_2`."""

    def __init__(self, parts: Iterable[AnyPart | None]) -> None:
        self._parts: dict[str, AnyPart] = {}
        for part in parts:
            if part is not None:
                self._parts[self._free(part.name)] = part
        for array in (*self.values.values(), *self.states.values()):
            array.flags.writeable = False  # shared by all who run the loop

    def _free(self, name: str) -> str:
        numbered, count = name, 1
        while numbered in self._parts:
            count += 1
            numbered = f"{name}_{count}"
        return numbered

    def __iter__(self) -> Iterator[AnyPart]:
        return iter(self._parts.values())

    def items(self) -> Iterator[tuple[str, AnyPart]]:
        """Each part after its name."""
        return iter(self._parts.items())

    def faults(self, k: SimpleNamespace) -> Iterator[tuple[SimpleNamespace, Fault]]:
        """The faults of all parts, each after the numbers of its part."""
        return ((own, fault) for part, own in self.with_values(k) for fault in part.faults(own))

    @property
    def values(self) -> dict[str, Floats]:
        """Numbers of all parts, by `part.name`."""
        return {f"{key}.{name}": value for key, part in self._parts.items() for name, value in part.values.items()}

    @property
    def states(self) -> dict[str, Floats]:
        """States of all parts at the start, by `part.name`."""
        return {f"{key}.{name}": state for key, part in self._parts.items() for name, state in part.states.items()}

    def with_values(self, k: SimpleNamespace) -> Iterator[tuple[AnyPart, SimpleNamespace]]:
        """Each part with its own numbers out of all of them."""
        return ((part, getattr(k, key, NOTHING)) for key, part in self._parts.items())

    def with_states(
        self, z: SimpleNamespace, k: SimpleNamespace
    ) -> Iterator[tuple[str, AnyPart, SimpleNamespace, SimpleNamespace]]:
        """Each part, after its name, with its own states and numbers out of all of them."""
        return ((key, part, getattr(z, key, NOTHING), getattr(k, key, NOTHING)) for key, part in self._parts.items())


def by_part(flat: Mapping[str, Any]) -> SimpleNamespace:
    """{"p": ..., "friction.viscous": ...} as attributes: `k.p`, `k.friction.viscous`."""
    whole = SimpleNamespace()
    for name, value in flat.items():
        part, dot, entry = name.partition(".")
        if not dot:
            setattr(whole, name, value)
        elif hasattr(whole, part):
            setattr(getattr(whole, part), entry, value)
        else:
            setattr(whole, part, SimpleNamespace(**{entry: value}))
    return whole


def prefixed(part: str, following: Mapping[str, Any]) -> dict[str, Any]:
    """Entries by `part.name` instead of by the part's own names."""
    return {f"{part}.{name}": value for name, value in following.items()}


def disjoint(*parts: Mapping[str, Any]) -> dict[str, Any]:
    """All names of all mappings.

    Raises:
        WmrError: if two of them share a name: one would silently replace the other.
    """
    whole: dict[str, Any] = {}
    for part in parts:
        for name in part:
            if name in whole:
                raise WmrError(f"two parts of the closed loop share the name {name!r}", "name one of them otherwise")
        whole |= part
    return whole
