"""Plant, controller and reference as one step in discrete time: the text that NumPy runs and CasADi traces."""

from __future__ import annotations

import functools
from collections.abc import Mapping
from dataclasses import dataclass
from types import SimpleNamespace
from typing import Any

import casadi as ca
import numpy as np

from wmr_afl.arrays import Array
from wmr_afl.controllers.outer_loop import tracking_error
from wmr_afl.controllers.tracking import TrackingController
from wmr_afl.language import Language
from wmr_afl.model import Model, Vector
from wmr_afl.plant.plant import Plant
from wmr_afl.references import Reference


class Layout:
    """Named arrays one after the other in a flat vector, matrices by row."""

    def __init__(self, example: Mapping[str, Vector]) -> None:
        self.shapes = {name: np.shape(value) for name, value in example.items()}
        self.sizes = {name: int(np.prod(shape)) for name, shape in self.shapes.items()}

    @property
    def size(self) -> int:
        return sum(self.sizes.values())

    @functools.cached_property
    def places(self) -> dict[str, slice]:
        """Where each name lies."""
        ends = np.cumsum([0, *self.sizes.values()])
        return {name: slice(int(a), int(b)) for name, a, b in zip(self.sizes, ends[:-1], ends[1:], strict=True)}

    def pack(self, values: Mapping[str, Any]) -> Vector:
        """Named NumPy arrays -> flat vector (size,)."""
        return np.concatenate([np.zeros(0), *(np.ravel(values[name]) for name in self.shapes)])

    def unpack(self, flat: Vector) -> dict[str, Vector]:
        """Flat vector -> named NumPy arrays."""
        return {name: flat[place].reshape(self.shapes[name]) for name, place in self.places.items()}

    def pack_symbols(self, values: Mapping[str, Any]) -> ca.SX:
        """Named columns -> flat column."""
        return ca.vertcat(*(values[name] for name in self.shapes))

    def unpack_symbols(self, flat: ca.SX) -> SimpleNamespace:
        """Flat column -> named columns and matrices."""
        parts = {}
        for name, place in self.places.items():
            shape = self.shapes[name]
            parts[name] = ca.reshape(flat[place], *shape[::-1]).T if len(shape) == 2 else flat[place]
        return SimpleNamespace(**parts)


@dataclass(frozen=True, eq=False)
class ClosedLoop:
    """One robot, one controller, one reference, sampled every `sample_time` [s]; each is its own and may be a key."""

    model: Model
    plant: Plant
    controller: TrackingController
    reference: Reference
    sample_time: float

    @functools.cached_property
    def values(self) -> dict[str, Vector]:
        """Parameters and gains: what may differ between robots of a batch, never the text."""
        return {**self.plant.values, **self.controller.values}

    @functools.cached_property
    def states(self) -> dict[str, Vector]:
        """The loop's state at the start."""
        return {**self.plant.states, **self.controller.states}

    @functools.cached_property
    def signals(self) -> dict[str, int]:
        """What is logged at every sample, with sizes."""
        outputs, inputs = len(self.model.output_units), len(self.model.input_units)
        return {
            "x": len(self.model.state_units),
            "u": inputs,
            "command": inputs,
            "e": outputs,
            "theta_hat": len(self.model.base_parameter_units),
            "reference": outputs,
            "regularity": 1,
        }

    @functools.cached_property
    def signal_layout(self) -> Layout:
        """Where each signal lies in a row of the log."""
        return Layout({name: np.zeros(size) for name, size in self.signals.items()})

    def step(
        self, t: Array, z: SimpleNamespace, k: SimpleNamespace, sample: Array, language: Language
    ) -> tuple[dict[str, Array], dict[str, Array]]:
        """From sample to sample: the next state of the loop, and the signals now.

        t [s]; z: state by name; k: values by name; sample: standard normal numbers (2n-m,).
        """
        reference = self.reference.at(t)
        seen = self.plant.measured(z.x, sample, k)
        action = self.controller.act(seen, reference, z, k, language)
        applied = self.plant.applied(action.input, z, k, language)
        signals = {
            "x": z.x,
            "u": applied,
            "command": action.input,
            "e": tracking_error(z.x, k.c, reference, language).e,
            "theta_hat": z.theta_hat,
            "reference": reference.position,
            "regularity": action.regularity,
        }
        following = {
            **self.plant.update(t, action.input, applied, z, k, self.sample_time, language),
            **self.controller.update(seen, action, applied, z, k, self.sample_time, language),
        }
        return following, signals


@functools.lru_cache(maxsize=32)
def sample_times(loop: ClosedLoop, duration: float) -> Vector:
    """The times of all samples from 0 to `duration` [s], (T,), not to be written into."""
    times = np.asarray(np.arange(round(duration / loop.sample_time) + 1) * loop.sample_time, dtype=np.float64)
    times.flags.writeable = False
    return times
