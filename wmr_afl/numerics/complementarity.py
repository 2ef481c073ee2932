"""Forces within bounds that stop what they oppose: the law of dry friction and of stops, in steps of time."""

from __future__ import annotations

from collections.abc import Sequence

from wmr_afl.numerics.arrays import Array, Arrays

SWEEPS = 32  # leave less than 1e-6 of a motion for every shipped robot; with one force, or forces apart, one is exact


def stopping_forces(
    rates: Sequence[Array],
    effects: Sequence[Sequence[Array]],
    least: Sequence[Array | None],
    most: Sequence[Array | None],
    arrays: Arrays,
) -> list[Array]:
    """F (k,) with least <= F <= most, so that the rates that are left, rates - effects F, are

        zero where F lies between its bounds, not negative where F = most, not positive where F = least.

    None is no bound. `effects` (k, k) is symmetric and not negative. Solved by projected Gauss-Seidel sweeps, which
    converge for every such matrix; a force without effect is at rest.

    References: Jourdan, Alart, Jean, A Gauss-Seidel like algorithm to solve frictional contact problems, Computer
    Methods in Applied Mechanics and Engineering 155, 1998.
    """
    count = len(rates)
    force: list[Array] = [0.0] * count
    own = [arrays.where(effects[i][i] > 0.0, effects[i][i], 1.0) for i in range(count)]
    for _ in range(SWEEPS if count > 1 else 1):
        for i in range(count):
            left = rates[i]
            for j in range(count):
                if j != i:
                    left = left - effects[i][j] * force[j]
            force[i] = _between(left / own[i], least[i], most[i], arrays)
    return force


def _between(value: Array, least: Array | None, most: Array | None, arrays: Arrays) -> Array:
    value = value if most is None else arrays.minimum(value, most)
    return value if least is None else arrays.maximum(value, least)
