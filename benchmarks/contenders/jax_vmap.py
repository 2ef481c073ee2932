"""JAX: one robot's step, scanned over the samples; many robots by vmap. Compiling is not part of a run."""

from __future__ import annotations

from collections.abc import Callable

import jax
import jax.numpy as jnp
import numpy as np

from benchmarks.contenders.study_1 import PLANT, SINGULAR, numbers
from benchmarks.contenders.work import Numbers, Summary, Work

jax.config.update("jax_enable_x64", True)


def step(p, t, state):
    """One sample: the next state, the errors, the voltages, and whether Dhat is regular."""
    r, b, d, L, m_C, m_w, I_m, I_C, K1, K2 = p[:10]
    b1, b2, alpha, gamma, lower = (p[a:z] for a, z in ((10, 12), (12, 14), (14, 16), (16, 22), (22, 28)))
    center, (radius, rate, h) = p[28:30], p[30:]
    phi, v, omega = state[2:PLANT]
    theta = state[PLANT:]
    axis = jnp.array([jnp.cos(phi), jnp.sin(phi)])
    normal = jnp.array([-axis[1], axis[0]])
    circle = radius * jnp.array([jnp.cos(rate * t), jnp.sin(rate * t)])
    e = state[:2] + L * axis - center - circle
    e_dot = v * axis + L * omega * normal - rate * jnp.array([-circle[1], circle[0]])
    eta = -(rate**2) * circle - b1 * e_dot - b2 * e
    filtered = e_dot + alpha * e
    # in the robot's frame Dhat is diagonal
    square, product = omega * omega, omega * v
    total = (axis @ eta + L * square + theta[0] * v - theta[1] * square) / theta[4]
    difference = (normal @ eta - product + L * (theta[2] * omega + theta[3] * product)) / (L * theta[5])
    a, a_side = theta[4] ** 2, (L * theta[5]) ** 2
    regular = a * a_side >= (SINGULAR * (a - a_side) * axis[0] * axis[1]) ** 2
    forward, sideways = axis @ filtered, L * (normal @ filtered)
    direction = jnp.array([
        -v * forward, square * forward, -omega * sideways, -product * sideways, total * forward, difference * sideways,
    ])  # fmt: skip
    mass = m_C + 2.0 * m_w
    inertia = I_C + 2.0 * I_m + m_C * d**2 + 2.0 * m_w * b**2
    force = K1 / r * total - 2.0 * K2 / r**2 * v + m_C * d * square
    torque = K1 * b / r * difference - 2.0 * K2 * b**2 / r**2 * omega - m_C * d * product
    velocity = jnp.array([v * axis[0], v * axis[1], omega, force / mass, torque / inertia])
    following = jnp.concatenate([state[:PLANT] + h * velocity, jnp.maximum(theta + h * gamma * direction, lower)])
    return following, e, jnp.array([total + difference, total - difference]) / 2.0, regular


@jax.jit
def _log(p, start, times):
    def scanned(state, t):
        following, e, u, regular = step(p, t, state)
        return following, (jnp.concatenate([state[:PLANT], u, e, state[PLANT:]]), regular)

    _, (rows, regular) = jax.lax.scan(scanned, start, times)
    return rows, regular.all()


@jax.jit
def _summarize(parameters, starts, times):
    def each(p, start):
        def advanced(k, carried):
            state, squares, all_regular = carried
            following, e, _, regular = step(p, times[k], state)
            return following, squares + e * e, all_regular & regular

        return jax.lax.fori_loop(0, len(times), advanced, (start, jnp.zeros(2), True))

    return jax.vmap(each)(parameters, starts)


def one(work: Work) -> Callable[[], Numbers]:
    """The first robot."""
    parameters, start, times = numbers(work)[0], work.states()[0], work.times

    def run() -> Numbers:
        rows, regular = _log(parameters, start, times)
        if not regular:
            raise ArithmeticError("the run was lost")
        return np.asarray(rows)

    return run


def many(work: Work) -> Callable[[], Summary]:
    """All robots in lockstep."""
    parameters, starts, times = numbers(work), work.states(), work.times

    def run() -> Summary:
        states, squares, regular = _summarize(parameters, starts, times)
        if not regular.all():
            raise ArithmeticError("a run was lost")
        return Summary(np.asarray(states)[:, :PLANT], np.sqrt(np.asarray(squares) / len(times)))

    return run
