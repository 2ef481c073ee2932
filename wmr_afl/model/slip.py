"""Rows of the slip matrix Z(q) by what slips: a wheel sideways, or a driven wheel along its heading."""

from __future__ import annotations

from wmr_afl.model.model import Model


def wheel_rows(model: Model) -> dict[str, int]:
    """The rows of wheels by name, as "right sideways" or "right along"; of two motors on one wheel the first one's."""
    rows: dict[str, int] = {}
    for index, row in enumerate(model.metadata["slip_rows"]):
        if "wheel" in row:
            rows.setdefault(f"{row['wheel']} {row['direction']}", index)
    return rows


def is_driven(model: Model, row: int) -> bool:
    """Whether a motor turns what slips in this row."""
    return "motor" in model.metadata["slip_rows"][row]


def sideways_rows(model: Model) -> dict[int, int]:
    """The rows of wheels that must not slip sideways, by the wheel's place among all wheels."""
    wheels = list(model.metadata["geometry"]["wheels"])
    rows = enumerate(model.metadata["slip_rows"])
    return {wheels.index(row["wheel"]): index for index, row in rows if row.get("direction") == "sideways"}
