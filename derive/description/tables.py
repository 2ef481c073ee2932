"""The robot description as it stands in TOML: tables, keys and shapes. What the words mean is `robot.py`'s task."""

import keyword
import re
from pathlib import Path
from typing import Annotated

from pydantic import AfterValidator, BaseModel, BeforeValidator, ConfigDict, Field, model_validator

from wmr_input import read_toml
from wmr_input.errors import FieldError

FUNCTION_NAMES = (  # what an expression may call
    "sin", "cos", "tan", "sqrt", "exp", "asin", "acos", "atan", "atan2", "tanh", "abs", "sign",
)  # fmt: skip


_RESERVED = ("sin", "cos", "tan", "sqrt", "exp", "pi")  # what no quantity may be called


_NAME = re.compile(r"[A-Za-z][A-Za-z0-9_]*")


def _checked_name(name: str) -> str:
    if not _NAME.fullmatch(name) or len(name) > 40:
        raise FieldError(f"{name!r} is not a name", "use letters, digits and _, a letter first, at most 40")
    if keyword.iskeyword(name) or name in _RESERVED:
        raise FieldError(f"{name!r} is a reserved word", "choose another name")
    return name


def _checked_coordinate(name: str) -> str:
    if name.endswith("_dot"):
        raise FieldError(f"{name!r} ends in _dot, which marks rates", "choose another name")
    return name


def _checked_line(text: str) -> str:
    if not text.isprintable():
        raise FieldError(f"{text[:40]!r} holds line breaks or control characters", "write one line of plain text")
    return text


def _checked_size(value: float) -> float:
    if value != 0 and not 1e-12 <= abs(value) <= 1e12:
        raise FieldError(f"{value:g} is out of range", "use 0, or 1e-12 to 1e12 in size, in SI units")
    return value


def _number_as_text(value: object) -> object:
    if isinstance(value, int) and abs(value) > 10**30:
        raise FieldError("a whole number of more than 30 digits is out of range", "use SI units")
    return repr(value) if isinstance(value, int | float) and not isinstance(value, bool) else value


Name = Annotated[str, AfterValidator(_checked_name)]


CoordinateName = Annotated[Name, AfterValidator(_checked_coordinate)]


Line = Annotated[str, AfterValidator(_checked_line), Field(max_length=300)]


Expression = Annotated[str, BeforeValidator(_number_as_text), Field(min_length=1)]


Vector = Annotated[list[Expression], Field(min_length=2, max_length=2)]


FiniteNumber = Annotated[float, Field(allow_inf_nan=False)]


class _Table(BaseModel):
    model_config = ConfigDict(extra="forbid", strict=True, frozen=True)


class Parameter(_Table):
    """A physical parameter with its default value."""

    value: Annotated[FiniteNumber, AfterValidator(_checked_size)]
    unit: Line
    about: Line = ""


class Frame(_Table):
    """A rigid frame: the root with `position` and `heading`, or a joint's child with `parent`, `at` and `angle`.

    `limits`: the smallest and the largest value of `angle` that the joint allows.
    """

    name: Name
    position: Vector | None = None
    heading: Expression | None = None
    parent: str | None = None
    at: Vector | None = None
    angle: Expression | None = None
    limits: Vector | None = None

    @model_validator(mode="after")
    def _is_root_or_jointed(self) -> "Frame":
        root = {self.position is not None, self.heading is not None}
        jointed = {self.parent is not None, self.at is not None, self.angle is not None}
        if len(root) > 1 or len(jointed) > 1 or root == jointed:
            raise FieldError(
                f"frame {self.name!r} is neither a root nor jointed",
                "give position and heading, or parent, at and angle",
            )
        if self.limits is not None and self.angle is None:
            raise FieldError(f"frame {self.name!r} is the root, whose heading has no limits", "remove limits")
        return self


class Body(_Table):
    """A mass on a frame; `inertia` about its own centre of mass, vertical axis."""

    frame: str
    at: Vector
    mass: Expression
    inertia: Expression = "0"


class Wheel(_Table):
    """A wheel on a frame; with `roller_angle` a Swedish wheel."""

    name: Name
    frame: str
    at: Vector
    radius: Expression
    heading: Expression = "0"
    roller_angle: Expression | None = None
    mass: Expression = "0"
    inertia: Expression = "0"
    spin_inertia: Expression = "0"


class Motor(_Table):
    """A motor on a wheel's spin or a joint's angle: torque = torque_gain u - back_emf rate.

    Without `torque_gain` its input is the torque itself, in N m.
    """

    input: Name
    drives: str
    torque_gain: Expression | None = None
    back_emf: Expression = "0"


class Constraint(_Table):
    """A further row of A: an expression linear in the rates that must vanish."""

    expression: Expression


class RobotDescription(_Table):
    """A wheeled robot: a planar tree of rigid frames joined by revolute joints, with masses and wheels attached."""

    name: Name
    title: Line
    source: Line
    coordinates: Annotated[dict[CoordinateName, Line], Field(min_length=1, max_length=40)]
    parameters: dict[Name, Parameter]
    known: list[str] = []
    frames: Annotated[list[Frame], Field(min_length=1)]
    bodies: list[Body] = []
    wheels: list[Wheel] = []
    motors: list[Motor] = []
    constraints: list[Constraint] = []
    pseudo_velocities: Annotated[dict[Name, Expression], Field(min_length=1)] | None = None
    outputs: dict[Name, Expression] = {}
    controller: bool = True  # false: the model alone, without outputs and what a controller needs


def read_description(path: Path) -> RobotDescription:
    """The description in the TOML file at `path`.

    Raises:
        InputError: If a table, a key or a shape is wrong, in one line each.
    """
    return read_toml(path, RobotDescription)
