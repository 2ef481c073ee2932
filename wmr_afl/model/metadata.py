"""What `model.json` holds: the names, units, functions and findings that the runtime reads, and what must fit what."""

from __future__ import annotations

import keyword
import math
import re
from collections.abc import Mapping
from typing import Annotated, Any, Literal

from pydantic import AfterValidator, BaseModel, ConfigDict, Field, ValidationError, model_validator

from wmr_input.errors import FieldError

_NAME = re.compile(r"[A-Za-z][A-Za-z0-9_]*")
_LONGEST_NAME = 100  # letters; a description allows 40, and names that are made of others grow with them


def _checked_name(name: str) -> str:
    if len(name) > _LONGEST_NAME or not _NAME.fullmatch(name) or keyword.iskeyword(name):
        raise FieldError("is no name")
    return name


def _checked_text(text: str) -> str:
    if not text.isprintable():
        raise FieldError("holds line breaks or control characters")
    return text


Name = Annotated[str, AfterValidator(_checked_name)]
Line = Annotated[str, AfterValidator(_checked_text), Field(max_length=300)]  # as long as a description allows
Formula = Annotated[str, AfterValidator(_checked_text), Field(max_length=100_000)]
Units = dict[Name, Formula]
Number = Annotated[float, Field(allow_inf_nan=False)]
Count = Annotated[int, Field(ge=0, le=10_000)]
Sha256 = Annotated[str, Field(pattern=r"^[0-9a-f]{64}$")]


class _Part(BaseModel):
    """A table of `model.json`; keys that only people read are let through."""

    model_config = ConfigDict(strict=True, frozen=True)


class FunctionEntry(_Part):
    """A generated function."""

    arguments: list[Literal["q", "x", "u", "w", "a", "v_r", "p", "theta", "c"]]
    shape: list[Formula]
    size: list[Count]
    equation: Line
    meaning: Line


class MotorEntry(_Part):
    """What a motor drives."""

    drives: Formula
    torque_gain: Formula
    back_emf: Formula


Place = Annotated[list[Formula], Field(min_length=2, max_length=2)]


class PartEntry(_Part):
    """Where a frame, a wheel or a body is."""

    x: Formula
    y: Formula
    heading: Formula


class FrameEntry(PartEntry):
    """What a frame hangs on, and by which angle it is turned; the root has neither."""

    parent: Formula | None = None
    at: Place | None = None
    angle: Formula | None = None
    limits: Place | None = None

    @model_validator(mode="after")
    def _hangs_somewhere(self) -> FrameEntry:
        if len({self.parent is None, self.at is None, self.angle is None}) != 1:
            raise FieldError("names a part of its joint only")
        return self


class BodyEntry(PartEntry):
    """A mass of a frame."""

    frame: Formula
    at: Place
    mass: Formula
    inertia: Formula


class WheelEntry(BodyEntry):
    """A mass that rolls."""

    radius: Formula
    angle: Formula
    spin_inertia: Formula
    roller_angle: Formula | None = None


class GeometryEntry(_Part):
    """The parts of a robot by name."""

    frames: Annotated[dict[Line, FrameEntry], Field(min_length=1)]
    wheels: dict[Line, WheelEntry]
    bodies: dict[Line, BodyEntry]

    @model_validator(mode="after")
    def _frames_are_there(self) -> GeometryEntry:
        named = [frame.parent for frame in self.frames.values() if frame.parent is not None]
        named += [part.frame for part in (*self.wheels.values(), *self.bodies.values())]
        if any(frame not in self.frames for frame in named):
            raise FieldError("names a frame that there is not")
        return self


class SlipEntry(_Part):
    """What slips in a row of the slip matrix: a wheel, sideways or along its heading, or a motor against its joint."""

    wheel: Line | None = None
    direction: Literal["sideways", "along"] | None = None
    joint: Line | None = None
    motor: Name | None = None

    @model_validator(mode="after")
    def _says_what_slips(self) -> SlipEntry:
        of_wheel = self.wheel is not None and self.direction is not None and self.joint is None
        of_joint = self.joint is not None and self.direction is None and self.wheel is None
        if not (of_wheel or of_joint) or (self.motor is None) != (self.direction == "sideways"):
            raise FieldError("names neither a wheel nor a joint that slips")
        return self


class ObstacleEntry(_Part):
    """Why there is no forward form."""

    denominator: Formula
    rank_of_values: int
    states_and_parameter_sets: int
    is_proof: bool


class StraightLineEntry(_Part):
    """The internal dynamics along a straight line."""

    eigenvalues: list[Formula]
    eigenvalues_at_defaults: list[Number | list[Number]]
    forward: Line
    backward: Line


class GroupEntry(_Part):
    """Rows and parameters that share an uncertain factor."""

    rows: list[Count]
    parameters: list[Name]
    scale: Formula


class FindingsEntry(_Part):
    """What the derivation found out."""

    type: Line
    degree_of_mobility: int
    degree_of_steerability: int
    degree_of_nonholonomy: int
    growth_vector: list[int]
    constraints: Line
    controllable: bool
    constraint_rows: list[Formula]
    holonomic_rows: list[Formula]
    dropped_rows: list[Formula]
    pseudo_velocities: Annotated[dict[Name, Formula], Field(min_length=1)]
    degenerate_configurations: list[Formula] | None
    kinematic_singularities: list[Formula]
    parametrization_obstacle: ObstacleEntry | None


class ControlEntry(FindingsEntry):
    """What it found out about outputs besides."""

    relative_degree: dict[Name, int]
    determinant_of: Literal["D", "D D^T"]
    det_decoupling_matrix: Formula
    det_denominator: Formula | None
    singular_where: list[Formula]
    determinant_parameters: list[Name]
    internal_coordinates: list[Name]
    straight_line: StraightLineEntry | None


class Metadata(_Part):
    """`model.json`."""

    name: Annotated[Name, Field(max_length=40)]
    title: Line
    source: Line
    files_sha256: dict[Line, Sha256]
    functions: Annotated[dict[Name, FunctionEntry], Field(min_length=1)]
    state: Units
    inputs: Units
    motors: dict[Name, MotorEntry]
    outputs: Units
    parameters: Units
    defaults: dict[Name, Number]
    about: dict[Name, Line]
    known: Units
    base_parameters: Units
    base_parameter_formulas: dict[Name, Formula]
    parametrization: Literal["forward", "inverse", "physical"]
    inverse_base_parameters: Units
    passivity_parameters: Units
    passivity_groups: list[GroupEntry]
    passivity_obstacle: Formula | None
    effort_parameters: Units
    effort_parameter_formulas: dict[Name, Formula]
    gain_ratio_formulas: dict[Name, Formula]
    effort_obstacle: Formula | None
    geometry: GeometryEntry
    further_constraints: Count  # that no wheel makes
    slip_rows: list[SlipEntry]
    findings: FindingsEntry

    @model_validator(mode="after")
    def _names_fit(self) -> Metadata:
        """Check that tables of the same things name the same ones, in the same order."""
        velocities = list(self.findings.pseudo_velocities)
        for name, table, expected in (
            ("motors", self.motors, self.inputs),
            ("defaults", self.defaults, self.parameters),
            ("about", self.about, self.parameters),
            ("base_parameter_formulas", self.base_parameter_formulas, self.base_parameters),
            ("effort_parameter_formulas", self.effort_parameter_formulas, self.effort_parameters),
            ("known", self.known, [one for one in self.parameters if one in self.known]),
            ("slip_rows", [row.motor for row in self.slip_rows if row.motor], self.inputs),
            ("findings pseudo_velocities", velocities, list(self.state)[-len(velocities) :]),
        ):
            if list(table) != list(expected):
                raise _Misfit(name)
        if len(self.state) <= len(velocities):
            raise _Misfit("state")
        return self

    @model_validator(mode="after")
    def _sizes_fit(self) -> Metadata:
        """Check the size of every function against its shape."""
        velocities = len(self.findings.pseudo_velocities)
        n = len(self.state) - velocities
        sizes = {
            "n": n,
            "m": n - velocities,
            "n-m": velocities,
            "2n-m": len(self.state),
            "n_u": len(self.inputs),
            "n_theta": len(self.base_parameters),
            "n_pi": len(self.passivity_parameters) or len(self.inverse_base_parameters),
            "n_e": len(self.effort_parameters),
            "n_c": len(self.known),
            "n_p": len(self.parameters),
            "k": len(self.slip_rows),
            "n_w": len(self.geometry.wheels),
        }
        for name, function in self.functions.items():
            expected = [sizes.get(symbol, size) for symbol, size in zip(function.shape, function.size, strict=False)]
            if len(function.shape) != len(function.size) or expected != function.size:
                raise _Misfit(f"functions {name} size")
            if len(set(function.arguments)) != len(function.arguments) or math.prod(function.size) > 1_000_000:
                raise _Misfit(f"functions {name}")
        return self

    @model_validator(mode="after")
    def _parts_are_there(self) -> Metadata:
        """Check that what slips is part of the robot, and what groups share one of its parameters."""
        if not self.gain_ratio_formulas.keys() <= self.inputs.keys():
            raise _Misfit("gain_ratio_formulas")
        grouped = {name for group in self.passivity_groups for name in group.parameters}
        if not grouped <= self.passivity_parameters.keys():
            raise _Misfit("passivity_groups")
        for row in self.slip_rows:
            if row.wheel is not None and row.wheel not in self.geometry.wheels:
                raise _Misfit("slip_rows")
            if row.joint is not None and row.joint not in self.geometry.frames:
                raise _Misfit("slip_rows")
        return self

    @model_validator(mode="after")
    def _findings_fit(self) -> Metadata:
        """Check what was found about the outputs, if there are any."""
        if "decoupling_matrix" in self.functions and not self.outputs:
            raise _Misfit("outputs")
        return self


class _Misfit(FieldError):
    """Two tables that do not fit each other; `place` is where to look."""

    def __init__(self, place: str) -> None:
        super().__init__("does not fit the other names")
        self.place = place


def damage(content: Any) -> str | None:
    """The first place of the content of a `model.json` that is missing or damaged; None if nothing is."""
    kind = ControlEntry if isinstance(content, dict) and content.get("outputs") else FindingsEntry
    try:
        whole = Metadata.model_validate(content)
        found = kind.model_validate(content["findings"])
    except ValidationError as error:
        first = error.errors(include_url=False, include_input=False)[0]
        cause = first.get("ctx", {}).get("error")
        below = ("findings",) if error.title == kind.__name__ else ()
        return cause.place if isinstance(cause, _Misfit) else _place((*below, *first["loc"]))
    return _misfit_of_control(whole, found) if isinstance(found, ControlEntry) else None


def _misfit_of_control(whole: Metadata, found: ControlEntry) -> str | None:
    tables: Mapping[str, tuple[list[str], dict[str, Any]]] = {
        "relative_degree": (list(found.relative_degree), whole.outputs),
        "determinant_parameters": (found.determinant_parameters, whole.base_parameters),
    }
    for name, (there, known) in tables.items():
        if not set(there) <= set(known):
            return f"findings {name}"
    return None


def _place(location: tuple[int | str, ...]) -> str:
    parts = [str(part) for part in location]
    return " ".join(part if part.isprintable() and len(part) <= 60 else f"{part[:40]!r}..." for part in parts)
