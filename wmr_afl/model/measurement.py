"""What of a robot is measured: entries of its state, and rates of its motors as their encoders tell them."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from numpy.typing import ArrayLike

from wmr_afl.errors import UnknownNameError, WmrError
from wmr_afl.model.model import Model
from wmr_afl.numerics.arrays import Array, Floats
from wmr_afl.numerics.linear_algebra import entries, solve_positive
from wmr_afl.numerics.vectors import by_name
from wmr_input.fields import Named


class Measurement:
    """z = [entries of q and v; rates of motors X(q) v (10)], by name and in the order given; motors by their inputs.

    Raises:
        UnknownNameError: if a name is neither an entry of the state nor a motor.
        WmrError: if nothing is measured, or something twice.
    """

    def __init__(self, model: Model, names: Sequence[str]) -> None:
        states, motors = list(model.state_units), list(model.input_units)
        for name in names:
            if name not in (*states, *motors):
                raise UnknownNameError("entry of the state or motor", name, [*states, *motors])
        twice = next((name for n, name in enumerate(names) if name in names[:n]), None)
        if not names or twice is not None:
            problem = "nothing is measured" if twice is None else f"{twice} is measured twice"
            raise WmrError(problem, "name each entry of the state or motor that is measured, once")
        self.names = tuple(names)
        self._states = [states.index(name) if name in states else None for name in names]
        self._motors = [motors.index(name) if name in motors else None for name in names]
        self._coordinates = model.coordinate_count
        self._rates = set(range(self._coordinates, len(states)))
        self._turns_all = bool(motors) and set(range(len(motors))) <= set(self._motors) and _turn_all_of_v(model)
        radian = {name for name, unit in model.state_units.items() if unit == "rad"}
        self.is_angle = [name in radian and states.index(name) < self._coordinates for name in names]

    @property
    def coordinates(self) -> dict[int, int]:
        """Which entry of z holds a coordinate, by the index of the coordinate."""
        return {i: n for n, i in enumerate(self._states) if i is not None and i < self._coordinates}

    def is_state(self, place: int) -> bool:
        """Whether an entry of z is one of the state, and not a motor's rate."""
        return self._states[place] is not None

    @property
    def tells_q(self) -> bool:
        """Whether all of q is measured."""
        return len(self.coordinates) == self._coordinates

    @property
    def tells_v(self) -> bool:
        """Whether all of v is measured, or the rates of all motors, from which v follows."""
        return self._rates <= set(self._states) or self._turns_all

    def state(self, z: Array, p: Array, model: Model) -> Array:
        """[q; v] as measured, where all of q is: v, or the one that fits the rates of all motors best, or else zero."""
        q = [z[self.coordinates[i]] for i in range(self._coordinates)]
        if self._rates <= set(self._states):
            v = [z[self._states.index(i)] for i in sorted(self._rates)]
        elif self._turns_all:
            X = model.actuator_rates_matrix(model.arrays.vector(q), p)
            turned = model.arrays.vector([z[self._motors.index(j)] for j in range(X.shape[0])])
            (solved,) = solve_positive(X.T @ X, [X.T @ turned], model.arrays)
            v = [solved[j] for j in range(len(self._rates))]
        else:
            v = [0.0] * len(self._rates)
        return model.arrays.vector([*q, *v])

    def picked(self, x: Array) -> Array | None:
        """z out of the state as it is measured (2n-m,); None if motors' rates are measured, too."""
        return None if None in self._states else x[[i for i in self._states if i is not None]]

    def of(self, x: Array, p: Array, model: Model) -> Array:
        """z of a robot in state x (2n-m,) with parameters p (n_p,)."""
        rows = self.rows(x[: self._coordinates], p, model)
        return model.arrays.vector([sum(weight * x[i] for i, weight in row.items()) for row in rows])

    def rows(self, q: Array, p: Array, model: Model) -> list[dict[int, Array]]:
        """Each entry of z as a sum over entries of x: by index the weight, 1 or an entry of X(q)."""
        rates: list[list[Array]] = []
        if any(motor is not None for motor in self._motors):
            rates = entries(model.actuator_rates_matrix(q, p))
        return [
            {i: 1.0} if i is not None else {self._coordinates + j: weight for j, weight in enumerate(rates[motor or 0])}
            for i, motor in zip(self._states, self._motors, strict=True)
        ]

    def sizes(self, q: Floats, p: Floats, model: Model) -> list[float]:
        """How much larger than those of v the rates in z are: of a motor the length of its row of X(q), else 1."""
        rows = self.rows(q, p, model.in_library("numpy"))
        lengths = [float(np.sqrt(sum(float(weight) ** 2 for weight in row.values()))) for row in rows]
        return [one if np.isfinite(one) and one > 0.0 else 1.0 for one in lengths]

    def deviations(self, given: Named | None, coordinate: float, rates: ArrayLike) -> list[float]:
        """The noise of each entry of z: as `given`, else that of a coordinate [m, rad] or of `rates`, all or each."""
        others = np.broadcast_to(rates, len(self.names)).tolist()
        pairs = zip(self._states, others, strict=True)
        usual = [coordinate if i is not None and i < self._coordinates else other for i, other in pairs]
        if given is None:
            return usual
        if isinstance(given, dict):
            given = {**dict(zip(self.names, usual, strict=True)), **given}
        return [float(value) for value in by_name("measured entry", given, self.names)]


def _turn_all_of_v(model: Model) -> bool:
    """Whether v follows from the rates of the motors: X(q) has full rank at a place chosen at random."""
    q = np.random.default_rng(0).uniform(0.3, 1.2, model.coordinate_count)
    X = np.asarray(model.in_library("numpy").actuator_rates_matrix(q, model.parameters()))
    return bool(np.isfinite(X).all()) and int(np.linalg.matrix_rank(X)) == model.pseudo_velocity_count
