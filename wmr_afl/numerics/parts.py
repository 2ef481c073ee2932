"""Parts of a closed loop by name: the numbers and states of each stand under its own name, `friction.viscous`."""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Mapping
from types import SimpleNamespace
from typing import Any, ClassVar, Generic, TypeVar

from wmr_afl.errors import WmrError
from wmr_afl.numerics.arrays import Floats

NOTHING = SimpleNamespace()  # numbers or states of a part that has none


class Part:
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


AnyPart = TypeVar("AnyPart", bound=Part)


class Parts(Generic[AnyPart]):
    """Parts in the order in which they act; a second one of a kind is numbered, `friction_2`."""

    def __init__(self, parts: Iterable[AnyPart | None]) -> None:
        self._parts: dict[str, AnyPart] = {}
        for part in parts:
            if part is not None:
                self._parts[self._free(part.name)] = part

    def _free(self, name: str) -> str:
        numbered, count = name, 1
        while numbered in self._parts:
            count += 1
            numbered = f"{name}_{count}"
        return numbered

    def __iter__(self) -> Iterator[AnyPart]:
        return iter(self._parts.values())

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
