"""Declared names do not clash."""

from . import tables as toml
from .reader import Reader


def check_names(told: toml.RobotDescription, reader: Reader) -> None:
    """Names of quantities are distinct from each other, and so are names of frames and wheels.

    Raises: InputError.
    """
    _check_distinct(
        {
            "coordinates": list(told.coordinates),
            "parameters": list(told.parameters),
            "pseudo_velocities": list(told.pseudo_velocities or {}),
            "motors": [motor.input for motor in told.motors],
        },
        reader,
    )
    for table in ("parameters", "pseudo_velocities"):
        for name in getattr(told, table) or {}:
            if name.removesuffix("_dot") in told.coordinates and name.endswith("_dot"):
                problem = f"is the rate of the coordinate {name.removesuffix('_dot')!r}"
                raise reader.mistake(f"[{table}] {name}", problem, "choose another name")
    _check_distinct(
        {"frames": [frame.name for frame in told.frames], "wheels": [wheel.name for wheel in told.wheels]}, reader
    )


def _check_distinct(tables: dict[str, list[str]], reader: Reader) -> None:
    seen: dict[str, str] = {}
    for table, names in tables.items():
        for name in names:
            if name in seen:
                raise reader.mistake(f"[{table}] {name}", f"the name is taken in [{seen[name]}]", "choose another name")
            seen[name] = table
