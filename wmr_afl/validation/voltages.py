"""Voltages that make any robot move: about 0.8 m/s, joints to and fro, each motor with waves of its own."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike

from wmr_afl.numerics.arrays import Floats
from wmr_afl.validation.mechanism import Mechanism

SPEED = 0.8  # [m/s], of wheels
SWING = 0.35  # [rad], of joints that a motor turns
RISE = 0.5  # [s], of what is constant


@dataclass(frozen=True)
class Waves:
    """u_j(t) = constant_j (1 - exp(-t/RISE)) + sum of sines, which grow within a second."""

    constant: Floats  # (n_u,) [V]
    size: Floats  # (n_u, waves) [V]
    rate: Floats  # (n_u, waves) [rad/s]
    phase: Floats  # (n_u, waves) [rad]

    @classmethod
    def of(cls, mechanism: Mechanism) -> Waves:
        """Those of a robot: its motors turn as fast as their back-EMF lets them."""
        wheels = {wheel.name: wheel for wheel in mechanism.wheels}
        rolls = all(wheel.roller_angle is not None for wheel in mechanism.wheels)  # a robot that goes any way
        constant, size, rate, phase = [], [], [], []
        for k, motor in enumerate(mechanism.motors):
            volts = (motor.back_emf or 1.0) / motor.gain  # by rad/s
            if motor.drives in wheels:
                fast = SPEED / wheels[motor.drives].radius * volts
                constant.append(0.0 if rolls else fast)
                size.append(fast * (1.0 if rolls else 0.35) * np.array([1.0, 0.6, 0.3]))
                rate.append(np.array([0.7 + 0.2 * k, 1.9 + 0.3 * k, 4.1 + 0.5 * k]))
                phase.append(np.array([2.1, 1.1, 0.7]) * k)
            else:
                own = np.array([0.9, 2.3, 0.0])
                constant.append(0.0)
                size.append(SWING * volts * own)
                rate.append(own)
                phase.append(np.array([1.3 + k, 0.4 + 2.0 * k, 0.0]))
        return cls(*(np.array(one) for one in (constant, size, rate, phase)))

    def at(self, t: ArrayLike) -> Floats:
        """(T, n_u) [V]."""
        time = np.asarray(t, dtype=float)[:, None, None]
        waves = np.sum(self.size * np.sin(self.rate * time + self.phase), axis=-1) * np.minimum(time[..., 0], 1.0)
        return self.constant * (1.0 - np.exp(-time[..., 0] / RISE)) + waves

    @property
    def largest(self) -> Floats:
        """(n_u,) [V], within ten seconds."""
        return np.abs(self.at(np.linspace(0.0, 10.0, 200))).max(axis=0)
