"""Wheels that slip, one by one: sideways over the ground, or along while they roll at another speed."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from types import SimpleNamespace

import numpy as np
from pydantic import ConfigDict, model_validator

from wmr_afl.errors import UnknownNameError, WmrError
from wmr_afl.model.model import Model
from wmr_afl.model.slip import wheel_rows
from wmr_afl.numerics.arrays import Array, Floats, dot
from wmr_afl.numerics.formulas import TimeFunction
from wmr_afl.numerics.linear_algebra import entries, solve_positive, sum_of_squares
from wmr_afl.plant.uncertainty import Surroundings, Uncertainty, UncertaintyTable
from wmr_input.errors import FieldError
from wmr_input.fields import Table

FREE = 1e-12  # of tr(Z Z^T): enough to hold what no row sees, and too little to be seen
ALIKE = 1e-9  # of the largest singular value: below it rows depend on each other
PLACES = 5  # random configurations at which they are compared

Told = Mapping[str, Mapping[str, str]]  # wheel -> "sideways" or "along" -> speed [m/s], an expression of time


class SlipOfWheel(Table):
    """How a wheel slips [m/s], expressions of time: sideways to its left, along where it moves faster than it rolls."""

    sideways: str | None = None
    along: str | None = None

    @model_validator(mode="after")
    def _slips(self) -> SlipOfWheel:
        if self.sideways is None and self.along is None:
            raise FieldError("does not say how it slips", 'write sideways = "0.05*sin(t)", or along = "0.1"')
        return self


class WheelSlipTable(UncertaintyTable):
    """How wheels slip, by the name of the wheel."""

    model_config = ConfigDict(extra="allow")
    __pydantic_extra__: dict[str, SlipOfWheel]

    def build(self, surroundings: Surroundings) -> WheelSlip:
        told = {wheel: table.model_dump(exclude_none=True) for wheel, table in self.__pydantic_extra__.items()}
        return WheelSlip(surroundings.model, told, surroundings.parameters)


class WheelSlip(Uncertainty):
    """q' = S v + b: told wheels slip as told, and all others as little as that allows.

        Z_told b = s(t) [m/s]        |Z b|^2 + |A b|^2 + FREE tr(Z Z^T) |b|^2 least

    Z are the rows of `slip_matrix`, a rad/s of a joint weighing as much as a m/s; A those of `constraint_matrix`, which
    keep further constraints. The last term holds what no row sees; told rows are exact nevertheless. v' stays: motors
    and wheels do what they do.

    Raises:
        UnknownNameError: if there is no such wheel.
        WmrError: if a wheel cannot slip that way, or wheels that slip depend on each other with parameters p (n_p,).
        ExpressionError: if an expression is wrong.
    """

    name = "wheel_slip"

    def __init__(self, model: Model, told: Told, parameters: Floats) -> None:
        if not told:
            raise WmrError("names no wheel", f"name one of {', '.join(model.metadata['geometry']['wheels'])}")
        speeds = dict(_each(told))
        self.rows = {name: _row(model, *name) for name in speeds}
        self._speeds = TimeFunction([_checked(name, text) for name, text in speeds.items()])
        self._check_independent(model, parameters)

    def rate(self, t: Array, x: Array, p: Array, k: SimpleNamespace, model: Model) -> Array:
        arrays, n = model.arrays, model.coordinate_count
        q, speeds = x[:n], self._speeds(t)[0]
        Z = model.slip_matrix(q, p)
        every = [*entries(Z), *entries(model.constraint_matrix(q, p))]
        small = FREE * sum_of_squares(Z)
        gram = arrays.matrix(
            [[sum((row[i] * row[j] for row in every), small if i == j else 0.0) for j in range(n)] for i in range(n)]
        )
        told = [arrays.vector(entries(Z)[row]) for row in self.rows.values()]
        answers = solve_positive(gram, told, arrays)
        effects = arrays.matrix([[dot(row, answer) for answer in answers] for row in told])
        (shares,) = solve_positive(effects, [speeds], arrays)
        b = sum((shares[i] * answer for i, answer in enumerate(answers)), start=0.0 * q)
        return arrays.join([b, 0.0 * x[n:]])

    def _check_independent(self, model: Model, parameters: Floats) -> None:
        """Check that told rows can have any speeds, at some of a few random configurations."""
        names, n = list(self.rows), model.coordinate_count
        q = np.random.default_rng(0).uniform(-1.0, 1.0, (PLACES, n))
        with np.errstate(all="ignore"):
            rows = np.asarray(model.slip_matrix(q, parameters))[:, list(self.rows.values())]
        rows = rows[np.isfinite(rows).all(axis=(1, 2))]
        for count in range(2, len(names) + 1):
            if _independent(rows[:, :count]):
                continue
            last = names[count - 1]
            for other, row in zip(names[: count - 1], range(count - 1), strict=True):
                if not _independent(rows[:, [row, count - 1]]):
                    what = "share an axle" if last[1] == "sideways" else "slip alike"
                    raise WmrError(f"wheels {other[0]} and {last[0]} {what}", "tell one of them")
            listed = ", ".join(" ".join(name) for name in names[:count])
            raise WmrError(f"what is told depends on each other: {listed}", f"leave out {' '.join(last)}, or another")


def _each(told: Told) -> Iterator[tuple[tuple[str, str], str]]:
    """((wheel, direction), expression) of all that is told."""
    for wheel, directions in told.items():
        for direction, text in directions.items():
            yield (wheel, direction), text


def _row(model: Model, wheel: str, direction: str) -> int:
    """The row of the slip matrix.

    Raises:
        UnknownNameError: if there is no such wheel.
        WmrError: if it cannot slip that way.
    """
    rows, wheels = wheel_rows(model), model.metadata["geometry"]["wheels"]
    if wheel not in wheels:
        raise UnknownNameError(f"wheel of {model.name}", wheel, wheels)
    if f"{wheel} {direction}" in rows:
        return rows[f"{wheel} {direction}"]
    if direction == "along":
        sideways = "it slips sideways only" if f"{wheel} sideways" in rows else "it does not slip"
        raise WmrError(f"wheel {wheel} rolls freely: {sideways}", "tell that, or a wheel that a motor drives")
    raise WmrError(f"wheel {wheel} moves sideways on its rollers: that is no slip", "tell along")


def _checked(name: tuple[str, str], text: str) -> str:
    """An expression of time that can be read.

    Raises:
        WmrError: if it cannot; the text says whose it is.
    """
    try:
        TimeFunction([text])
    except WmrError as error:
        raise WmrError(f"{' '.join(name)}: {error.problem}", error.remedy) from None
    return text


def _independent(rows: Floats) -> bool:
    """Whether rows (places, count, n) have full rank at one of the places at least."""
    if rows.shape[1] > rows.shape[2] or not len(rows):
        return not len(rows)  # with parameters that no robot can have nothing is told
    values = np.linalg.svd(rows, compute_uv=False)
    return bool(np.any(values[:, -1] > ALIKE * values[:, 0]))
