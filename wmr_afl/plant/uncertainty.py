"""What every uncertainty may do to a robot, as hooks that do nothing unless a subclass says otherwise."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from types import SimpleNamespace
from typing import ClassVar

from wmr_afl.model.model import Model
from wmr_afl.numerics.arrays import Array, Arrays, Floats
from wmr_afl.numerics.parts import Part
from wmr_afl.numerics.rules import Rules
from wmr_input.fields import Table


@dataclass(frozen=True)
class Surroundings:
    """What a table of [uncertainties] may need to know of its experiment."""

    model: Model
    parameters: Floats  # p (n_p,)
    sample_time: float  # [s]


class UncertaintyTable(Table):
    """The table of an uncertainty in an experiment."""

    key: ClassVar[str] = ""  # where in the table a mistake is reported that shows only with the robot

    def build(self, surroundings: Surroundings) -> Uncertainty:
        """The uncertainty that the table describes.

        Raises:
            WmrError: if it does not fit the robot.
        """
        raise NotImplementedError

    def rules(self, model: Model) -> Rules:
        """Its numbers, by name, that follow from other numbers of the loop."""
        return {}


@dataclass(frozen=True)
class Resistance:
    """Forces F against rates J v, least <= F <= most (None is no bound), as large as needed to stop the motion.

    F = most while the rate stays positive, F = least while it stays negative. With distances d >= 0 that change by J v,
    what is stopped is not the motion, but what would make d negative.
    """

    matrix: Array  # J (k, n-m)
    least: Sequence[Array | None]  # (k,)
    most: Sequence[Array | None]  # (k,)
    distance: Array | None = None  # d (k,)


class Uncertainty(Part):
    """Something between the controller and the robot, or on the robot, of which no controller knows.

        seen = measured(x)        u = the controller's command        x' = f(x, applied(u), w, p) + rate     (15)
        w = sum of loads and of what resistances need                p = parameters at time t

    In NumPy and CasADi alike; `z` and `k` hold the part's own states and numbers by their names.
    """

    samples: int = 0  # standard normal numbers that it takes at every sample time
    seed: int = 0  # of these
    limits_inputs: ClassVar[bool] = False  # it bounds what leaves it, whatever comes in
    is_of_drive: ClassVar[bool] = False  # it changes commands as a drive does, which a real-time controller may know

    def entries(self, model: Model) -> dict[str, dict[str, str]]:
        """Of its numbers, by name, what their entries are called and in which units they are; one alone has no name."""
        return {}

    def measured(self, x: Array, sample: Array, k: SimpleNamespace, arrays: Arrays) -> Array:
        """The state that is seen while it is x, (2n-m,); `sample` are its standard normal numbers (samples,)."""
        return x

    def applied(self, u: Array, z: SimpleNamespace, k: SimpleNamespace, arrays: Arrays) -> Array:
        """The voltages that leave while u comes in, (n_u,) [V]."""
        return u

    def load(self, t: Array, x: Array, p: Array, k: SimpleNamespace, model: Model) -> Array | None:
        """A generalized force on v, against the motion: Mbar v' + Cbar v + w = Bbar K1 u (14), (n-m,); None is zero."""
        return None

    def resistance(self, x: Array, p: Array, k: SimpleNamespace, model: Model) -> Resistance | None:
        """Forces that stop motions, and hold until they are overcome; None is none."""
        return None

    def rate(self, t: Array, x: Array, p: Array, k: SimpleNamespace, model: Model) -> Array | None:
        """What is added to x', (2n-m,); None adds nothing."""
        return None

    def parameters(self, t: Array, p: Array, k: SimpleNamespace, arrays: Arrays) -> Array:
        """The physical parameters at time t, (n_p,)."""
        return p

    def update(self, u: Array, z: SimpleNamespace, k: SimpleNamespace, arrays: Arrays) -> dict[str, Array]:
        """Its own states one sample later, for u as it came in at `applied`."""
        return {}
