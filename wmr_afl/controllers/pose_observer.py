"""Velocities, and what nobody modelled, from the pose alone; and the part of it that a law takes out of its command."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from types import SimpleNamespace

import numpy as np

from wmr_afl.controllers.observer import Observer, Seen
from wmr_afl.controllers.outer_loop import shorter_way
from wmr_afl.model.measurement import Measurement
from wmr_afl.model.model import Model
from wmr_afl.numerics.arrays import Array, Arrays, Floats
from wmr_afl.numerics.linear_algebra import solve
from wmr_afl.numerics.parts import Fault, Part


def moved(y: Array, y_rate: Array, acceleration: Array, step: Array) -> tuple[Array, Array]:
    """y and y' one step [s] later, y'' held: y + T y' + T^2/2 y'' and y' + T y'', (n-m,) each."""
    return y + step * y_rate + 0.5 * step * step * acceleration, y_rate + step * acceleration


class PoseObserver(Observer):
    """y^, y'^ and d^ from y = h(q) alone; v^ = E^-1 y'^. It needs no model, only the acceleration that was asked for.

    From sample to sample, T after the last one, with i = y - y^ and all error poles at B = exp(-rate T):

        y^ += T y'^ + T^2/2 y''      y'^ += T y''
        y^ += (1 - B^3) i            y'^ += 1.5 (1 - B)^2 (1 + B) i/T            d^ += (1 - B)^3 i/T^2

    y'' is what the law expects of the voltages that reach the motors, d^ included, so that nothing winds up at a limit.
    At the first sample y^ = y, y'^ = d^ = 0. With `measures_v` the law goes by y and v as measured, and by d^.
    `rate` [1/s]; a sample that differs from what was expected by more than `bound` [output units] ends what it is for.

    Raises:
        WmrError: if the rate or the bound is not positive.

    References: an extended high-gain observer, as in Khalil, Praly, High-gain observers in nonlinear feedback control,
    Int. J. Robust and Nonlinear Control 24, 2014, with sampled poles.
    """

    def __init__(
        self,
        outputs: int,
        rate: float,
        measures_v: bool = False,
        bound: float = np.inf,
        measurement: Measurement | None = None,
    ) -> None:
        """`measurement`: of the pose, or of all of x, if its entries are what `see` is given."""
        self.outputs, self.measures_v, self.measurement = outputs, measures_v, measurement
        self.rate, self.bound = np.array([float(rate)]), np.array([float(bound)])
        self.check_numbers()

    @property
    def values(self) -> dict[str, Floats]:
        return {"rate": self.rate, "bound": self.bound}

    @property
    def states(self) -> dict[str, Floats]:
        of_outputs = {name: np.zeros(self.outputs) for name in ("y", "y_rate", "acceleration", "unexpected")}
        return {**of_outputs, "is_running": np.zeros(1)}

    def see(self, x: Array, z: SimpleNamespace, k: SimpleNamespace, c: Array, model: Model, step: Array) -> Seen:
        """What this sample tells; of x (2n-m,) only q is looked at unless v is measured, too."""
        if self.measurement is not None:
            x = self.measurement.state(x, None, model)
        arrays, n, runs = model.arrays, model.coordinate_count, z.is_running[0]
        q, passed = x[:n], arrays.where(step > 0.0, step, 1.0)
        y, E = model.output(q, c), model.output_map(q, c)
        came, came_rate = moved(z.y, z.y_rate, z.acceleration, step)
        expected, expected_rate = runs * came + (1.0 - runs) * y, runs * came_rate
        innovation = shorter_way(y - expected, model)  # a measured angle may jump by a turn
        B = arrays.exp(-k.rate[0] * passed)
        own = (
            expected + (1.0 - B * B * B) * innovation,
            expected_rate + 1.5 * (1.0 - B) * (1.0 - B) * (1.0 + B) / passed * innovation,
        )
        unexpected = runs * z.unexpected + (1.0 - B) * (1.0 - B) * (1.0 - B) / (passed * passed) * innovation
        surprise = 0.0
        for i in range(self.outputs):
            surprise = arrays.maximum(surprise, arrays.absolute(innovation[i]))
        if self.measures_v:
            started = (own[0], runs * own[1] + (1.0 - runs) * (E @ x[n:]))
            return Seen(x, y, E @ x[n:], unexpected, E, surprise, {"own": started})
        observed = arrays.join([q, solve(E, own[1], arrays)])
        return Seen(observed, *own, unexpected, E, surprise, {"own": own})

    def update(self, seen: Seen, acceleration: Array, drift: Array, arrays: Arrays) -> dict[str, Array]:
        y, y_rate = seen.memory["own"]
        return {
            "y": y,
            "y_rate": y_rate,
            "acceleration": acceleration,
            "unexpected": seen.unexpected,
            "is_running": arrays.vector([1.0]),
        }


def _not_positive(name: str) -> Callable[[SimpleNamespace], tuple[str, str]]:
    return lambda k: (f"the {name} of cancelling is {getattr(k, name)[0]:g} s", "choose a positive time")


class Cancelling(Part):
    """What is taken out of the command of what was not expected: g d^, in accelerations of v.

    g is 0 until `start` [s] and then 1 - exp(-(t - start)/ramp): learn first. Its part that is faster than `band`
    [s] is kept out of the data of least squares, which would take it for a property of the robot.

    Raises:
        WmrError: if a number is negative, or ramp or band are not positive.
    """

    name = "cancelling"

    def __init__(self, count: int, start: float = 2.0, ramp: float = 2.0, band: float = 1.0, separates: bool = True):
        self.count, self.separates = count, separates
        self.numbers = {"start": float(start), "ramp": float(ramp), "band": float(band)}
        self.check_numbers()

    @property
    def values(self) -> dict[str, Floats]:
        return {name: np.array([value]) for name, value in self.numbers.items()}

    @property
    def states(self) -> dict[str, Floats]:
        return {"elapsed": np.zeros(1), "slow": np.zeros(self.count)}

    def faults(self, k: SimpleNamespace) -> Iterator[Fault]:
        yield (
            ~np.all(np.isfinite(k.start) & (k.start >= 0), axis=-1),
            lambda k: (f"cancelling starts at {k.start[0]:g} s", "choose zero or more"),
        )
        for name in ("ramp", "band"):
            value = getattr(k, name)
            yield (
                ~np.all(np.isfinite(value) & (value > 0), axis=-1),
                _not_positive(name),
            )

    def cancelled(self, acceleration: Array, z: SimpleNamespace, k: SimpleNamespace, arrays: Arrays) -> Array:
        """g E^-1 d^, (n-m,), of `acceleration` E^-1 d^."""
        since = arrays.maximum(z.elapsed[0] - k.start[0], 0.0)
        return (1.0 - arrays.exp(-since / k.ramp[0])) * acceleration

    def fast(self, cancelled: Array, z: SimpleNamespace) -> Array:
        """The part of it that is too fast to be a property of the robot, (n-m,)."""
        return cancelled - z.slow if self.separates else 0.0 * cancelled

    def update(
        self, cancelled: Array, z: SimpleNamespace, k: SimpleNamespace, arrays: Arrays, step: Array
    ) -> dict[str, Array]:
        """The states one sample later."""
        kept = arrays.exp(-step / k.band[0])
        return {"elapsed": z.elapsed + step, "slow": kept * z.slow + (1.0 - kept) * cancelled}
