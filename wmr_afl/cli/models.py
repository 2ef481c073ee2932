"""Verbs about models: what there is, what was found out, deriving, checking."""

from __future__ import annotations

from typing import Annotated

import typer
from rich.markup import escape
from rich.table import Table

from wmr_afl.cli.terminal import app, console, reporting
from wmr_afl.errors import UnknownNameError
from wmr_afl.experiments.experiment import list_experiments
from wmr_afl.model.files import list_models
from wmr_afl.model.model import load_model
from wmr_afl.model.packages import derivation


@app.command()
def models() -> None:
    """List the shipped models."""
    table = Table("model", "what it is", "type", "base parameters", "outputs", box=None, header_style="bold")
    with reporting():
        for name in list_models():
            model = load_model(name)
            count = f"{len(model.base_parameter_units)}, {model.parametrization}"
            table.add_row(
                name, escape(model.title), escape(model.findings["type"]), count, ", ".join(model.output_units)
            )
    console.print(table)
    console.print(f"experiments: {', '.join(list_experiments())}")


@app.command()
def show(
    name: Annotated[
        str,
        typer.Argument(
            help="A shipped model, or the path of a folder that derive has written; with --loop an experiment."
        ),
    ],
    loop: Annotated[
        bool, typer.Option("--loop", help="Tell what one step of an experiment's closed loop does.")
    ] = False,
    controller: Annotated[str | None, typer.Option(help="Whose loop; the first one's where none is named.")] = None,
    code: Annotated[bool, typer.Option("--code", help="Print the step's C text instead.")] = False,
) -> None:
    """Tell what was found out about a robot, or what a closed loop computes."""
    with reporting():
        if loop or code or controller is not None:
            from wmr_afl.cli.show import describe_loop, loop_text
            from wmr_afl.experiments.load import load_experiment

            loaded = load_experiment(name)
            chosen = loaded.name(controller)
            if code:
                typer.echo(loop_text(loaded.loops[chosen]))
                return
            for part in describe_loop(loaded.loops[chosen], chosen):
                console.print(part)
            return
        from wmr_afl.cli.show import describe

        for part in describe(load_model(name)):
            console.print(part)


@app.command(
    add_help_option=False,
    context_settings={"allow_extra_args": True, "ignore_unknown_options": True, "help_option_names": []},
)
def derive(context: typer.Context) -> None:
    """Derive robots from their descriptions and generate NumPy and CasADi models (needs the extra 'derive')."""
    with reporting():
        command_line = derivation("__main__").app
    command_line(context.args, prog_name=context.command_path)


@app.command()
def check(
    subject: Annotated[
        str,
        typer.Argument(
            help="A shipped model or the path of a folder that derive has written; or a shipped experiment or its file."
        ),
    ],
) -> None:
    """Check that a model obeys every law, or that an experiment's laws keep what their proofs need; exit with 1 if not.

    Of a model: mechanics, linearization, base parameters, code. Of an experiment, which is run: is the adaptation slow
    enough for its samples, which parameters does the reference determine, how certain are the estimates.
    """
    from wmr_afl.model.laws import LAWS, Situation

    with reporting():
        if subject.endswith(".toml") or subject in list_experiments():
            from wmr_afl.cli.checks import check_experiment

            if not check_experiment(subject):
                raise typer.Exit(1)
            return
        try:
            situation = Situation(subject)
        except UnknownNameError as error:
            known = [*list_models(), *list_experiments()]
            raise UnknownNameError("model or experiment", subject, known, error.hint) from None
        deviations = {law: law.deviation(situation) for law in LAWS if law.applies(situation.numpy)}
    table = Table("law", "what must hold", "deviation", "at most", "verdict", box=None, header_style="bold")
    obeyed = True
    for law, deviation in deviations.items():
        holds = deviation <= law.tolerance  # a deviation that is NaN does not hold
        table.add_row(
            law.name, escape(law.statement), f"{deviation:.1e}", f"{law.tolerance:g}", "holds" if holds else "BROKEN"
        )
        obeyed = obeyed and holds
    console.print(table)
    if not obeyed:
        raise typer.Exit(1)


@app.command("check-reference")
def check_reference(
    experiment: Annotated[str, typer.Argument(help="A shipped experiment or its file.")],
) -> None:
    """Tell whether a robot can follow the reference of an experiment, and when not; exit with 1 if it cannot.

    A law that knows the robot follows it undisturbed and without limits: what voltages does that need, where does the
    reference jump, where is something singular that is inverted, which joint comes to its stop, which wheel needs more
    friction than floors have.
    """
    from wmr_afl.analysis.feasibility import demand
    from wmr_afl.experiments.experiment import read_experiment

    with reporting():
        found = demand(*read_experiment(experiment))
    table = Table("motor", "needs up to [V]", "has [V]", box=None, header_style="bold")
    for name, volts in found.volts.items():
        limit = found.limits[name]
        table.add_row(escape(name), f"{volts:.3g}", f"{limit:g}" if limit < float("inf") else "no limit told")
    console.print(table)
    console.print(f"friction, over each wheel's load at rest: {_friction(found.friction)}")
    if found.friction:
        console.print(
            f"friction is judged from {found.since:g} s on, when a law has come to the reference from the start"
        )
    for doubt in found.doubts:
        console.print(escape(str(doubt)))
    if found.doubts:
        raise typer.Exit(1)


def _friction(needed: dict[str, float]) -> str:
    """What each wheel needs, or that it cannot be told."""
    if not any(needed.values()):
        return "cannot be told of constraints that no wheel makes, without masses, or of a reference that is too short"
    return ", ".join(f"{escape(wheel)} {friction:.2g}" for wheel, friction in needed.items())
