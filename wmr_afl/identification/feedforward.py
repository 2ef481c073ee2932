"""What teams with a differential drive tune by hand, read off an estimate: u = kS sgn v + kV v + kA a.

u is the voltage of each motor, v and a are those of the wheels' travel in metres, both wheels alike (driving) or
against each other (turning). With R u = Y(x, a) pi the voltages of a motion are R^-1 Y pi; their part that is linear in
v is R^-1 (Y(v) - Y(-v)) pi/2, in which there are no centrifugal forces.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from wmr_afl.identification.effort import Effort
from wmr_afl.identification.estimate import Estimate
from wmr_afl.numerics.arrays import Floats
from wmr_afl.numerics.formulas import numpy_value

MOTIONS = {"driving": (1.0, 1.0), "turning": (-1.0, 1.0)}  # travel of the two wheels


@dataclass(frozen=True)
class Feedforward:
    """The gains of one motion, as WPILib's SysId names them; of both motors the mean."""

    motion: str
    kS: float  # [V]
    kV: float  # [V s/m]
    kA: float  # [V s^2/m]
    interval: tuple[float, float, float]  # two standard deviations of noise, of each

    def __str__(self) -> str:
        s, v, a = self.interval
        gains = (
            f"kS {self.kS:.4g} ± {s:.1g} V",
            f"kV {self.kV:.4g} ± {v:.1g} V s/m",
            f"kA {self.kA:.4g} ± {a:.1g} V s^2/m",
        )
        return f"{self.motion}: {', '.join(gains)}"


def feedforward(effort: Effort, estimate: Estimate) -> tuple[Feedforward, ...] | None:
    """The gains of driving and of turning, every joint at zero; None if the robot is no differential drive.

    It is one if it has two motors that are alike, each on a wheel, and two pseudo-velocities, whose relation to the
    wheels' rates and to the voltages is the same everywhere.
    """
    radii = _radii(effort)
    if radii is None or effort.n_v != 2 or effort.ratio_groups:
        return None
    q = np.vstack([np.zeros(effort.n), np.random.default_rng(0).normal(size=(4, effort.n))])
    maps, rates = (np.broadcast_to(one, (len(q), 2, 2)) for one in (effort.map(q), effort.motor_rates(q)))
    if not (np.allclose(maps, maps[0]) and np.allclose(rates, rates[0])):
        return None
    travel = radii[:, None] * rates[0]
    if min(abs(np.linalg.det(travel)), abs(np.linalg.det(maps[0]))) < 1e-12:
        return None
    found = []
    for motion, ways in MOTIONS.items():
        way, of_unknown = np.array(ways), np.zeros((3, len(effort.units)))  # kS, kV and kA are linear in what was found
        for name, group in effort.friction_groups.items():
            of_unknown[0, list(effort.units).index(name)] = 0.5 * len(group)
        unit = np.linalg.solve(travel, way)  # v, at which the wheels travel at a metre a second
        volts = np.linalg.solve(maps[0], np.stack(_regressors(effort, unit)))
        of_unknown[1:, : effort.n_pi] = np.mean(way[:, None] * volts, axis=1)
        k_s, k_v, k_a = (of_unknown @ estimate.unknown).tolist()
        deviations = np.sqrt(np.maximum(np.diag(of_unknown @ estimate.covariance @ of_unknown.T), 0.0))
        found.append(Feedforward(motion, k_s, k_v, k_a, tuple((2.0 * deviations).tolist())))
    return tuple(found)


def _radii(effort: Effort) -> Floats | None:
    """The radius of the wheel that each of two motors drives [m]; None if there are others, or one drives a joint."""
    motors, wheels = effort.model.metadata["motors"], effort.model.metadata["geometry"]["wheels"]
    if len(motors) != 2 or not all(motor["drives"] in wheels for motor in motors.values()):
        return None
    names = dict(zip(effort.model.parameter_units, effort.p, strict=True))
    return np.array([float(numpy_value(wheels[motor["drives"]]["radius"], names)) for motor in motors.values()])


def _regressors(effort: Effort, unit: Floats) -> tuple[Floats, Floats]:
    """What of Y (2, n_pi) is linear in v along `unit`, and what is linear in a, every coordinate zero."""
    still = np.zeros((2, 2))

    def regressor(v: Floats, a: Floats) -> Floats:
        return np.asarray(effort.model.effort_regressor(np.hstack([np.zeros((2, effort.n)), v]), a, effort.c))

    ahead, back = regressor(np.stack([unit, -unit]), still)
    accelerated, at_rest = regressor(still, np.stack([unit, 0.0 * unit]))
    return 0.5 * (ahead - back), accelerated - at_rest
