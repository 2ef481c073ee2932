"""A controller as a folder of C99 that stands on its own: law, reference, buffer, replay, and which wire is which."""

from __future__ import annotations

import json
import os
import re
from collections.abc import Iterable
from pathlib import Path
from typing import Any

import casadi as ca
import numpy as np

from wmr_afl.controllers.live_reference import LiveReference
from wmr_afl.controllers.reference import Reference
from wmr_afl.errors import ArgumentError, UnknownNameError, WmrError
from wmr_afl.experiments.load import load_experiment
from wmr_afl.numerics.arguments import checked, to_write
from wmr_afl.numerics.arrays import Floats
from wmr_afl.onboard.c_source import OWN, TEMPLATES, Source, decimal, in_a_comment
from wmr_afl.onboard.controller import Controller
from wmr_afl.onboard.cosimulation import check_version, fmus, plant_name
from wmr_afl.onboard.sampled_law import SampledLaw
from wmr_afl.simulation.closed_loop import ClosedLoop
from wmr_afl.simulation.kernels.c_printer import FUNCTIONS, Argument, Depends, Target, print_step
from wmr_afl.simulation.simulate import simulate
from wmr_input.errors import shown
from wmr_input.whole_files import write_folder

LAYOUTS = ("cmake", "platformio")
SAMPLES, MOST_SAMPLES = 1000, 1_000_000  # of the run that are replayed
DOUBLE, SINGLE = 1e-12, 2e-5  # tolerance of the replay, of the largest size of each number
AMPLIFIED = 30.0  # in single precision the replay may differ by that many times what rounding its inputs alone changes
KEYWORDS = frozenset(  # of C
    """auto break case char const continue default do double else enum extern float for goto if inline int long main
    register restrict return short signed sizeof static struct switch typedef union unsigned void volatile while
    """.split()  # noqa: SIM905, a table of words reads better than a list of strings
)


@checked
def export(
    experiment: str | Path,
    controller: str | None = None,
    out: str | Path | None = None,
    is_single: bool = False,
    prefix: str = "controller",
    is_tunable: bool = False,
    is_unlimited: bool = False,
    has_reference: bool = True,
    layout: str = "cmake",
    samples: int = SAMPLES,
    gate: float | None = None,
    fmu: int | None = None,
) -> dict[str, str | bytes]:
    """The C99 of an experiment's controller, the first unless named, by file name; written to a new folder `out`.

    `is_single`: in single precision; `prefix`: of all names; `is_tunable`: gains and bounds are an argument of each
    step; `is_unlimited`: also if nothing limits the voltages; `has_reference`: with the experiment's own reference
    besides the buffer; `gate` [output units]: outputs may jump by less; `fmu`: with FMUs of controller and robot, of
    this version of FMI.

    Raises:
        InputError: if the experiment has a mistake.
        UnknownNameError: if there is no such experiment or controller.
        WmrError: if voltages have no limits, the folder exists, the prefix is no name in C, or the reference cannot be
            carried.
    """
    if not re.fullmatch(r"[A-Za-z][A-Za-z0-9_]*", prefix) or prefix in KEYWORDS:
        raise ArgumentError(f"the prefix {shown(prefix)} is no name in C", "choose letters and digits, as in my_robot")
    if layout not in LAYOUTS:
        raise UnknownNameError("layout", layout, LAYOUTS)
    if not 1 <= samples <= MOST_SAMPLES:
        raise ArgumentError(f"{samples} samples to replay", f"choose 1 to {MOST_SAMPLES}")
    check_version(fmu)
    folder = None if out is None else to_write("out", out)
    if folder is not None and os.path.lexists(folder):
        raise WmrError(f"{folder} exists", "choose the name of a new folder")
    loaded = load_experiment(experiment)
    name = loaded.name(controller)
    loop = loaded.loops[name]
    sampled = onboard(loop, gate)
    if not (sampled.is_limited or is_unlimited):
        raise WmrError(
            f"nothing limits the voltages of {name!r}",
            "add command_limits or input_limits to [uncertainties], or export it with --unlimited",
        )
    origin = in_a_comment(f'controller "{name}" of experiment {Path(experiment).stem}, written by wmr-afl')
    source = Source(sampled, prefix, is_single, is_tunable, origin=origin)
    replayed = vectors(loop, sampled, samples, is_single)
    texts = _files(source, loop.reference if has_reference else None, replayed, layout, fmu)
    files: dict[str, str | bytes] = {**texts}
    if fmu is not None:
        files |= fmus(source, loop, fmu, loaded.experiment.simulation.duration, texts)
    try:
        if folder is not None:
            write_folder(folder, files)
    except OSError as error:
        raise WmrError(f"{folder} cannot be written ({error.strerror})", "choose another folder") from None
    return files


def onboard(loop: ClosedLoop, gate: float | None = None) -> SampledLaw:
    """The law of a loop as it runs on the robot: with the drive that it knows, and given each setpoint."""
    reference = LiveReference(list(loop.model.output_units), loop.reference.counts_turns)
    return SampledLaw(loop.model, loop.law, reference, loop.sample_time, loop.plant.drive, gate=gate)


def vectors(loop: ClosedLoop, sampled: SampledLaw, samples: int, is_single: bool = False) -> tuple[Floats, float]:
    """What Python's controller does along its own run: rows of dt, x, yr, yr', yr'', u and the states after it.

    And the tolerance of a replay. In single precision inputs are rounded before Python sees them; laws that compare a
    sample with the last one amplify rounding, and how much is measured: by what rounding the inputs alone changes.
    """
    run = simulate(loop, samples * loop.sample_time)
    times = run.time[:samples]
    inputs = np.hstack([run.state[:samples], *loop.reference.over(times)])
    exact = _driven(loop, sampled, times, inputs)
    if not is_single:
        return exact, DOUBLE
    rounded = _driven(loop, sampled, times, inputs.astype(np.float32).astype(float))
    results = 1 + len(sampled.measured) + 3 * len(loop.model.output_units)
    off, size = (np.abs(rows[:, results:]).max(axis=0) for rows in (rounded - exact, exact))
    return rounded, max(SINGLE, AMPLIFIED * float(np.max(off / np.where(size > 0.0, size, 1.0))))


def _driven(loop: ClosedLoop, sampled: SampledLaw, times: Floats, inputs: Floats) -> Floats:
    """The rows of `vectors` for states and setpoints, one after the other in each row of `inputs`."""
    gate = None if sampled.gate is None else float(sampled.gate.bound[0])
    drive = list(sampled.drive)
    controller = Controller(loop.model, loop.law, sampled.reference, loop.sample_time, drive, gate=gate)
    states, outputs = len(loop.model.state_units), len(loop.model.output_units)
    rows = []
    for t, given in zip(times, inputs, strict=True):
        yr, yr1, yr2 = given[states:].reshape(3, outputs)
        u = controller.update(float(t), given[:states], (yr, yr1, yr2))
        told = [controller.last_step], controller.as_measured, given[states:], u, controller.states
        rows.append(np.concatenate(told))
    return np.array(rows)


def _files(
    source: Source, reference: Reference | None, replayed: tuple[Floats, float], layout: str, fmu: int | None
) -> dict[str, str]:
    """The files by name."""
    rows, tolerance = replayed
    P, context = source.prefix, source.context
    literal = source.target.literal
    calls = set(source.program.calls)
    sources = [f"{P}.c", f"{P}_buffer.c"]
    if reference is not None:
        context = context | {"reference": _reference(reference, source)}
        sources.append(f"{P}_reference.c")
        calls |= context["reference"]["calls"]
    context = context | {
        "sources": sources, "tolerance": f"{tolerance:.2g}", "half": literal(0.5),
        "micro": literal(1e-6), "real_of": lambda value: literal(float(value)), "limits": _limits(source.sampled),
        "seconds": source.sampled.sample_time, "longest": source.sampled.max_gap,
        "fmu": fmu, "plant": plant_name(P),
        "estimates": _entries(source.sampled.states.places["theta_hat"]),
        "functions": sorted(f"`{one}`" for one in _of_the_library(calls)),
    }  # fmt: skip

    def text(template: str) -> str:
        return TEMPLATES.get_template(template).render(context)

    files = {
        f"{P}.h": source.header(),
        f"{P}.c": source.code(),
        f"{P}_buffer.h": text("buffer.h.jinja"),
        f"{P}_buffer.c": text("buffer.c.jinja"),
        "main.c": text("main.c.jinja"),
        "vectors.txt": "\n".join([str(len(rows)), *(" ".join(map(repr, row)) for row in rows.tolist()), ""]),
        "README.md": text("README.md.jinja"),
        "CMakeLists.txt": text("CMakeLists.txt.jinja"),
    }
    if reference is not None:
        files |= {f"{P}_reference.{kind}": text(f"reference.{kind}.jinja") for kind in ("h", "c")}
    if layout == "platformio":
        files["library.json"] = json.dumps(_library(context), indent=2) + "\n"
    return files


def _library(context: dict[str, Any]) -> dict[str, Any]:
    """What PlatformIO and Arduino want to know of a library."""
    return {
        "name": context["P"],
        "version": "1.0.0",
        "description": f"{context['title']}: {context['origin']}",
        "license": "MIT",
        "frameworks": "*",
        "platforms": "*",
        "headers": f"{context['P']}.h",
        "build": {
            "flags": ["-ffp-contract=off", "-fno-math-errno"],
            "srcFilter": ["+<*.c>", "-<main.c>"],
            "srcDir": ".",
        },
    }


def _reference(reference: Reference, source: Source) -> dict[str, Any]:
    """The experiment's own reference as C in double precision.

    Raises:
        WmrError: if it is a table.
    """
    t = ca.SX.sym("t")
    try:
        now = reference.at(t)
    except ArgumentError:
        raise WmrError(
            f"the reference is a table ({type(reference).__name__}), which is not carried into C",
            "export with --no-reference and push its points into the buffer",
        ) from None
    parts = [ca.densify(ca.SX(part)) for part in (now.position, now.velocity, now.acceleration)]
    step = ca.Function("reference", [t], ca.cse(parts))
    target = Target("double", lambda value: decimal(value, False), "", f"{source.prefix}_reference_", OWN)
    program = print_step(step, [Argument("t", Depends.BOTH)], True, target)
    fields = [(name, values) for (name, _, _), values in zip(source.setpoint, program.results, strict=True)]
    lines = [*program.robot, *program.time, *program.both]
    return {"lines": lines, "fields": fields, "calls": program.calls, "reads_time": bool(program.reads)}


def _of_the_library(calls: Iterable[str]) -> set[str]:
    """Functions of the C library that these functions are or use."""
    known = {name for function in FUNCTIONS.values() for name in (function, f"{function}f")}
    found = {call for call in calls if call in known}
    for own, used in (("sincos_of", {"fabs", "floor"}), ("exp_of", {"floor", "ldexp"})):
        if any(call.endswith(own) for call in calls):
            found |= used
    return found


def _entries(place: slice) -> list[int]:
    return list(range(place.start, place.stop))


def _limits(sampled: SampledLaw) -> str:
    """What limits the voltages, in words."""
    limits = ("command_limits.", "input_limits.", "effort.limit")
    told = [
        f"{name} = {np.ravel(value).tolist()} V" for name, value in sampled.values.items() if name.startswith(limits)
    ]
    return ", ".join(told) or "none. Whatever is computed goes to the motors"
