"""Voltages to play on a robot: held from row to row, with a loop around the angles of joints that motors turn.

As a file: `t` [s], a column for each motor's voltage [V], and for each loop `angle_reference:COORDINATE` [rad] and
`gain:MOTOR:COORDINATE` [V/rad].
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from wmr_afl.errors import InputError
from wmr_afl.identification.log_file import numbers, table
from wmr_afl.model.model import Model
from wmr_afl.numerics.arrays import Floats


@dataclass(frozen=True)
class Loop:
    """gain (reference - angle) is added to a motor's voltage."""

    motor: int
    coordinate: int
    gain: Floats  # (T,) [V/rad]
    reference: Floats  # (T,) [rad]


@dataclass(frozen=True)
class Voltages:
    """Commands by time and state, the last ones from the end on."""

    time: Floats  # (T,) [s]
    u: Floats  # (T, n_u) [V]
    loops: tuple[Loop, ...] = ()

    def __call__(self, t: float, x: Floats) -> Floats:
        """u (n_u,) [V] at time t and state x."""
        row = max(0, int(np.searchsorted(self.time, t + 1e-9, side="right")) - 1)
        u = self.u[row].copy()
        for loop in self.loops:
            u[loop.motor] += loop.gain[row] * (loop.reference[row] - x[loop.coordinate])
        return u

    def text(self, model: Model) -> str:
        """The file's text; numbers are exact."""
        motors, states = list(model.input_units), list(model.state_units)
        header, columns = ["t", *motors], [self.time, *self.u.T]
        for loop in self.loops:
            coordinate = states[loop.coordinate]
            header += [f"angle_reference:{coordinate}", f"gain:{motors[loop.motor]}:{coordinate}"]
            columns += [loop.reference, loop.gain]
        rows = np.column_stack(columns).tolist()
        return "".join(",".join(line) + "\n" for line in [header, *(map(repr, row) for row in rows)])


def read_voltages(model: Model, path: str | Path) -> Voltages:
    """Voltages from a file.

    Raises:
        InputError: if it cannot be read, a column is missing or unknown, time does not go on, or a cell is no number.
    """
    file = str(path)
    names, lines, rows = table(file)
    columns = dict(zip(names, numbers(names, lines, rows, file).T, strict=True))
    motors, coordinates = list(model.input_units), list(model.state_units)[: model.coordinate_count]
    for name in ("t", *motors):
        if name not in columns:
            raise InputError(file, f"column {name}", "is missing", "add time [s] and the voltage of each motor")
    loops = []
    for name in names:
        if name in ("t", *motors) or name.startswith("angle_reference:"):
            continue
        kind, *of = name.split(":")
        if kind != "gain" or len(of) != 2 or of[0] not in motors or of[1] not in coordinates:
            raise InputError(file, f"column {name}", "is unknown", "name a motor, or gain:MOTOR:COORDINATE of a loop")
        if f"angle_reference:{of[1]}" not in columns:
            raise InputError(file, f"column angle_reference:{of[1]}", "is missing", f"add it beside {name}")
        motor, coordinate = motors.index(of[0]), coordinates.index(of[1])
        loops.append(Loop(motor, coordinate, columns[name], columns[f"angle_reference:{of[1]}"]))
    return _checked(
        Voltages(columns["t"], np.column_stack([columns[name] for name in motors]), tuple(loops)), file, lines
    )


def _checked(found: Voltages, file: str, lines: Sequence[int]) -> Voltages:
    if len(found.time) < 2:
        raise InputError(file, "", "holds fewer than two rows", "write one row for each change of a voltage")
    back = np.flatnonzero(np.diff(found.time) <= 0.0)
    if len(back):
        raise InputError(file, f"line {lines[back[0] + 1]}", "time does not go on", "order the rows by time")
    return found
