"""`python -m derive ROBOT.toml ... --out DIR [--check]`: descriptions -> generated models."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

import typer
from rich.console import Console
from rich.status import Status

from wmr_input import WmrError

app = typer.Typer(add_completion=False, pretty_exceptions_enable=False)
_console = Console(stderr=True, highlight=False)


@app.command()
def derive(
    robots: Annotated[list[Path], typer.Argument(help="Robot descriptions, TOML files.", metavar="ROBOT.toml ...")],
    out: Annotated[Path, typer.Option(help="Folder for the generated models, one subfolder a robot.")],
    check: Annotated[
        bool, typer.Option("--check", help="Write nothing; fail with a diff where DIR is not what the robots give.")
    ] = False,
) -> None:
    """Derive robots from their descriptions and generate NumPy and CasADi models (needs the extra 'derive').

    Nothing is written unless every description is right.
    """
    try:
        from .codegen.write import differences, generate, write  # SymPy is slow to import; --help does not need it
    except ModuleNotFoundError as error:
        typer.echo(f'error: {error.name} is not installed; pip install "wmr-afl[derive]"', err=True)
        raise typer.Exit(2) from None
    try:
        with _console.status("deriving") as status:
            files = generate(robots, lambda path: _Steps(path, status))
        if check:
            difference = differences(files, out)
            if difference:
                print(difference, end="")
                _console.print(f"{out} is not up to date; run the same without --check", style="red")
                raise typer.Exit(1)
            _console.print(f"{out} is up to date: {len(files)} files")
            return
        write(files, out)
        _console.print(f"wrote {len(files)} files below {out}")
    except WmrError as error:
        for line in str(error).splitlines():
            typer.echo(f"error: {line}", err=True)
        raise typer.Exit(2) from None


class _Steps:
    """Tells which step of which robot is under way."""

    def __init__(self, path: Path, status: Status) -> None:
        self.path, self.status = path, status

    def __call__(self, step: str) -> None:
        self.status.update(f"{self.path.name}: {step}")
        if not _console.is_terminal and step == "description":
            _console.print(f"deriving {self.path.name}")


if __name__ == "__main__":
    app(prog_name="python -m derive")
