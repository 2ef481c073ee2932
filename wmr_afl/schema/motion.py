"""Tables of what is to be followed, and for how long."""

from __future__ import annotations

from typing import Annotated, Literal

from pydantic import Field, model_validator

from wmr_afl.schema.kinds import Number, Positive, Table

MOST_SAMPLES = 5_000_000  # of one run; its signals still fit into the memory of a small machine


class Circle(Table):
    """(92)"""

    center: Annotated[list[Number], Field(min_length=2, max_length=2)]
    radius: Positive
    rate: Number


class FigureEight(Table):
    """(94)"""

    center: Annotated[list[Number], Field(min_length=2, max_length=2)]
    radius: Positive
    rate: Number


class Line(Table):
    """Constant velocity, for any number of outputs."""

    start: list[Number]
    velocity: list[Number]

    @model_validator(mode="after")
    def _same_length(self) -> Line:
        if len(self.start) != len(self.velocity):
            raise ValueError(f"{len(self.start)} entries of start, {len(self.velocity)} of velocity; give as many")
        return self


class ReferenceTable(Table):
    """One kind of trajectory: named, or an expression of time `t` for every output."""

    circle: Circle | None = None
    figure_eight: FigureEight | None = None
    line: Line | None = None
    expressions: dict[str, str] | None = None

    @model_validator(mode="after")
    def _one_kind(self) -> ReferenceTable:
        if sum(kind is not None for kind in vars(self).values()) != 1:
            raise ValueError(f"names no or several trajectories; give one of {', '.join(vars(self))}")
        return self


class SimulationTable(Table):
    """Samples and integration."""

    duration: Positive
    sample_time: Positive
    integrator: Literal["euler", "rk4"] = "euler"

    @model_validator(mode="after")
    def _samples(self) -> SimulationTable:
        if self.sample_time > self.duration:
            raise ValueError("sample_time exceeds duration; choose a shorter sample or a longer run")
        if self.duration / self.sample_time > MOST_SAMPLES:
            count = self.duration / self.sample_time
            raise ValueError(f"{count:.3g} samples are too many; stay within {MOST_SAMPLES}")
        return self
