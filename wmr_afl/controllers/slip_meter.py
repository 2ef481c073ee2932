"""How wheels slip as the robot shows it: measured from its poses and, where these are measured, its velocities."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass
from types import SimpleNamespace

import numpy as np
from numpy.typing import ArrayLike

from wmr_afl.controllers.outer_loop import within_half_a_turn
from wmr_afl.model.model import Model
from wmr_afl.model.slip import is_driven, wheel_rows
from wmr_afl.numerics.arrays import Array, Floats
from wmr_afl.numerics.parts import Fault, Part

# Of the observer's rate, which leaves 0.1/T: at samples of 20 ms 1 mm of noise reads as 5 mm/s, and slip 0.2 s late.
SHARE_OF_OBSERVER = 1.0 / 6.0


@dataclass(frozen=True)
class SeenSlip:
    """What a sample tells of slip, and what the next one will need of it."""

    speeds: Array  # sigma^, one for each of the meter's names [m/s]
    q: Array  # as measured, (n,)
    v: Array | None  # as measured, (n-m,), where it is looked at


class SlipMeter(Part):
    """sigma^, how fast contacts of wheels slip [m/s], without a model of why: sideways, and along of driven wheels.

    From sample to sample, T after the last one, with qbar half way between the two,

        raw = Z(qbar) ((q - q_last)/T - S(qbar) (v + v_last)/2)       sigma^ += (1 - exp(-slip_rate T)) (raw - sigma^)

    where S(q) v counts in rows of motors only: sideways nothing but the pose is looked at, for Z S is zero there. Rows
    of motors are read where v is measured, too: their v is what the wheels do. At the first sample sigma^ = 0, after a
    gap again. Angles may jump by a turn. `slip_rate` [1/s].

    `p` (n_p,) are the physical parameters as the controller takes them for true: Z needs of them where wheels stand,
    which a tape measure tells, and no mass and no motor.

    Raises:
        WmrError: if the rate is not positive.
    """

    name = "slip"

    def __init__(self, model: Model, p: ArrayLike, rate: float, measures_v: bool = False) -> None:
        rows = {name: row for name, row in wheel_rows(model).items() if measures_v or not is_driven(model, row)}
        self.names, self.rows = tuple(rows), tuple(rows.values())
        self.p, self.rate = np.array(p, dtype=float), np.array([float(rate)])
        units = list(model.state_units.values())[: model.coordinate_count]
        self._turns = tuple(unit == "rad" for unit in units)
        self._reads_v, self._velocities = any(is_driven(model, row) for row in self.rows), model.pseudo_velocity_count
        self.check_numbers()

    @property
    def values(self) -> dict[str, Floats]:
        return {"p": self.p, "slip_rate": self.rate}

    @property
    def states(self) -> dict[str, Floats]:
        v = {"v": np.zeros(self._velocities)} if self._reads_v else {}
        return {"speeds": np.zeros(len(self.rows)), "q": np.zeros(len(self._turns)), **v, "is_running": np.zeros(1)}

    def faults(self, k: SimpleNamespace) -> Iterator[Fault]:
        yield (
            ~np.all(np.isfinite(k.slip_rate) & (k.slip_rate > 0), axis=-1),
            lambda k: (f"the rate at which slip is read is {k.slip_rate[0]:g}", "choose a positive number [1/s]"),
        )

    def see(self, x: Array, z: SimpleNamespace, k: SimpleNamespace, model: Model, step: Array) -> SeenSlip:
        """What this sample tells: x (2n-m,) as measured, of which v is looked at by rows of motors only."""
        arrays, n, runs = model.arrays, len(self._turns), z.is_running[0]
        q, v, passed = x[:n], x[n:] if self._reads_v else None, arrays.where(step > 0.0, step, 1.0)
        far = runs * (q - z.q)
        moved = arrays.vector([within_half_a_turn(far[i], arrays) if t else far[i] for i, t in enumerate(self._turns)])
        half_way = q - 0.5 * moved
        Z = model.slip_matrix(half_way, k.p)
        speeds = Z @ moved / passed
        if v is not None:
            speeds = speeds - Z @ (model.kinematic_matrix(half_way, k.p) @ (0.5 * (v + z.v)))
        raw = arrays.vector([speeds[row] for row in self.rows])
        share = 1.0 - arrays.exp(-k.slip_rate[0] * passed)
        return SeenSlip(runs * (z.speeds + share * (raw - z.speeds)), q, v)

    def update(self, seen: SeenSlip, model: Model) -> dict[str, Array]:
        """The states one sample later."""
        v = {} if seen.v is None else {"v": seen.v}
        return {"speeds": seen.speeds, "q": seen.q, **v, "is_running": model.arrays.vector([1.0])}
