"""Small robots in TOML, built part by part: what a test does not care about has an ordinary value."""

from __future__ import annotations

from collections.abc import Mapping
from functools import cache
from pathlib import Path
from tempfile import TemporaryDirectory

import numpy as np
import sympy as sp

from derive.codegen.write import generate_one, write
from derive.derivation import Derivation, derive_robot
from wmr_afl import Model
from wmr_afl.model.laws import LAWS, Situation

PARAMETERS = {  # value, unit
    "r": (0.1, "m"),
    "a": (0.3, "m"),
    "b": (0.25, "m"),
    "e": (0.05, "m"),
    "L": (0.4, "m"),
    "m": (20.0, "kg"),
    "I": (1.5, "kg m^2"),
    "I_w": (0.02, "kg m^2"),
    "J_w": (0.01, "kg m^2"),
    "k": (1.2, "N m/V"),
    "c": (0.5, "N m s/rad"),
}


def part(table: str, **keys: object) -> str:
    """A table of a list: `part("wheels", name="left", at=["0", "b"])`."""
    lines = [f"[[{table}]]"]
    for key, value in keys.items():
        text = "[" + ", ".join(f'"{one}"' for one in value) + "]" if isinstance(value, list | tuple) else f'"{value}"'
        lines.append(f"{key} = {text}")
    return "\n".join(lines) + "\n"


def wheel(name: str, frame: str = "body", at: tuple[str, str] = ("0", "0"), **keys: str) -> str:
    return part("wheels", name=name, frame=frame, at=at, radius="r", inertia="I_w", spin_inertia="J_w", **keys)


def steered(name: str, at: tuple[str, str], angle: str) -> str:
    return part("frames", name=name, parent="body", at=at, angle=angle)


def motor(drives: str) -> str:
    return part("motors", input=f"u_{drives}", drives=drives, torque_gain="k", back_emf="c")


def robot(
    *parts: str,
    angles: tuple[str, ...] = (),
    outputs: Mapping[str, str] | None = None,
    v: Mapping[str, str] | None = None,
    parameters: Mapping[str, tuple[float, str]] | None = None,
) -> str:
    """The description of a body with `parts`; without outputs the model alone is wanted."""
    text = 'name = "small"\ntitle = "Small robot"\nsource = ""\n'
    text += "" if outputs else "controller = false\n"
    text += '\n[coordinates]\nx = "m"\ny = "m"\nphi = "rad"\n' + "".join(f'{angle} = "rad"\n' for angle in angles)
    text += "\n[parameters]\n"
    for name, (value, unit) in (PARAMETERS | dict(parameters or {})).items():
        text += f'{name} = {{ value = {value}, unit = "{unit}" }}\n'
    text += "\n" + part("frames", name="body", position=["x", "y"], heading="phi")
    text += part("bodies", frame="body", at=["0", "0"], mass="m", inertia="I") + "".join(parts)
    for table, entries in (("pseudo_velocities", v), ("outputs", outputs)):
        if entries:
            text += f"\n[{table}]\n" + "".join(f'{name} = "{formula}"\n' for name, formula in entries.items())
    return text


def derived(text: str, folder: Path) -> Path:
    """The folder of the model that is derived from a description."""
    write({f"small/{name}": content for name, content in files_of(text).items()}, folder)
    return folder / "small"


@cache
def files_of(text: str) -> dict[str, str]:
    """The files of a model, derived once for all tests that look at it."""
    with TemporaryDirectory() as folder:
        path = Path(folder) / "small.toml"
        path.write_text(text)
        return generate_one(path)


@cache
def derivation_of(text: str) -> Derivation:
    """What is derived from a description, once for all tests that look at it."""
    with TemporaryDirectory() as folder:
        path = Path(folder) / "small.toml"
        path.write_text(text)
        return derive_robot(path)


def in_numbers(derivation: Derivation, matrix: sp.Matrix, numbers: Mapping[sp.Symbol, float]) -> np.ndarray:
    """A matrix at these numbers and the default parameters."""
    whole = matrix.applyfunc(derivation.terms.expand).xreplace({**derivation.robot.numbers, **numbers})
    return np.array(whole.tolist(), dtype=float).reshape(matrix.shape)


def lawful_model(folder: Path) -> Model:
    """The model in a folder; it obeys every law."""
    situation = Situation(folder)
    laws = [law for law in LAWS if law.applies(situation.numpy)]
    assert [law.name for law in laws if not law.deviation(situation) <= law.tolerance] == []
    return situation.numpy


AHEAD = {"y1": "x + L*cos(phi)", "y2": "y + L*sin(phi)"}
CORNERS = {"fl": ("a", "b"), "fr": ("a", "-b"), "rl": ("-a", "b"), "rr": ("-a", "-b")}

# Both axles are turned by the same angle: the robot goes in the direction of its wheels and does not turn.
CRAB_PARTS = (
    steered("front", ("a", "0"), "beta"),
    steered("back", ("-a", "0"), "beta"),
    wheel("w_front", "front"),
    wheel("w_back", "back"),
    motor("w_front"),
    motor("w_back"),
    motor("front"),
)
CRAB_OUTPUTS = {"y1": "x + a*cos(phi) + L*cos(phi + beta)", "y2": "y + a*sin(phi) + L*sin(phi + beta)"}
ALONG_THE_BODY = {"v": "x_dot*cos(phi) + y_dot*sin(phi)", "s": "beta_dot"}
CRAB = robot(*CRAB_PARTS, angles=("beta",), outputs=CRAB_OUTPUTS)

ACKERMANN = robot(
    steered("left", ("a", "b"), "atan(a*tan(beta)/(a - b*tan(beta)))"),
    steered("right", ("a", "-b"), "atan(a*tan(beta)/(a + b*tan(beta)))"),
    wheel("w_rear_left", at=("0", "b")),
    wheel("w_rear_right", at=("0", "-b")),
    wheel("w_left", "left"),
    wheel("w_right", "right"),
    motor("w_rear_left"),
    motor("left"),
    angles=("beta",),
    v={"v": "x_dot*cos(phi) + y_dot*sin(phi)", "s": "beta_dot"},
)
