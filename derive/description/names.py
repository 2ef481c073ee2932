"""Declared names do not clash."""

from . import tables as toml
from .reader import Reader


def check_names(description: toml.RobotDescription, reader: Reader) -> None:
    """Fail if two quantities, or two frames or wheels, have the same name.

    Raises:
        InputError: If a name is taken, or is that of a rate.
    """
    _check_distinct(
        {
            "coordinates": list(description.coordinates),
            "parameters": list(description.parameters),
            "pseudo_velocities": list(description.pseudo_velocities or {}),
            "motors": [motor.input for motor in description.motors],
        },
        reader,
    )
    for table in ("parameters", "pseudo_velocities"):
        for name in getattr(description, table) or {}:
            if name.removesuffix("_dot") in description.coordinates and name.endswith("_dot"):
                problem = f"is the rate of the coordinate {name.removesuffix('_dot')!r}"
                raise reader.mistake(f"[{table}] {name}", problem, "choose another name")
    _check_distinct(
        {
            "frames": [frame.name for frame in description.frames],
            "wheels": [wheel.name for wheel in description.wheels],
        },
        reader,
    )


def _check_distinct(tables: dict[str, list[str]], reader: Reader) -> None:
    seen: dict[str, str] = {}
    for table, names in tables.items():
        for name in names:
            if name in seen:
                raise reader.mistake(f"[{table}] {name}", f"the name is taken in [{seen[name]}]", "choose another name")
            seen[name] = table
