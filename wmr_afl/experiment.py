"""Experiments as TOML: a robot, a reference, controllers and what disturbs them."""

from __future__ import annotations

import os
from pathlib import Path
from typing import Annotated, Any, Literal

from pydantic import (
    BaseModel,
    ConfigDict,
    Field,
    ValidationError,
    ValidatorFunctionWrapHandler,
    WrapValidator,
    model_validator,
)

from wmr_afl.errors import InputError, UnknownNameError
from wmr_input import read_toml

MOST_SAMPLES = 5_000_000  # of one run; its signals still fit into the memory of a small machine


def _either(what: str) -> WrapValidator:
    """Where a value may be of several kinds, one line says which, instead of one line a kind."""

    def told(value: Any, validate: ValidatorFunctionWrapHandler) -> Any:
        try:
            return validate(value)
        except ValidationError:
            shown = repr(value) if len(repr(value)) <= 60 else repr(value)[:57] + "..."
            raise ValueError(f"{shown} does not fit; expected {what}") from None

    return WrapValidator(told)


Number = Annotated[float, Field(allow_inf_nan=False)]
Positive = Annotated[Number, Field(gt=0)]
NotNegative = Annotated[Number, Field(ge=0)]
Numbers = Annotated[Number | list[Number], _either("a finite number, or a list of them")]
ByName = Annotated[Number | dict[str, Number], _either("a finite number, or a table name = number")]
Named = Annotated[
    Number | list[Number] | dict[str, Number],
    _either("a finite number, a list of them, or a table name = number"),
]
Estimate = Annotated[
    Literal["exact"] | Number | list[Number] | dict[str, Number],
    _either('"exact", a finite number, a list of them, or a table name = number'),
]
Gain = Annotated[
    Number | list[Number] | list[list[Number]] | dict[str, Number],
    _either("a finite number, a list of them, a square matrix, or a table name = number"),
]


class _Table(BaseModel):
    model_config = ConfigDict(extra="forbid", frozen=True, strict=True)


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

    @model_validator(mode="after")
    def _same_length(self) -> Line:
        if len(self.start) != len(self.velocity):
            raise ValueError(f"{len(self.start)} entries of start, {len(self.velocity)} of velocity; give as many")
        return self


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

    @model_validator(mode="after")
    def _samples(self) -> SimulationTable:
        if self.sample_time > self.duration:
            raise ValueError("sample_time exceeds duration; choose a shorter sample or a longer run")
        if self.duration / self.sample_time > MOST_SAMPLES:
            count = self.duration / self.sample_time
            raise ValueError(f"{count:.3g} samples are too many; stay within {MOST_SAMPLES}")
        return self


class OuterLoopTable(_Table):
    """(27), (34)"""

    b1: Numbers
    b2: Numbers
    alpha: Numbers | None = None


class AdaptationTable(_Table):
    """(25); `relative_gain` g gives Gamma_i = g theta_hat_i(0)^2, for base parameters that differ in size and unit."""

    gain: Gain | None = None
    relative_gain: Positive | None = None
    leakage: Named | None = None  # Sigma of (51)
    normalization: Positive | None = None  # Remark 5
    input: Literal["commanded", "applied"] = "commanded"  # at which W is taken

    @model_validator(mode="after")
    def _one_gain(self) -> AdaptationTable:
        if (self.gain is None) == (self.relative_gain is None):
            raise ValueError("names no or two gains; give gain or relative_gain")
        return self


class ProjectionTable(_Table):
    """Remark 7; a plain number bounds the estimates that enter det Dhat, names bound those named.

    `relative` r keeps every estimate within theta_hat(0) +- r |theta_hat(0)|.
    """

    lower: ByName | None = None
    upper: ByName | None = None
    relative: Positive | None = None

    @model_validator(mode="after")
    def _one_kind_of_bound(self) -> ProjectionTable:
        if self.relative is not None and (self.lower is not None or self.upper is not None):
            raise ValueError("names relative and absolute bounds; give relative, or lower and upper")
        return self


class RobustTable(_Table):
    """(70)-(74); a mu that does not decay wants leakage on a_hat (Remark 9)."""

    gamma: Positive
    mu: Positive = 1.0
    mu_decay: NotNegative = 1.0
    leakage: NotNegative = 0.0


class ControllerTable(_Table):
    """The linearizing law; adaptive where `adaptation` is given, robust where `robust` is."""

    outer_loop: OuterLoopTable | None = None
    estimate: Estimate = "exact"
    guess: dict[str, Number] = {}  # physical parameters as the controller believes them, in the place of `estimate`
    adaptation: AdaptationTable | None = None
    projection: ProjectionTable | None = None
    robust: RobustTable | None = None
    input_weights: Numbers = 1.0


class MeasurementNoiseTable(_Table):
    """White noise on the measured state, standard deviation in the units of the state."""

    deviation: Named
    seed: Annotated[int, Field(ge=0)] = 0


class InputLimitsTable(_Table):
    """|u| <= volts"""

    volts: Numbers


class InputDelayTable(_Table):
    """Commands reach the motors late, by whole samples."""

    seconds: Positive


class FrictionTable(_Table):
    """Fv r + Kd sgn r (95), acting on the pseudo-velocities or on the motors' shafts ("wheels").

    `of` = "pseudo_velocities" with `on` = "wheels" is the literal reading of (7), (13).
    """

    viscous: Numbers = 0.0
    coulomb: Numbers = 0.0
    on: Literal["pseudo_velocities", "wheels"]
    of: Literal["pseudo_velocities", "wheels"] | None = None


class DisturbanceTable(_Table):
    """Expressions of time t: one for all channels, or by the name of a pseudo-velocity or of a motor's input."""

    expression: Annotated[str | dict[str, str], _either("an expression, or a table channel = expression")]
    on: Literal["pseudo_velocities", "wheels"]


class LateralSlipTable(_Table):
    """rU(t) of (96) [m/s], an expression of time t."""

    speed: str


class PayloadTable(_Table):
    """Physical parameters of the plant that change at a time [s]."""

    time: NotNegative
    parameters: Annotated[dict[str, Number], Field(min_length=1)]


class UncertaintiesTable(_Table):
    """What the controller does not know of."""

    measurement_noise: MeasurementNoiseTable | None = None
    input_limits: InputLimitsTable | None = None
    input_delay: InputDelayTable | None = None
    friction: FrictionTable | None = None
    disturbance: DisturbanceTable | None = None
    lateral_slip: LateralSlipTable | None = None
    payload: PayloadTable | None = None


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

    @model_validator(mode="after")
    def _names_of_controllers(self) -> Experiment:
        """Controllers name files and lines of plots."""
        seen: dict[str, str] = {}
        for name in self.controllers:
            if not name.strip() or len(name) > 60 or not name.isprintable():
                raise ValueError(f"controller {name[:60]!r} is no good name; use one to 60 printable characters")
            other = seen.setdefault(file_name(name).lower(), name)
            if other != name:
                raise ValueError(f"controllers {other!r} and {name!r} would share files; rename one of them")
        return self

    def place(self, controller: str, key: str) -> str:
        """Where a key of a controller stands in the file: in its own table or under [shared]."""
        own = key in self.controllers[controller].model_fields_set or key not in self.shared.model_fields_set
        return f"[controllers.{controller}] {key}" if own else f"[shared] {key}"

    def controller(self, name: str) -> ControllerTable:
        """A controller's table, completed by what stands under [shared]."""
        table = self.controllers[name]
        return self.shared.model_copy(update={key: getattr(table, key) for key in table.model_fields_set})


def file_name(name: str) -> str:
    """A controller's name as part of a file name."""
    return "".join(letter if letter.isalnum() or letter in "-_" else "_" for letter in name)


_SHIPPED = Path(__file__).parent / "experiments"


def list_experiments() -> list[str]:
    """The names of the shipped experiments."""
    return sorted(path.stem for path in _SHIPPED.glob("*.toml"))


def find_experiment(name: str | Path) -> Path:
    """The file of a shipped experiment, or a file by its path.

    Raises: UnknownNameError.
    """
    path = Path(name)
    if os.path.isfile(path):  # unlike Path.is_file, no error where the name is too long
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
