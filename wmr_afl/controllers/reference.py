"""Reference trajectories yr(t) with first and second derivatives, from any expression of time."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from typing import Annotated, Any, Literal, Self

import numpy as np
from numpy.typing import ArrayLike
from pydantic import Field, model_validator

from wmr_afl.errors import UnknownNameError, WmrError
from wmr_afl.numerics.arguments import checked, real_numbers
from wmr_afl.numerics.arrays import Floats
from wmr_afl.numerics.formulas import TimeFunction
from wmr_afl.numerics.parts import Fixed
from wmr_input.errors import FieldError
from wmr_input.fields import Number, Positive, Table


class Circle(Table):
    """(92): center and radius [output units], rate [rad/s]."""

    center: Annotated[list[Number], Field(min_length=2, max_length=2)]
    radius: Positive
    rate: Number


class FigureEight(Table):
    """(94): center and radius [output units], rate [rad/s]."""

    center: Annotated[list[Number], Field(min_length=2, max_length=2)]
    radius: Positive
    rate: Number


class Line(Table):
    """Constant velocity [output units/s], for any number of outputs."""

    start: list[Number]
    velocity: list[Number]

    @model_validator(mode="after")
    def _same_length(self) -> Line:
        if len(self.start) != len(self.velocity):
            raise FieldError(f"{len(self.start)} entries of start, {len(self.velocity)} of velocity", "give as many")
        return self


class Through(Table):
    """Points of all outputs, in a CSV file with a header or in the table itself, columns by name."""

    file: str | None = None
    points: dict[str, list[Number]] | None = None

    @model_validator(mode="after")
    def _one_of_two(self) -> Through:
        if (self.file is None) == (self.points is None):
            raise FieldError("gives neither file nor points, or both", "give one of them")
        return self


class WaypointsTable(Through):
    """Points at times `t` [s]."""

    between: Literal["quintic", "cubic"] = "quintic"
    ends: Literal["rest", "free"] = "rest"
    stop: Positive = 1.0  # [output units/s^2] behind a free end


class PathTable(Through):
    """A path that is driven from rest to rest within limits."""

    speed: Positive  # [m/s]
    acceleration: Positive  # [m/s^2]
    lateral: Positive | None = None  # [m/s^2], that of `acceleration` unless given
    jerk: Positive | None = None  # [m/s^3]


class TrajectoryTable(Table):
    """One kind of trajectory: named, through points, or an expression of time `t` for every output."""

    circle: Circle | None = None
    figure_eight: FigureEight | None = None
    line: Line | None = None
    waypoints: WaypointsTable | None = None
    path: PathTable | None = None
    expressions: dict[str, str] | None = None

    @model_validator(mode="after")
    def _one_kind(self) -> Self:
        if sum(kind is not None for kind in self.kinds().values()) != 1:
            raise FieldError("names no or several trajectories", f"give one of {', '.join(self.kinds())}")
        return self

    def kinds(self) -> dict[str, Any]:
        """What may be given, one of them, by name."""
        return {name: kind for name, kind in vars(self).items() if name not in ("duration", "stop", "counts_turns")}

    def with_points(self, read: Callable[[str], dict[str, list[float]]]) -> Self:
        """The same with its points in it, which `read` reads from their file if they stand in one."""
        named = {"waypoints": self.waypoints, "path": self.path}
        inside = {
            kind: through.model_copy(update={"file": None, "points": read(through.file)})
            for kind, through in named.items()
            if through is not None and through.file is not None
        }
        return self.model_copy(update=inside) if inside else self


class PieceTable(TrajectoryTable):
    """A trajectory in its own time from zero, and how long it lasts [s] unless it ends by itself."""

    duration: Positive | None = None


class ReferenceTable(TrajectoryTable):
    """A trajectory, or several pieces in a row."""

    pieces: Annotated[list[PieceTable], Field(min_length=1)] | None = None
    stop: Positive | None = None  # [output units/s^2] behind the last piece, 1 unless given
    counts_turns: bool = False  # of outputs that are angles: an error of a whole turn counts

    @model_validator(mode="after")
    def _stop_of_pieces(self) -> Self:
        if self.stop is not None and self.pieces is None:
            raise FieldError("stop means nothing without pieces", "remove it; that of waypoints stands among them")
        return self

    def with_points(self, read: Callable[[str], dict[str, list[float]]]) -> Self:
        """The same with all its points in it, which `read` reads from their files if they stand in some."""
        if self.pieces is None:
            return super().with_points(read)
        inside = [piece.with_points(read) for piece in self.pieces]
        is_same = all(one is other for one, other in zip(inside, self.pieces, strict=True))
        return self if is_same else self.model_copy(update={"pieces": inside})


def circle(center: Sequence[float], radius: float, rate: float) -> list[str]:
    """(92): counter-clockwise at `rate` [rad/s]."""
    return [f"{center[0]!r} + {radius!r}*cos({rate!r}*t)", f"{center[1]!r} + {radius!r}*sin({rate!r}*t)"]


def figure_eight(center: Sequence[float], radius: float, rate: float) -> list[str]:
    """(94): one loop each way in 2 pi/rate seconds."""
    return [f"{center[0]!r} + {radius!r}*sin(2*{rate!r}*t)", f"{center[1]!r} + {radius!r}*sin({rate!r}*t)"]


def line(start: Sequence[float], velocity: Sequence[float]) -> list[str]:
    """From `start` at constant `velocity`, as many entries each."""
    return [f"{s!r} + {v!r}*t" for s, v in zip(start, velocity, strict=True)]


@dataclass(frozen=True)
class Point:
    """yr, yr', yr'' at one time, (n-m,) each."""

    position: Any
    velocity: Any
    acceleration: Any
    counts_turns: bool = False  # an angle that is a whole turn off counts as an error


class Reference(Fixed):
    """A trajectory of the outputs, one expression of time for each; derivatives are taken from the expressions.

    `outputs` are their names in its own order, `ordered` puts them in another one. An output that is an angle is
    compared modulo a turn, unless the reference `counts_turns`.

    Raises:
        ExpressionError: if an expression is wrong.
    """

    outputs: tuple[str, ...]
    counts_turns: bool

    @checked
    def __init__(self, expressions: Mapping[str, str], counts_turns: bool = False) -> None:
        self.expressions, self.outputs, self.counts_turns = dict(expressions), tuple(expressions), counts_turns
        self._of_time = TimeFunction(list(expressions.values()), order=2)

    @property
    def duration(self) -> float | None:
        """When it has come to its end [s]; None if it goes on for ever."""
        return None

    @checked
    def ordered(self, outputs: Sequence[str]) -> Reference:
        """The same trajectory of these outputs, in their order.

        Raises:
            UnknownNameError: if it names another output.
            WmrError: if an output has no reference.
        """
        for name in self.outputs:
            if name not in outputs:
                raise UnknownNameError("output", name, outputs)
        for name in outputs:
            if name not in self.outputs:
                raise WmrError(f"output {name!r} has no reference", self._to_add(name))
        return self if self.outputs == tuple(outputs) else self._of(tuple(outputs))

    def _to_add(self, name: str) -> str:
        """The remedy where an output is missing."""
        return f'add {name} = "..."'

    def _of(self, outputs: tuple[str, ...]) -> Reference:
        """The same trajectory with its outputs in this order."""
        return Reference({name: self.expressions[name] for name in outputs}, self.counts_turns)

    def clock(self, times: Floats, lead: float = 0.0) -> Floats:
        """What a step is given at each of `times` (T,) [s]: the time alone, from which expressions follow, (T,)."""
        return times

    def seen(self, clock: Any, lead: float = 0.0) -> tuple[Any, Point, Point]:
        """Of a row of `clock` the time [s], the reference then, and the one `lead` [s] later."""
        now = self.at(clock)
        return clock, now, self.at(clock + lead) if lead else now

    def at(self, t: Any) -> Point:
        """The reference at time t [s]: columns if t is symbolic, NumPy vectors if it is a number."""
        position, velocity, acceleration = self._of_time(t)
        return Point(position, velocity, acceleration, self.counts_turns)

    def row(self, t: float) -> list[float]:
        """yr, yr', yr'' at time t [s], one after the other."""
        return self._of_time.row(t)

    def over(self, times: ArrayLike) -> tuple[Floats, Floats, Floats]:
        """yr, yr', yr'' at all `times` (T,) [s], (T, n-m) each."""
        row = real_numbers("times", times, "give times [s]").reshape(1, -1)
        if not row.size:  # CasADi has no map over nothing
            return (np.zeros((0, len(self.outputs))),) * 3
        position, velocity, acceleration = (part.full().T for part in self._of_time.function.map(row.shape[1])(row))
        return position, velocity, acceleration
