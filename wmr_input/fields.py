"""Types of values in an experiment's tables: numbers, numbers by name, and the error for what is neither."""

from __future__ import annotations

from typing import Annotated, Any, Literal

from pydantic import (
    BaseModel,
    ConfigDict,
    Field,
    ValidationError,
    ValidatorFunctionWrapHandler,
    WrapValidator,
)

from wmr_input.errors import FieldError, shown


def either(what: str) -> WrapValidator:
    """A validator for a value of several types: one line says what is expected, instead of one line a type."""

    def validated(value: Any, validate: ValidatorFunctionWrapHandler) -> Any:
        try:
            return validate(value)
        except ValidationError:
            raise FieldError(f"{shown(value)} does not fit", f"expected {what}") from None

    return WrapValidator(validated)


Number = Annotated[float, Field(allow_inf_nan=False)]
Positive = Annotated[Number, Field(gt=0)]
NotNegative = Annotated[Number, Field(ge=0)]
Numbers = Annotated[Number | list[Number], either("a finite number, or a list of them")]
ByName = Annotated[Number | dict[str, Number], either("a finite number, or a table name = number")]
Named = Annotated[
    Number | list[Number] | dict[str, Number],
    either("a finite number, a list of them, or a table name = number"),
]
Estimate = Annotated[
    Literal["exact"] | Number | list[Number] | dict[str, Number],
    either('"exact", a finite number, a list of them, or a table name = number'),
]
Names = Annotated[str | Annotated[list[str], Field(min_length=1)], either("a name, or a list of them")]
Gain = Annotated[
    Number | list[Number] | list[list[Number]] | dict[str, Number],
    either("a finite number, a list of them, a square matrix, or a table name = number"),
]


class Table(BaseModel):
    """A table of a TOML file: no unknown keys, no conversion of types, no change once it is read."""

    model_config = ConfigDict(extra="forbid", frozen=True, strict=True)
