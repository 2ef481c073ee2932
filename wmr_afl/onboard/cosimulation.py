"""Controller and robot of an experiment as FMUs for co-simulation, each with what others may set and see of it."""

from __future__ import annotations

import functools
import warnings
from collections.abc import Mapping
from dataclasses import replace
from typing import Any

from wmr_afl.errors import BackendWarning, CompilerError, UnknownNameError
from wmr_afl.onboard.c_source import TOLD, Source, decimal
from wmr_afl.onboard.fmu import Fmu, Variable, binary, packed
from wmr_afl.onboard.sampled_plant import SampledPlant, joined, numbered
from wmr_afl.onboard.status import Status
from wmr_afl.simulation.closed_loop import ClosedLoop
from wmr_afl.simulation.kernels.c_printer import Argument, Depends, Program, Target, print_step

VERSIONS = (2, 3)  # of FMI
PRECISE = Target("double", functools.partial(decimal, is_single=False), "", "robot_")
RATES = {"position": ("", ""), "velocity": ("_rate", "/s"), "acceleration": ("_acceleration", "/s^2")}  # of a setpoint
NAMELESS = {"": ""}  # the entry of a single number without a unit


def check_version(version: int | None) -> None:
    """Fails if there is no such version of FMI; None is no FMU.

    Raises:
        UnknownNameError: if there is none.
    """
    if version is not None and version not in VERSIONS:
        raise UnknownNameError("version of FMI", str(version), map(str, VERSIONS))


def plant_name(prefix: str) -> str:
    """What the robot is called beside a controller with this prefix."""
    return "plant" if prefix == "controller" else f"{prefix}_plant"


def fmus(source: Source, loop: ClosedLoop, version: int, duration: float, files: Mapping[str, str]) -> dict[str, bytes]:
    """The FMUs of a controller and of its robot, by the names of their files; `files` are those of the export.

    Without a compiler they hold sources only, which a warning tells.
    """
    both = [controller_fmu(source, duration, files), plant_fmu(source, loop, duration)]
    texts = [one.files(version) for one in both]
    binaries: list[dict[str, bytes]] = [{}, {}]
    try:
        binaries = [binary(one.name, text, version) for one, text in zip(both, texts, strict=True)]
    except CompilerError as error:
        remedy = "install a C compiler, or build them where they are used"
        warnings.warn(f"{error.problem}, so the FMUs hold sources only; {remedy}", BackendWarning, stacklevel=3)
    return {
        f"{one.name}.fmu": packed({**text, **built}) for one, text, built in zip(both, texts, binaries, strict=True)
    }


def controller_fmu(source: Source, duration: float, files: Mapping[str, str]) -> Fmu:
    """What is measured and a setpoint in; voltages, status and what else a step tells out."""
    sampled, P, context = source.sampled, source.prefix, source.context
    reference = {name: text for name, text in files.items() if name.startswith(f"{P}_reference.")}
    gains = _gains(source)
    groups = {
        "measured": _variables("measured", _measured_units(source), "as measured", "input"),
        **_setpoint(source),
        "gains": gains,
        "voltage": _variables("voltage", sampled.model.input_units, "of a motor; zero unless status is 0", "output"),
        "estimate": _estimates(source),
        **_told(source),
    }
    place = sampled.states.places["theta_hat"]
    places = [(gain["name"], i) for gain in context["gains"] for i in range(len(gain["entries"]))]
    return Fmu(
        name=P,
        title=f"{sampled.model.title}: controller",
        about=source.origin,
        template="fmu_controller.c.jinja",
        groups={name: group for name, group in groups.items() if group},
        wholes=_wholes(),
        truths=[_OWN_REFERENCE] if reference else [],
        sample_time=sampled.sample_time,
        duration=duration,
        context={
            **context,
            "gain_places": [(name, i, place) for place, (name, i) in enumerate(places)],
            "estimates": list(range(place.start, place.stop)),
            "has_reference": bool(reference),
        },
        sources={f"{P}.h": source.header(), f"{P}.c": source.code(), **reference},
    )


def plant_fmu(source: Source, loop: ClosedLoop, duration: float) -> Fmu:
    """Voltages in; the state and what is measured of it out. Parameters and uncertainties may be set."""
    plant, states = SampledPlant(loop), loop.model.state_units
    start = _variables("start", states, "where the robot begins", "parameter", "fixed")
    groups = {
        "voltage": _variables("voltage", loop.model.input_units, "of a motor, held over a step", "input"),
        "noise": _noise(plant),
        "numbers": [
            Variable(one.name, one.about, "parameter", "tunable", one.unit, one.value) for one in plant.numbers()
        ],
        "start": [replace(one, value=float(value)) for one, value in zip(start, loop.plant.start, strict=True)],
        "state": _variables("state", states, "of the robot", "output", "continuous"),
        "measured": _variables("measured", plant.measured_units, "as measured", "output"),
    }
    step = _printed(plant.traced(), "z[{i}]", "u[{i}]", "t", "h", "k[{i}]")
    measurement = _printed(plant.traced_measurement(), "x[{i}]", "n[{i}]", "t", "k[{i}]")
    literal = PRECISE.literal
    return Fmu(
        name=plant_name(source.prefix),
        title=loop.model.title,
        about=f"the robot of {source.origin}",
        template="fmu_plant.c.jinja",
        groups={name: group for name, group in groups.items() if group},
        wholes=[],
        truths=[],
        sample_time=plant.sample_time,
        duration=duration,
        context={
            "step": step, "measurement": measurement, "calls": step.calls | measurement.calls,
            "zero": literal(0.0), "one": literal(1.0), "start": [literal(float(one)) for one in plant.start],
            "states": len(states), "has_noise": bool(groups["noise"]),
        },
        sources={},
        is_any_step=not plant.counts_samples,
    )  # fmt: skip


def _measured_units(source: Source) -> dict[str, str]:
    return {name: source.sampled.model.state_units.get(name, "rad/s") for name in source.sampled.measured}


def _setpoint(source: Source) -> dict[str, list[Variable]]:
    """The reference as it is given, field by field."""
    groups, outputs = {}, source.sampled.model.output_units
    for field, _, about in source.setpoint:
        ending, per = RATES[field]
        named = {name: f"{unit}{per}" for name, unit in outputs.items()}
        groups[field] = _variables(f"reference{ending}", named, f"{about.partition(' ')[0]}: where to be", "input")
    return groups


def _gains(source: Source) -> list[Variable]:
    """Gains and bounds, if they are an argument of a step."""
    sampled = source.sampled
    about = "gain, bound, or constant that is known of the robot"
    return [
        Variable(joined(f"gains.{name}", entry), about, "parameter", "tunable", unit, number)
        for name, value in (sampled.values.items() if source.is_tunable else ())
        for entry, unit, number in numbered(value, sampled.model.known_units if name == "c" else None)
    ]


def _estimates(source: Source) -> list[Variable]:
    """The estimated parameters, after the sample."""
    knowledge = source.sampled.law.knowledge
    formulas = knowledge.model.formulas_of(knowledge.estimated)
    return [
        Variable(f"estimate.{name}", f"estimate of {formulas[name]}", "output", unit=unit)
        for name, unit in knowledge.units.items()
    ]


def _told(source: Source) -> dict[str, list[Variable]]:
    """What a step tells besides."""
    model = source.sampled.model
    rates = {name: f"{unit}/s" for name, unit in model.output_units.items()}
    entries: dict[str, dict[str, str]] = {
        "error": model.output_units,
        "filtered_error": rates,
        "command": model.input_units,
        "observed": model.state_units,
    }
    return {
        one["name"]: _variables(one["name"], entries.get(one["name"], NAMELESS), TOLD[one["name"]], "output")
        for one in source.context["told"]
    }


def _wholes() -> list[Variable]:
    """Status and masks."""
    why = "; ".join(f"{one.value}: {one.meaning}" for one in Status if one not in _OF_SAVED_STATES)
    return [
        Variable("status", why, "output", kind="Integer"),
        Variable("saturated", "bit i: voltage i is not what the law asked for", "output", kind="Integer"),
        Variable("at_bound", "bit i: estimate i lies on its bound", "output", kind="Integer"),
    ]


def _noise(plant: SampledPlant) -> list[Variable]:
    """Standard normal numbers, if what is measured is noisy: a master draws them; zeros are no noise."""
    count, states = plant.plant.samples, list(plant.model.state_units)
    names = states if count == len(states) else [f"[{i + 1}]" for i in range(count)]
    about = "standard normal number for what is measured after the next step"
    return _variables("noise", dict.fromkeys(names, ""), about, "input")


def _variables(
    group: str, named: Mapping[str, str], about: str, causality: str, variability: str = "discrete"
) -> list[Variable]:
    """A variable for each name, with its unit."""
    return [Variable(joined(group, name), about, causality, variability, unit) for name, unit in named.items()]


def _printed(step: Any, *arguments: str) -> Program:
    """A function as lines of C in double precision."""
    return print_step(step, [Argument(one, Depends.BOTH) for one in arguments], True, PRECISE)


_OF_SAVED_STATES = (Status.OTHER_LAYOUT, Status.DAMAGED)
_OWN_REFERENCE = Variable(
    "own_reference",
    "whether the experiment's own reference is followed; if so, inputs of a reference are ignored",
    "parameter",
    "tunable",
    value=1.0,
    kind="Boolean",
)
