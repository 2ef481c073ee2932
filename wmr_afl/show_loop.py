"""What one step of a closed loop computes, for a person at a terminal."""

from __future__ import annotations

from collections import Counter
from collections.abc import Iterator, Mapping

import casadi as ca
from rich.console import RenderableType
from rich.markup import escape
from rich.table import Table

from wmr_afl.closed_loop import ClosedLoop, Layout
from wmr_afl.compiled.kernel import kernel_text, print_loop
from wmr_afl.lockstep import LANES, watched_signals
from wmr_afl.tracing import trace

_NO_WORK = (ca.OP_INPUT, ca.OP_OUTPUT, ca.OP_CONST)


def describe_loop(loop: ClosedLoop, controller: str) -> Iterator[RenderableType]:
    """What goes in and out, and how many operations a step takes."""
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


def _sizes(sizes: Mapping[str, int]) -> str:
    return ", ".join(f"{name} ({size})" for name, size in sizes.items())


_NAMES = {value: name[3:].lower() for name, value in vars(ca).items() if name.startswith("OP_")}


def _name(step: ca.Function, k: int) -> str:
    return _NAMES[step.instruction_id(k)]
