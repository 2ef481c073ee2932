"""A sampled law as C99: one text for Python's own loop and for a microcontroller, in double or single precision."""

from __future__ import annotations

import functools
import hashlib
import re
from collections.abc import Mapping
from dataclasses import dataclass
from math import inf
from pathlib import Path
from typing import Any

import casadi as ca
import numpy as np
from jinja2 import Environment, FileSystemLoader, StrictUndefined

from wmr_afl.onboard.sampled_law import SampledLaw
from wmr_afl.onboard.status import Status
from wmr_afl.simulation.kernels.c_printer import Argument, Depends, Program, Target, print_step
from wmr_afl.simulation.layout import Layout

SMALLEST_FLOAT, LARGEST_FLOAT = 1.17549435e-38, 3.40282347e38
LARGEST_DOUBLE = 1.7976931348623157e308
OWN = {ca.OP_EXP: "exp_of"}  # whose last bit differs from one C library to another
TEMPLATES = Environment(  # C and text, not HTML
    loader=FileSystemLoader(Path(__file__).parent / "templates"),
    undefined=StrictUndefined,
    trim_blocks=True,
    lstrip_blocks=True,
    keep_trailing_newline=True,
    autoescape=False,  # noqa: S701
)


@dataclass(frozen=True)
class Entry:
    """An entry of an array in C: its name, and what it is."""

    name: str
    about: str = ""


def decimal(value: float, is_single: bool) -> str:
    """The shortest decimal C literal that is read back to the same bits, of its type.

    In single precision what is not zero stays above zero, and what is finite stays finite.
    """
    real, f = ("float", "f") if is_single else ("double", "")
    if value != value:
        return f"(({real})NAN)"
    size = abs(value)
    if is_single and size < inf:
        size = min(max(size, SMALLEST_FLOAT), LARGEST_FLOAT) if size else size
        text = repr(size) if size in (SMALLEST_FLOAT, LARGEST_FLOAT) else str(np.float32(size))
    else:
        text = repr(size)
    text = f"(({real})INFINITY)" if size == inf else (text if "." in text or "e" in text else f"{text}.0") + f
    return f"(-{text})" if np.signbit(value) else text


@dataclass(frozen=True)
class Source:
    """The C of a sampled law.

    `prefix`: of all names; `is_single`: float instead of double; `is_tunable`: gains and bounds are an argument of each
    step instead of being built in; `takes_clock`: a step is given a row of `Reference.clock` instead of a setpoint;
    `is_told`: and behind x what reached the motors.
    """

    sampled: SampledLaw
    prefix: str = "controller"
    is_single: bool = False
    is_tunable: bool = False
    takes_clock: bool = False
    is_told: bool = False
    origin: str = "a controller"  # what the text says of where it comes from

    @property
    def target(self) -> Target:
        """How its scalars are written."""
        real, f = ("float", "f") if self.is_single else ("double", "")
        return Target(real, functools.partial(decimal, is_single=self.is_single), f, f"{self.prefix}_", OWN)

    @functools.cached_property
    def step(self) -> ca.Function:
        """The step that is printed."""
        return self.sampled.traced(self.is_tunable, self.is_told)

    @functools.cached_property
    def compensated(self) -> dict[int, str]:
        """Entries of the state that are sums of small changes, with C of what rounding has left of them."""
        if not (self.is_single and self.sampled.law.adapts):
            return {}
        place = self.sampled.states.places["theta_hat"]
        return {entry: f"state->rest[{i}]" for i, entry in enumerate(range(place.start, place.stop))}

    @functools.cached_property
    def program(self) -> Program:
        """The step's lines."""
        gains = [f"k->{c_name(name)}[{i}]" for name, size in self._gain_sizes().items() for i in range(size)]
        arguments = [
            Argument("z[{i}]", Depends.BOTH),
            Argument(self._clock(), Depends.BOTH),
            Argument("x[{i}]", Depends.BOTH),
            Argument("dt", Depends.BOTH),
            Argument(gains, Depends.BOTH),
        ]
        return print_step(self.step, arguments, True, self.target, self.compensated)

    @property
    def setpoint(self) -> list[tuple[str, int, str]]:
        """The fields of a setpoint: name, size and what it is."""
        if self.takes_clock:
            return [("clock", self.sampled.clock_size, "time, and the reference unless it is a formula")]
        units = self.sampled.model.output_units
        return [
            (name, len(units), f"{symbol} [{', '.join(unit + rate for unit in units.values())}]")
            for name, symbol, rate in (
                ("position", "yr", ""),
                ("velocity", "yr'", "/s"),
                ("acceleration", "yr''", "/s^2"),
            )
        ]

    def header(self) -> str:
        """The interface."""
        return TEMPLATES.get_template("controller.h.jinja").render(self.context)

    def code(self, has_header: bool = True, is_called_by_python: bool = False) -> str:
        """What is behind the interface."""
        return TEMPLATES.get_template("controller.c.jinja").render(
            self.context, has_header=has_header, is_called_by_python=is_called_by_python
        )

    @functools.cached_property
    def context(self) -> dict[str, Any]:
        """What the templates read."""
        program, names = self.program, ["next", *self.sampled.signals]
        results = dict(zip(names, program.results, strict=True))
        model, literal = self.sampled.model, self.target.literal
        literals = {"zero": literal(0.0), "one": literal(1.0), "largest": literal(LARGEST_DOUBLE)}
        lines = [*program.robot, *program.time, *program.both]
        states = [Entry(f"{c_name(name)}{of}", about) for name, of, about in self._states()]
        rates = dict.fromkeys(model.input_units, "rad/s")  # as measured at the motors
        measured = {name: {**rates, **model.state_units}[name] for name in self.sampled.measured}
        applied = {f"applied_{name}": unit for name, unit in model.input_units.items()} if self.is_told else {}
        indices = [
            ("X", "What is measured, x", units({**measured, **applied})),
            ("Y", "The outputs y", units(model.output_units)),
            ("U", "The voltages u of the motors", units(model.input_units)),
            ("Z", "The state", states),
        ]
        told = [
            {"name": name, "size": len(results[name]), "about": about, "entries": results[name]}
            for name, about in TOLD.items()
            if name in results
        ]
        return {
            "P": self.prefix, "U": self.prefix.upper(), "real": self.target.real, "f": self.target.suffix, **literals,
            "title": in_a_comment(model.title), "origin": self.origin, "calls": program.calls,
            "sample_time": literal(self.sampled.sample_time), "max_gap": literal(self.sampled.max_gap),
            "indices": indices, "setpoint": self.setpoint, "rests": len(self.compensated), "gains": self._gains(),
            "told": told, "statuses": list(Status), "flags": self.sampled.flags,
            "of_the_moment": self.sampled.of_the_moment, "lines": lines,
            "first": [literal(float(v)) for v in self.sampled.start],
            "next": results["next"], "volts": results["u"], "command": results["command"],
            "remainders": [program.rests[entry] for entry in self.compensated],
            "at_bound": results["at_bound"], "regularity": results["regularity"][0],
            "surprise": results["surprise"][0] if self.sampled.surprise_bound else "",
            "bound": self._number(self.sampled.surprise_bound, 0),
            "bounds": self._bounds(),
            "layout": digest("\n".join([*lines, *results["next"], *map(str, states), self.target.real])),
        }  # fmt: skip

    def _clock(self) -> list[str]:
        """C of each entry of what a step is given of time and reference."""
        fields = [f"reference->{name}[{i}]" for name, size, _ in self.setpoint for i in range(size)]
        return fields if self.takes_clock else [self.target.literal(0.0), *fields]

    def _states(self) -> list[tuple[str, str, str]]:
        """Of each entry of the state its array, what tells it from others of that array, and what it is."""
        estimates, found = self.sampled.law.knowledge, []
        formulas = estimates.model.formulas_of(estimates.estimated)
        for name, place in self.sampled.states.places.items():
            if name == "theta_hat":
                found += [
                    (name, f"_{c_name(one)}", f"[{unit}] estimate of {one} = {formulas[one]}")
                    for one, unit in estimates.units.items()
                ]
            else:
                count = place.stop - place.start
                found += [(name, f"_{i}" if count > 1 else "", "") for i in range(count)]
        return found

    def _gain_sizes(self) -> dict[str, int]:
        sizes = Layout(self.sampled.values).sizes if self.is_tunable else {}
        return {name: size for name, size in sizes.items() if size}  # C has no empty arrays

    def _gains(self) -> list[dict[str, Any]]:
        values, literal = self.sampled.values, self.target.literal
        return [
            {"name": c_name(name), "entries": [literal(float(v)) for v in np.ravel(values[name])]}
            for name in self._gain_sizes()
        ]

    def _number(self, name: str, i: int) -> str:
        """C of a gain or bound."""
        if name not in self.sampled.values:
            return self.target.literal(inf)
        if self.is_tunable:
            return f"k->{c_name(name)}[{i}]"
        return self.target.literal(float(np.ravel(self.sampled.values[name])[i]))

    def _bounds(self) -> list[tuple[int, str, str]]:
        """What an estimate may not be: its entry of the state, a comparison and C of the bound."""
        start = self.sampled.states.places["theta_hat"].start
        return [
            (start + i, comparison, self._number(name, i))
            for name, comparison in (("projection.lower", "<"), ("projection.upper", ">"))
            for i, value in enumerate(self.sampled.values.get(name, ()))
            if abs(value) < inf
        ]


TOLD = {  # what a step tells, in the order of the struct
    "error": "e = y - yr",
    "filtered_error": "E1 = e' + alpha e",
    "command": "[V] before any limit",
    "regularity": "positive if what is inverted is regular",
    "observed": "x as the observer makes it out",
    "surprise": "by how much what is measured differs from what was expected [m, rad]",
}


def units(named: Mapping[str, str]) -> list[Entry]:
    """Entries with their units."""
    return [Entry(c_name(name), f"[{unit}]" if unit else "") for name, unit in named.items()]


def in_a_comment(text: str) -> str:
    """A text that ends no comment, continues no line and has no trigraph."""
    printed = "".join(one if one.isprintable() else " " for one in text)
    for wrong, right in (("*/", "* /"), ("/*", "/ *"), ("\\", "/"), ("??", "? ?")):
        printed = printed.replace(wrong, right)
    return printed


def c_name(name: str) -> str:
    """A name that C takes."""
    return re.sub(r"\W", "_", name)


def digest(text: str) -> str:
    """A number of 32 bits that changes with the text, as C."""
    return f"0x{hashlib.sha256(text.encode()).hexdigest()[:8]}u"
