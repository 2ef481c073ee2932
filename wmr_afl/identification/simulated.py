"""Motions under held voltages as the equation in base parameters foresees them, and what would be measured of them."""

from __future__ import annotations

import os
from collections.abc import Sequence
from dataclasses import dataclass
from functools import cache

import casadi as ca
import numpy as np

from wmr_afl.identification.effort import Effort
from wmr_afl.identification.log import Channel
from wmr_afl.numerics.arrays import Floats
from wmr_afl.plant.integrators import rk4
from wmr_afl.simulation.kernels.c_compiler import compiler, library

SUBSTEP = 0.01  # [s], of the Runge-Kutta steps at most
THREADS = os.cpu_count() or 1
SHARED = 64  # motions, from which on threads take parts of them
FINEST = 0.0025  # [s], however steep friction is


@dataclass(frozen=True)
class Simulated:
    """Many motions at once, each with base parameters of its own."""

    effort: Effort
    step: float  # sample time [s]
    substep: float = SUBSTEP  # [s], of the Runge-Kutta steps at most

    def states(self, unknown: Floats, x0: Floats, u: Floats) -> Floats:
        """States [q; v; motors' angles] (K+1, size, N) from x0 (N, 2n-m) under u (N, K, n_u) [V].

        `unknown` is (N, unknown); the angles begin at zero. What grows without bound ends in NaN.
        """
        sample = self._many(len(x0))
        state = np.concatenate([x0.T, np.zeros((u.shape[-1], len(x0)))])
        found = [state]
        for k in range(u.shape[1]):
            state = np.asarray(sample(state, u[:, k].T, unknown.T))
            found.append(state)
        return np.stack(found)

    def _many(self, count: int) -> ca.Function:
        """(states, u, unknown) -> the states one sample later, of so many motions."""
        built, key = self.effort.built, (self.step, self.substep)
        if key not in built:
            built[key] = _compiled(_sample(self.effort, self.step, self.substep))
        return built[key].map(count, "thread", THREADS) if count >= SHARED else built[key].map(count)


def _sample(effort: Effort, step: float, substep: float) -> ca.Function:
    size, inputs = effort.n + effort.n_v, len(effort.model.input_units)
    state, u = ca.SX.sym("state", size + inputs), ca.SX.sym("u", inputs)
    unknown = ca.SX.sym("unknown", len(effort.units))
    substeps = max(1, int(np.ceil(step / substep - 1e-9)))
    h, now = step / substeps, state
    for _ in range(substeps):
        friction = effort.holding(now[:size], u, unknown, h)

        def rate(t: float, s: ca.SX, friction: ca.SX = friction) -> ca.SX:
            q_rate, v_rate, motor_rates = effort.motion(s[:size], u, unknown, friction)
            return ca.SX(ca.vertcat(q_rate, v_rate, motor_rates))

        now = rk4(rate, 0.0, now, h)
    return ca.Function("sample", [state, u, unknown], [ca.cse(now)])


def _compiled(function: ca.Function) -> ca.Function:
    """The same function as machine code, where there is a compiler: several times as fast, the same arithmetic."""
    if compiler() is None:
        return function
    generator = ca.CodeGenerator(f"{function.name()}.c", {"with_header": False})
    generator.add(function)
    return _external(function.name(), generator.dump())


@cache
def _external(name: str, text: str) -> ca.Function:
    return ca.external(name, library(text, is_fused=False)._name)


def channel_values(effort: Effort, channels: Sequence[Channel], state: Floats) -> Floats:
    """What the channels would measure at states [q; v; motors' angles] (size, N): (N, channels)."""
    n, size = effort.n, effort.n + effort.n_v
    q, v = state[:n].T, state[n:size].T
    matrices = {"motor": effort.motor_rates, "coordinate": effort.kinematic}
    columns = []
    for one in channels:
        if one.matrix == "velocity":
            columns.append(v[:, one.index])
        elif one.is_rate:
            columns.append(np.einsum("...i,...i->...", matrices[one.matrix](q)[:, one.index], v))
        else:
            columns.append(state[size + one.index] if one.matrix == "motor" else q[:, one.index])
    return np.stack(columns, axis=1)
