"""The texts of the verb `show`: the findings of a model, and what one step of a closed loop computes."""

from __future__ import annotations

import re
from collections import Counter
from collections.abc import Iterator, Mapping
from typing import Any

import casadi as ca
from rich.console import RenderableType
from rich.markup import escape
from rich.table import Table

from wmr_afl.cli.terminal import console
from wmr_afl.model.model import Model
from wmr_afl.numerics.formulas import FUNCTIONS
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
_LINES = 3  # of one finding, at most
_BESIDE = 25  # columns that the names of findings take
_NO_WORK = (ca.OP_INPUT, ca.OP_OUTPUT, ca.OP_CONST)  # instructions that compute nothing
_NAMES = {value: name[3:].lower() for name, value in vars(ca).items() if name.startswith("OP_")}  # of operations


def describe(model: Model) -> Iterator[RenderableType]:
    """The findings of a model, part by part; of each finding at most three lines."""
    found = model.findings
    missed: dict[str, str] = found.get("not_found_out", {})
    source = model.metadata["source"]
    yield f"[bold]{escape(model.title)}[/bold]  ({model.name}{'; geometry: ' if source else ''}{escape(source)})"
    facts = _facts()

    def add(name: str, text: str, *findings: str) -> None:
        """A row, or why there is nothing to be told: the reason of the first of `findings` that was missed."""
        reason = next((missed[finding] for finding in findings if finding in missed), None)
        facts.add_row(name, text if reason is None else f"not found out: {escape(_short(reason))}")

    add(
        "type",
        f"{escape(found['type'])}: mobility {found['degree_of_mobility']}, "
        f"steerability {found['degree_of_steerability']}",
    )
    add("state", _with_units(model.state_units))
    add("inputs", _with_units(model.input_units) or "none")
    add("outputs", _with_units(model.output_units) or "none")
    for name, text in _limits(model):
        add(name, text)
    for number, (v, form) in enumerate(found["pseudo_velocities"].items()):
        add("" if number else "pseudo-velocities", escape(_short(f"{v} = {form}")))
    add("", escape(_short(_where("not defined", found["kinematic_singularities"]))) or "smooth everywhere")
    rows = [
        row + (" (can be integrated)" if row in found["holonomic_rows"] else "") for row in found["constraint_rows"]
    ]
    add("constraints", f"{len(rows)}, {found['constraints']}" if rows else "none", "growth_vector")
    for text in (_listed(rows), _listed(found["dropped_rows"], "follows from these: ")):
        if text:
            add("", escape(text))
    degenerate = found["degenerate_configurations"]
    where = "not examined" if degenerate is None else _where("more motion", degenerate) or "nowhere"
    add("degenerate", escape(_short(where)), "degenerate_configurations")
    growth = ", ".join(str(dimension) for dimension in found["growth_vector"])
    add("degree of nonholonomy", f"{found['degree_of_nonholonomy']} (growth of brackets {growth})", "growth_vector")
    add("controllable", "yes, in small time" if found["controllable"] else "no", "growth_vector")
    add("parametrization", FORMS[model.parametrization])
    if found["parametrization_obstacle"]:
        add("no forward form", escape(_obstacle(model)), "parametrization_obstacle")
    add("adaptation", escape(_adaptation(model)))
    add("known constants", _with_units(model.known_units) or "none")
    if model.has("decoupling_matrix"):
        for name, text, finding in _control(found):
            add(name, escape(text), finding)
    else:
        add("controller", "none: the description wants the model alone")
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
        base.add_row(name, escape(_short(model.base_parameter_formulas[name])), unit, f"{value:.6g}")
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
    facts = _facts()
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


def _facts() -> Table:
    """An empty table of names and what is told of them."""
    facts = Table(box=None, show_header=False, padding=(0, 2, 0, 0))
    facts.add_column(style="dim")
    return facts


def _adaptation(model: Model) -> str:
    """What can be adapted, and how."""
    if not model.has("passivity_regressor"):
        return _short(f"none of the composite law: {model.metadata['passivity_obstacle']}")
    if not model.output_units:
        return f"none without outputs; R u = Y pi is linear in {len(model.units_of('passivity_parameters'))} parameters"
    groups = model.metadata["passivity_groups"]
    sizes = " + ".join(str(len(group["parameters"])) for group in groups)
    linear = ", the paper's in theta" if model.has("regressor") else ""
    return f"composite and direct laws in {sizes} parameters pi, apart by motor factors{linear}"


def _control(found: dict[str, Any]) -> Iterator[tuple[str, str, str]]:
    """Findings about outputs, decoupling matrix and internal dynamics, as rows (name, text, finding)."""
    degrees = ", ".join(f"{output}: {degree}" for output, degree in found["relative_degree"].items())
    yield "relative degree", degrees, "relative_degree"
    determinant = found["det_decoupling_matrix"]
    yield f"det {found['determinant_of']}", _short(determinant), "det_decoupling_matrix"
    if "Delta" in determinant:
        where = " and stands in model.json" if found["det_denominator"] else ""
        yield "", f"Delta is the determinant of an inertia, which does not vanish{where}", ""
    yield "singular where", _short(" or ".join(found["singular_where"]) or "nowhere"), "singular_where"
    yield "internal coordinates", ", ".join(found["internal_coordinates"]) or "none", "internal_coordinates"
    line = found["straight_line"]
    if line or "straight_line" in found.get("not_found_out", {}):
        yield "along a straight line", _straight(line) if line else "", "straight_line"


def _straight(line: dict[str, Any]) -> str:
    values = ", ".join(line["eigenvalues"])
    if not values or len(values) > _line():
        values = ", ".join(str(v) for v in line["eigenvalues_at_defaults"])
    return f"{line['forward']} forward, {line['backward']} backward; eigenvalues per speed: {_short(values)}"


def _obstacle(model: Model) -> str:
    """Why there is no forward form. A denominator in names of terms that only the derivation knows is not shown."""
    obstacle = model.findings["parametrization_obstacle"]
    declared = {*model.state_units, *model.parameter_units, *FUNCTIONS}
    names = set(re.findall(r"[A-Za-z]\w*", obstacle["denominator"]))
    shown = f" {obstacle['denominator']}" if names <= declared and len(obstacle["denominator"]) <= _line() else ""
    proof = "which proves it" if obstacle["is_proof"] else "which proves nothing"
    count, rank = obstacle["states_and_parameter_sets"], obstacle["rank_of_values"]
    values = f"values at {count} states and parameter sets have rank {rank}, {proof}"
    return f"a denominator{shown} mixes state and parameters; {values}"


def _limits(model: Model) -> Iterator[tuple[str, str]]:
    """The limits of joints."""
    limited = {name: part for name, part in model.metadata["geometry"]["frames"].items() if "limits" in part}
    if limited:
        texts = (f"{name}: {' to '.join(part['limits'])} rad" for name, part in limited.items())
        yield "limits of joints", escape(_short(", ".join(texts)))


def _listed(rows: list[str], prefix: str = "") -> str:
    """At most three lines."""
    texts = [_short(prefix + row, 1) for row in rows]
    if len(texts) > _LINES:
        texts = [*texts[: _LINES - 1], f"and {len(texts) - _LINES + 1} more, see model.json"]
    return "\n".join(texts)


def _line() -> int:
    """Characters of a line beside the name of a finding."""
    return max(console.width - _BESIDE, 40)


def _short(text: str, lines: int = _LINES) -> str:
    """A text that fits into a few lines, a long one cut off."""
    longest = lines * _line() - (lines - 1) * 10  # lines end where words do
    return text if len(text) <= longest else f"{text[: longest - 25]}... (see model.json)"


def _where(what: str, conditions: list[str]) -> str:
    return f"{what} where {' or '.join(conditions)}" if conditions else ""


def _with_units(units: dict[str, str]) -> str:
    return ", ".join(f"{name} \\[{unit}]" for name, unit in units.items())


def _sizes(sizes: Mapping[str, int]) -> str:
    return ", ".join(f"{name} ({size})" for name, size in sizes.items())


def _name(step: ca.Function, k: int) -> str:
    return _NAMES[step.instruction_id(k)]
