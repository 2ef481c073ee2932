"""Experiments as TOML: a robot, a reference, controllers and what disturbs them."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated, Literal

from pydantic import BaseModel, ConfigDict, Field, model_validator

from wmr_afl.errors import InputError, UnknownNameError
from wmr_input import read_toml

Number = Annotated[float, Field(allow_inf_nan=False)]
Positive = Annotated[Number, Field(gt=0)]
Numbers = Number | list[Number]
Named = Number | list[Number] | dict[str, Number]  # one for all, all in order, or by name


class _Table(BaseModel):
    model_config = ConfigDict(extra="forbid", frozen=True)


class Circle(_Table):
    """(92)"""

    center: Annotated[list[Number], Field(min_length=2, max_length=2)]
    radius: Positive
    rate: Number


class FigureEight(_Table):
    """(94)"""

    center: Annotated[list[Number], Field(min_length=2, max_length=2)]
    radius: Positive
    rate: Number


class Line(_Table):
    """Constant velocity, for any number of outputs."""

    start: list[Number]
    velocity: list[Number]


class ReferenceTable(_Table):
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


class SimulationTable(_Table):
    """Samples and integration."""

    duration: Positive
    sample_time: Positive
    integrator: Literal["euler", "rk4"] = "euler"


class OuterLoopTable(_Table):
    """(27), (34)"""

    b1: Numbers
    b2: Numbers
    alpha: Numbers | None = None


class AdaptationTable(_Table):
    """(25)"""

    gain: Number | list[Number] | list[list[Number]] | dict[str, Number]


class ProjectionTable(_Table):
    """Remark 7; a plain number bounds the estimates that enter det Dhat, names bound those named."""

    lower: Number | dict[str, Number] | None = None
    upper: Number | dict[str, Number] | None = None


class ControllerTable(_Table):
    """The linearizing law; adaptive where `adaptation` is given."""

    outer_loop: OuterLoopTable | None = None
    estimate: Literal["exact"] | Named = "exact"
    adaptation: AdaptationTable | None = None
    projection: ProjectionTable | None = None
    input_weights: Numbers = 1.0


class MeasurementNoiseTable(_Table):
    """White noise on the measured state, standard deviation in the units of the state."""

    deviation: Named
    seed: Annotated[int, Field(ge=0)] = 0


class InputLimitsTable(_Table):
    """|u| <= volts"""

    volts: Numbers


class UncertaintiesTable(_Table):
    """What the controller does not know of."""

    measurement_noise: MeasurementNoiseTable | None = None
    input_limits: InputLimitsTable | None = None


class Experiment(_Table):
    """One robot, one reference, any number of controllers; `shared` holds for those that do not say otherwise."""

    title: str
    source: str = ""
    robot: str
    parameters: dict[str, Number] = {}
    start: dict[str, Number] = {}
    reference: ReferenceTable
    simulation: SimulationTable
    uncertainties: UncertaintiesTable = UncertaintiesTable()
    shared: ControllerTable = ControllerTable()
    controllers: Annotated[dict[str, ControllerTable], Field(min_length=1)]

    def controller(self, name: str) -> ControllerTable:
        """A controller's table, completed by what stands under [shared]."""
        table = self.controllers[name]
        return self.shared.model_copy(update={key: getattr(table, key) for key in table.model_fields_set})


_SHIPPED = Path(__file__).parent / "experiments"


def list_experiments() -> list[str]:
    """The names of the shipped experiments."""
    return sorted(path.stem for path in _SHIPPED.glob("*.toml"))


def find_experiment(name: str | Path) -> Path:
    """The file of a shipped experiment, or a file by its path.

    Raises: UnknownNameError.
    """
    path = Path(name)
    if path.is_file():
        return path
    if str(name) in list_experiments():
        return _SHIPPED / f"{name}.toml"
    if path.suffix == ".toml":
        raise InputError(str(path), "", "no such file", "check the path")
    raise UnknownNameError("experiment", str(name), list_experiments())


def read_experiment(name: str | Path) -> tuple[Experiment, Path]:
    """A shipped experiment by name, or an experiment file, and where it stands.

    Raises: InputError, UnknownNameError.
    """
    path = find_experiment(name)
    return read_toml(path, Experiment), path
