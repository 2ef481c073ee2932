"""What was found out about a robot, for a person at a terminal."""

from __future__ import annotations

from collections.abc import Iterator

from rich.console import RenderableType
from rich.markup import escape
from rich.table import Table

from wmr_afl.model import Model


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
    facts.add_row("pseudo-velocities", "; ".join(f"{v} = {form}" for v, form in found["pseudo_velocities"].items()))
    facts.add_row("constraints", f"{len(found['constraint_rows'])}, {found['constraints']}")
    for row in found["constraint_rows"]:
        facts.add_row("", escape(row))
    for row in found["dropped_rows"]:
        facts.add_row("", escape(f"follows from these: {row}"))
    facts.add_row("degree of nonholonomy", f"{found['degree_of_nonholonomy']} (growth of brackets {growth})")
    facts.add_row("controllable", "yes, in small time" if found["controllable"] else "no")
    facts.add_row(
        "relative degree", ", ".join(f"{output}: {degree}" for output, degree in found["relative_degree"].items())
    )
    facts.add_row("det D", found["det_decoupling_matrix"])
    facts.add_row("singular where", " or ".join(found["singular_where"]) or "nowhere")
    facts.add_row("known constants", _with_units(model.known_units) or "none")
    facts.add_row("internal coordinates", ", ".join(found["internal_coordinates"]) or "none")
    line = found["straight_line"]
    if line:
        values = ", ".join(line["eigenvalues"]) or ", ".join(str(v) for v in line["eigenvalues_at_defaults"])
        facts.add_row(
            "along a straight line",
            f"{line['forward']} forward, {line['backward']} backward; eigenvalues per speed: {values}",
        )
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


def _with_units(units: dict[str, str]) -> str:
    return ", ".join(f"{name} \\[{unit}]" for name, unit in units.items())
