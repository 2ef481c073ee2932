"""What all verbs of the command line share: the application, options, errors as lines, output, progress."""

from __future__ import annotations

import signal
import threading
import warnings
from collections.abc import Iterator
from contextlib import contextmanager
from importlib.metadata import version
from pathlib import Path
from typing import Annotated

import typer
from rich.console import Console
from rich.markup import escape
from rich.progress import BarColumn, Progress, TextColumn, TimeRemainingColumn

from wmr_afl.errors import ArgumentError, BackendWarning, WmrError

app = typer.Typer(
    name="wmr-afl",
    no_args_is_help=True,
    add_completion=False,
    pretty_exceptions_enable=False,
    rich_markup_mode=None,  # it would swallow units in brackets
)
console = Console(highlight=False)
errors = Console(stderr=True, highlight=False)

Experiment = Annotated[str, typer.Argument(help="A shipped experiment, or a TOML file.")]
Out = Annotated[Path, typer.Option(help="Folder for the results.")]
Backend = Annotated[
    str,
    typer.Option(
        help="numpy: step by step; casadi: traced; compiled: traced and built by a C compiler; auto: the faster one."
    ),
]


@contextmanager
def reporting() -> Iterator[None]:
    """Print errors, one line each, and exit with status 2; print warnings, one line each, and go on.

    Ctrl-C stays Ctrl-C, whatever a library in which it came made of it.
    """
    with _interrupts() as interrupts, warnings.catch_warnings():
        warnings.simplefilter("ignore")  # failures of runs are printed in tables
        warnings.simplefilter("always", BackendWarning)
        warnings.showwarning = lambda message, *_: typer.echo(f"warning: {message}", err=True)
        try:
            yield
        except WmrError as error:
            for line in str(error).splitlines():
                typer.echo(f"error: {line}", err=True)
            raise typer.Exit(2) from None
        except Exception:
            if interrupts:
                raise KeyboardInterrupt from None
            raise


@contextmanager
def _interrupts() -> Iterator[list[int]]:
    """The signals of Ctrl-C that came so far; each is raised as ever."""
    came: list[int] = []

    def note(number: int, frame: object) -> None:
        came.append(number)
        raise KeyboardInterrupt

    before = signal.getsignal(signal.SIGINT)
    if threading.current_thread() is not threading.main_thread() or before in (None, signal.SIG_IGN):
        yield came
        return
    signal.signal(signal.SIGINT, note)
    try:
        yield came
    finally:
        signal.signal(signal.SIGINT, before)


def say(text: str) -> None:
    """Print a line without markup and colours."""
    console.print(escape(text))


def numbers_by_name(option: str, given: list[str] | None) -> dict[str, float]:
    """Numbers by name.

    Raises:
        ArgumentError: if one is not NAME=VALUE.
    """
    found = {}
    for text in given or ():
        name, _, value = (part.strip() for part in text.partition("="))
        try:
            found[name] = float(value)
        except ValueError:
            if name and value:
                raise ArgumentError(f"{option} {name} is {value!r}", "give a number, with a point as in 0.5") from None
            raise ArgumentError(f"{option} is {text!r}", f"write {option} NAME=VALUE, VALUE a number") from None
    return found


def progress_bar() -> Progress:
    """A progress bar with the remaining time, on stderr; nothing is shown if that is not a terminal."""
    columns = (
        TextColumn("{task.description}"),
        BarColumn(),
        TextColumn("{task.percentage:>3.0f} %"),
        TimeRemainingColumn(),
    )
    return Progress(*columns, console=errors, transient=True, disable=not errors.is_terminal)


def _version(wanted: bool) -> None:
    if wanted:
        typer.echo(f"wmr-afl {version('wmr-afl')}")
        raise typer.Exit


@app.callback()
def main(
    version: Annotated[
        bool, typer.Option("--version", callback=_version, is_eager=True, help="Tell the version.")
    ] = False,
) -> None:
    """Adaptive feedback linearizing control of wheeled mobile robots: look at models, derive new ones, simulate."""
