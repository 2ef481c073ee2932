"""A robot and what disturbs it as one step in discrete time: what stands for the robot in another simulator."""

from __future__ import annotations

import functools
from collections.abc import Iterator, Mapping
from dataclasses import dataclass
from itertools import product

import casadi as ca
import numpy as np

from wmr_afl.numerics.arrays import Floats
from wmr_afl.numerics.parts import Fixed
from wmr_afl.simulation.closed_loop import ClosedLoop
from wmr_afl.simulation.layout import Layout


@dataclass(frozen=True)
class Number:
    """A number that may be set: what it is called, its unit, what it is, and its value."""

    name: str
    unit: str
    about: str
    value: float


class SampledPlant(Fixed):
    """From sample to sample: the robot's next states, for voltages that are held.

    Physical parameters and the numbers of uncertainties are arguments; expressions of time and whole samples of delay
    are built in.
    """

    def __init__(self, loop: ClosedLoop) -> None:
        self.model, self.plant, self.sample_time = loop.model, loop.plant, loop.sample_time
        self.measurement = loop.law.measurement
        self.measured = tuple(self.model.state_units) if self.measurement is None else self.measurement.names

    @functools.cached_property
    def states(self) -> Layout:
        """Where the states lie in a flat vector, x first."""
        return Layout(self.plant.states)

    @functools.cached_property
    def values(self) -> Layout:
        """Where parameters and numbers of uncertainties lie in a flat vector, p first."""
        return Layout(self.plant.values)

    @property
    def counts_samples(self) -> bool:
        """Whether something goes by whole samples, as a delay does; else a step may be as long as it likes."""
        return len(self.states.shapes) > 1

    @property
    def start(self) -> Floats:
        """The states at the start, flat."""
        return self.states.pack(self.plant.states)

    def traced(self) -> ca.Function:
        """(states, voltages, t, step, values) -> next states, all flat columns."""
        model = self.model.in_library("casadi")
        z, u = ca.SX.sym("states", self.states.size), ca.SX.sym("voltages", len(self.model.input_units))
        t, step, numbers = ca.SX.sym("t"), ca.SX.sym("step"), ca.SX.sym("values", self.values.size)
        k = self.values.unpack_symbols(numbers)
        following = self.plant.update(t, u, self.states.unpack_symbols(z), k, model, step)
        result = ca.cse([ca.densify(ca.SX(self.states.pack_symbols(following)))])
        return ca.Function("plant", [z, u, t, step, numbers], result)

    def traced_measurement(self) -> ca.Function:
        """(x, normal numbers, t, values) -> what is measured, all flat columns."""
        model = self.model.in_library("casadi")
        x, sample = ca.SX.sym("x", len(self.model.state_units)), ca.SX.sym("sample", self.plant.samples)
        t, numbers = ca.SX.sym("t"), ca.SX.sym("values", self.values.size)
        k = self.values.unpack_symbols(numbers)
        seen = self.plant.measured(x, sample, k, model.arrays)
        if self.measurement is not None:
            seen = self.measurement.of(seen, self.plant.parameters_at(t, k, model.arrays), model)
        return ca.Function("measured", [x, sample, t, numbers], ca.cse([ca.densify(ca.SX(seen))]))

    @property
    def measured_units(self) -> dict[str, str]:
        """What is measured, with units: entries of the state, and rates of motors by their inputs."""
        return {name: self.model.state_units.get(name, "rad/s") for name in self.measured}

    def numbers(self) -> Iterator[Number]:
        """Each of the values: physical parameters as `parameters.m_C`, others as `friction.viscous.u_r`."""
        named = {"p": self.model.parameter_units}
        for key, part in self.plant.uncertainties.items():
            named |= {f"{key}.{name}": entries for name, entries in part.entries(self.model).items()}
        about = self.model.metadata["about"]
        for name, value in self.plant.values.items():
            entries, is_parameter = named.get(name), named.get(name) is self.model.parameter_units
            group = "parameters" if name == "p" else name
            for entry, unit, number in numbered(value, entries):
                told = about[entry] if is_parameter else "of what disturbs the robot"
                yield Number(joined(group, entry), unit, told, number)


def numbered(value: Floats, entries: Mapping[str, str] | None = None) -> Iterator[tuple[str, str, float]]:
    """Of each entry of an array its name, or else its indices from 1 on, its unit and its value."""
    if entries is None:
        shape = np.shape(value) if np.size(value) != 1 else ()
        places = (",".join(map(str, place)) for place in product(*(range(1, size + 1) for size in shape)))
        entries = {f"[{place}]" if place else "": "" for place in places}
    for (entry, unit), number in zip(entries.items(), np.ravel(value), strict=True):
        yield entry, unit, float(number)


def joined(group: str, entry: str) -> str:
    """A name in the structure of names: `group.entry`, `group[1]`, or `group` alone."""
    return f"{group}.{entry}" if entry and not entry.startswith("[") else f"{group}{entry}"
