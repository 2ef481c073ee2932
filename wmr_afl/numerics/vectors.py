"""Numbers given as one for all, in order, or by name, as vectors."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from numpy.typing import ArrayLike

from wmr_afl.errors import ShapeError, UnknownNameError, WmrError
from wmr_afl.numerics.arrays import Floats
from wmr_input.fields import Named


def by_name(kind: str, given: Named, names: Sequence[str], missing: float | None = None) -> Floats:
    """One number for all, a list in order, or numbers by name, as (len(names),); `kind` says what the names are.

    Raises:
        UnknownNameError: if a name is not one of `names`.
        WmrError: if some are missing and `missing` is None, or the list is of another length.
    """
    if isinstance(given, dict):
        for name in given:
            if name not in names:
                raise UnknownNameError(kind, name, names)
        left = [name for name in names if name not in given]
        if left and missing is None:
            raise WmrError(f"{kind} {left[0]!r} is missing", f"add {left[0]} = ...")
        return np.array([given.get(name, missing) for name in names], dtype=float)
    array = np.asarray(given, dtype=float)
    if array.shape not in ((), (len(names),)):
        raise WmrError(
            f"{array.size} numbers for {len(names)}", f"give one for all, or one for each of {', '.join(names)}"
        )
    return np.broadcast_to(array, (len(names),)).copy()


def told(numbers: ArrayLike) -> str:
    """Numbers in one line of a message: 1, -2.5, 3e-05."""
    return ", ".join(f"{number:g}" for number in np.ravel(numbers))


def per_entry(name: str, value: ArrayLike, size: int) -> Floats:
    """A number for all, or one for each entry, as (size,).

    Raises:
        ShapeError: if it is neither, or not finite.
    """
    array = np.asarray(value, dtype=float)
    if array.shape not in ((), (size,)) or not np.all(np.isfinite(array)):
        raise ShapeError(f"{name} is {value!r}", f"expected one finite number, or {size}")
    return np.broadcast_to(array, (size,)).copy()
