"""What is written can be read back, and `show` tells it in a few lines."""

from __future__ import annotations

import io
import json
import re
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import pytest
from rich.console import Console
from typer.testing import CliRunner

from derive.algebra import formula_text
from derive.algebra.formula_text import TOO_LONG
from tests.derive.descriptions import ACKERMANN, CRAB, derived, files_of, motor, part, robot, steered, wheel
from wmr_afl import load_model
from wmr_afl.cli import app
from wmr_afl.cli.show import describe
from wmr_afl.numerics.formulas import numpy_value

_NAMES = 21  # columns of the names of findings

CASTERS = robot(
    part("frames", name="m0", parent="body", at=["a", "b"], angle="g0"),
    part("frames", name="m1", parent="body", at=["-a", "-b"], angle="g1"),
    *(wheel(f"w{k}", f"m{k}", ("-e", "0")) for k in range(2)),
    *(motor(f"w{k}") for k in range(2)),
    *(motor(f"m{k}") for k in range(2)),
    angles=("g0", "g1"),
    outputs={"X": "x", "Y": "y", "P": "phi"},
)


def formulas(content: dict[str, Any]) -> Iterator[str]:
    """The formulas of model.json that somebody may compute with."""
    found = content["findings"]
    missed = found.get("not_found_out", {})
    for part_ in (one for kind in content["geometry"].values() for one in kind.values()):
        yield from (part_[key] for key in ("x", "y", "heading", "radius", "roller_angle") if key in part_)
    for motor_ in content["motors"].values():
        yield from (motor_["torque_gain"], motor_["back_emf"])
    yield from content["base_parameter_formulas"].values()
    if "det_decoupling_matrix" not in missed:
        yield found["det_decoupling_matrix"]
    yield from (condition.removesuffix(" = 0") for condition in found["singular_where"])


def test_formulas_can_be_read_back(tmp_path: Path) -> None:
    content = json.loads((derived(CASTERS, tmp_path) / "model.json").read_text())
    names = [*content["state"], *content["parameters"], *content["base_parameters"], "Delta"]
    values = {name: 0.3 + 0.01 * k for k, name in enumerate(names)}
    for text in formulas(content):
        numpy_value(text, values)


def test_a_determinant_too_long_to_be_read_is_not_written(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(formula_text, "_LONGEST_TEXT", 100)
    files_of.cache_clear()  # what other tests derived, they derived without this limit
    folder = derived(CASTERS, tmp_path)
    files_of.cache_clear()
    found = load_model(folder).findings
    assert found["det_decoupling_matrix"] == TOO_LONG
    assert found["not_found_out"]["det_decoupling_matrix"] == TOO_LONG
    done = CliRunner().invoke(app, ["check", str(folder)])
    assert done.exit_code == 0, done.output
    assert "not found out: too long to be read" in CliRunner().invoke(app, ["show", str(folder)]).output


def shown(folder: str | Path) -> str:
    console = Console(width=80, record=True, file=io.StringIO())
    for renderable in describe(load_model(folder)):
        console.print(renderable)
    return console.export_text()


@pytest.mark.parametrize("text", [CASTERS, CRAB], ids=["driven casters", "crab"])
def test_no_name_is_shown_that_only_the_derivation_knows(text: str, tmp_path: Path) -> None:
    folder = derived(text, tmp_path)
    internal = set(re.findall(r"\b(?:inertia|coriolis|pivot|ratio|force)_\w+", shown(folder)))
    assert internal == set()


@pytest.mark.parametrize("text", [CASTERS, ACKERMANN], ids=["driven casters", "Ackermann"])
def test_no_finding_takes_more_than_three_lines(text: str, tmp_path: Path) -> None:
    facts = shown(derived(text, tmp_path)).split(" form  ")[0].splitlines()
    lines: dict[str, int] = {}
    name = ""
    for line in facts:
        name = line[:_NAMES].strip() or name
        lines[name] = lines.get(name, 0) + 1
    lists = {"state", "pseudo-velocities", "constraints"}
    assert {name: count for name, count in lines.items() if count > 3 and name not in lists} == {}


def test_the_limits_of_joints_are_shown(tmp_path: Path) -> None:
    fork = steered("fork", ("a", "0"), "beta") + "limits = [-0.6, 0.6]\n"
    folder = derived(robot(fork, wheel("rear"), wheel("front", "fork"), motor("fork"), angles=("beta",)), tmp_path)
    assert "fork: -0.6 to 0.6 rad" in shown(folder)
