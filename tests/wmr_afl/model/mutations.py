"""Mutations of what a JSON file holds: anything that a text editor, a bad disk or a malicious sender may do to it."""

from __future__ import annotations

import copy
import random
from typing import Any

HUGE = (10**30, 1e308, -1e308, 10**400, float("nan"), float("inf"), "x" * 200_000, ["y"] * 5000)
ODD = (None, True, False, 0, -1, 3.5, "", "\0", "\n", "\x1b[31m", "[/red] $a_{", "__class__", "..", [], {}, [[]], "1/0")


def places(content: Any, path: tuple[Any, ...] = ()) -> list[tuple[Any, ...]]:
    """The paths of all entries, at any depth."""
    found = [path] if path else []
    if isinstance(content, dict):
        for key, value in content.items():
            found += places(value, (*path, key))
    if isinstance(content, list):
        for index, value in enumerate(content):
            found += places(value, (*path, index))
    return found


def mutated(content: Any, chosen: random.Random, place: tuple[Any, ...] | None = None) -> tuple[Any, str]:
    """A copy with one entry changed, and what was done."""
    new = copy.deepcopy(content)
    place = place or chosen.choice(places(new))
    holder = new
    for key in place[:-1]:
        holder = holder[key]
    last = place[-1]
    kinds = ["delete", "type", "nest", "huge", "size", "name", "swap", "deep"]
    kind = chosen.choice(kinds)
    value = holder[last]
    if kind == "delete":
        del holder[last]
    elif kind == "type":
        holder[last] = chosen.choice(ODD)
    elif kind == "nest":
        holder[last] = chosen.choice([{"a": value}, [value], {str(last): {str(last): value}}])
    elif kind == "huge":
        holder[last] = chosen.choice(HUGE)
    elif kind == "size":
        if isinstance(value, list):
            holder[last] = chosen.choice([[], value + value, value[:-1], [*value, 7]])
        elif isinstance(value, dict):
            holder[last] = dict(list(value.items())[: chosen.randrange(len(value) + 1)])
        elif isinstance(value, int | float) and not isinstance(value, bool):
            holder[last] = value + chosen.choice([1, -1, 1000, -1000])
        else:
            holder[last] = str(value) * 2
    elif kind == "name" and isinstance(holder, dict):
        name = chosen.choice([*map(str, ODD), str(last) + "_", str(last) * 300, "output", "state", "name"])
        items = [(name if key == last else key, entry) for key, entry in holder.items()]
        holder.clear()
        holder.update(items)
    elif kind == "swap":
        other = new
        for key in chosen.choice(places(new)):
            other = other[key]
        holder[last] = copy.deepcopy(other)
    else:
        deep: Any = value
        for _ in range(chosen.choice([30, 900])):
            deep = [deep]
        holder[last] = deep
    return new, f"{kind} {'.'.join(map(str, place))[:80]}"
