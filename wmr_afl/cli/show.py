"""The texts of the verb `show`: the findings of a model, and what one step of a closed loop computes."""

from __future__ import annotations

from collections import Counter
from collections.abc import Iterator, Mapping
from typing import Any

import casadi as ca
from rich.console import RenderableType
from rich.markup import escape
from rich.table import Table

from wmr_afl.model.model import Model
from wmr_afl.simulation.batch import watched_signals
from wmr_afl.simulation.closed_loop import ClosedLoop, trace
from wmr_afl.simulation.kernels.block import LANES
from wmr_afl.simulation.kernels.compiled import kernel_text, print_loop
from wmr_afl.simulation.layout import Layout

# What the forms of the parametrization mean.
FORMS = {
    "forward": "forward: v' is linear in theta; the robot can be adapted",
    "inverse": "inverse: the inputs that bring about v' = a are linear in theta",
    "physical": "physical: linear in no theta, which stands for the uncertain parameters themselves",
}
_NO_WORK = (ca.OP_INPUT, ca.OP_OUTPUT, ca.OP_CONST)  # instructions that compute nothing
_NAMES = {value: name[3:].lower() for name, value in vars(ca).items() if name.startswith("OP_")}  # of operations


def describe(model: Model) -> Iterator[RenderableType]:
    """The findings of a model, part by part."""
    found = model.findings
    source = model.metadata["source"]
    yield f"[bold]{escape(model.title)}[/bold]  ({model.name}{'; geometry: ' if source else ''}{escape(source)})"
    facts = Table(box=None, show_header=False, padding=(0, 2, 0, 0))
    facts.add_column(style="dim")
    facts.add_column()
    growth = ", ".join(str(dimension) for dimension in found["growth_vector"])
    facts.add_row(
        "type",
        f"{found['type']}: mobility {found['degree_of_mobility']}, steerability {found['degree_of_steerability']}",
    )
    facts.add_row("state", _with_units(model.state_units))
    facts.add_row("inputs", _with_units(model.input_units))
    facts.add_row("outputs", _with_units(model.output_units))
    facts.add_row("pseudo-velocities", "\n".join(f"{v} = {form}" for v, form in found["pseudo_velocities"].items()))
    facts.add_row("", _where("not defined", found["kinematic_singularities"]) or "smooth everywhere")
    count = len(found["constraint_rows"])
    facts.add_row("constraints", f"{count}, {found['constraints']}" if count else "none")
    for row in found["constraint_rows"]:
        holonomic = " (can be integrated)" if row in found["holonomic_rows"] else ""
        facts.add_row("", escape(row + holonomic))
    for row in found["dropped_rows"]:
        facts.add_row("", escape(f"follows from these: {row}"))
    degenerate = found["degenerate_configurations"]
    facts.add_row(
        "degenerate", "not examined" if degenerate is None else _where("more motion", degenerate) or "nowhere"
    )
    facts.add_row("degree of nonholonomy", f"{found['degree_of_nonholonomy']} (growth of brackets {growth})")
    facts.add_row("controllable", "yes, in small time" if found["controllable"] else "no")
    facts.add_row("parametrization", FORMS[model.parametrization])
    obstacle = found["parametrization_obstacle"]
    if obstacle:
        facts.add_row("no forward form", f"the denominator {obstacle['denominator']} mixes state and parameters;")
        proof = "which proves it" if obstacle["is_proof"] else "which proves nothing"
        count = obstacle["states_and_parameter_sets"]
        facts.add_row(
            "", f"values at {count} states and parameter sets have rank {obstacle['rank_of_values']}, {proof}"
        )
    facts.add_row("known constants", _with_units(model.known_units) or "none")
    if model.has("decoupling_matrix"):
        for name, text in _control(found):
            facts.add_row(name, text)
    else:
        facts.add_row("controller", "none: the description wants the model alone")
    yield facts
    base = Table(
        "base parameter",
        "formula",
        "unit",
        "at the defaults",
        box=None,
        header_style="bold",
        title=f"{model.parametrization} form",
        title_justify="left",
    )
    theta = model.base_parameters(model.parameters())
    for (name, unit), value in zip(model.base_parameter_units.items(), theta, strict=True):
        base.add_row(name, model.base_parameter_formulas[name], unit, f"{value:.6g}")
    yield base
    physical = Table("parameter", "default", "unit", "to the controller", "meaning", box=None, header_style="bold")
    for name, unit in model.parameter_units.items():
        role = "known" if name in model.known_units else "uncertain"
        physical.add_row(
            name, f"{model.metadata['defaults'][name]:g}", unit, role, escape(model.metadata["about"][name])
        )
    yield physical


def describe_loop(loop: ClosedLoop, controller: str) -> Iterator[RenderableType]:
    """States, numbers and signals of a closed loop, and how many operations one step takes."""
    step, program = trace(loop), print_loop(trace(loop), LANES)
    yield f"[bold]{escape(controller)}[/bold] on {loop.model.name}, every {loop.sample_time:g} s"
    facts = Table(box=None, show_header=False, padding=(0, 2, 0, 0))
    facts.add_column(style="dim")
    facts.add_column()
    facts.add_row("state", _sizes(Layout(loop.states).sizes))
    facts.add_row("numbers of a robot", _sizes(Layout(loop.values).sizes))
    facts.add_row("signals", _sizes(loop.signals))
    counts = Counter(_name(step, k) for k in range(step.n_instructions()) if step.instruction_id(k) not in _NO_WORK)
    facts.add_row("operations of a step", str(counts.total()))
    facts.add_row("", ", ".join(f"{name} {count}" for name, count in counts.most_common()))
    facts.add_row("as machine code", f"{len(program.robot)} lines for each robot, before its first step")
    facts.add_row("", f"{len(program.time)} lines for each step, the same for all robots")
    facts.add_row("", f"{len(program.both)} lines for each step and robot, {LANES} robots in lockstep")
    yield facts


def loop_text(loop: ClosedLoop) -> str:
    """The C text of the loop as batches run it."""
    return kernel_text(trace(loop), watched_signals(loop), LANES, False)[0]


def _control(found: dict[str, Any]) -> Iterator[tuple[str, str]]:
    """Findings about outputs, decoupling matrix and internal dynamics, as rows (name, text)."""
    yield "relative degree", ", ".join(f"{output}: {degree}" for output, degree in found["relative_degree"].items())
    yield f"det {found['determinant_of']}", found["det_decoupling_matrix"]
    if "Delta" in found["det_decoupling_matrix"]:
        where = " and stands in model.json" if found["det_denominator"] else ""
        yield "", f"Delta is the determinant of an inertia, which does not vanish{where}"
    yield "singular where", " or ".join(found["singular_where"]) or "nowhere"
    yield "internal coordinates", ", ".join(found["internal_coordinates"]) or "none"
    line = found["straight_line"]
    if line:
        values = ", ".join(line["eigenvalues"]) or ", ".join(str(v) for v in line["eigenvalues_at_defaults"])
        verdict = f"{line['forward']} forward, {line['backward']} backward; eigenvalues per speed: {values}"
        yield "along a straight line", verdict


def _where(what: str, conditions: list[str]) -> str:
    return f"{what} where {' or '.join(conditions)}" if conditions else ""


def _with_units(units: dict[str, str]) -> str:
    return ", ".join(f"{name} \\[{unit}]" for name, unit in units.items())


def _sizes(sizes: Mapping[str, int]) -> str:
    return ", ".join(f"{name} ({size})" for name, size in sizes.items())


def _name(step: ca.Function, k: int) -> str:
    return _NAMES[step.instruction_id(k)]
