"""Numba: loops over robots and samples in plain Python, compiled; what a step needs is held in tuples of numbers."""

from __future__ import annotations

from collections.abc import Callable
from math import cos, sin

import numba
import numpy as np
from numba.np.unsafe.ndarray import to_fixed_tuple

from benchmarks.contenders.study_1 import ERRORS, PLANT, SIGNALS, SINGULAR, STATES, numbers
from benchmarks.contenders.work import Numbers, Summary, Work

COUNT = 33  # numbers of a robot

compiled = numba.njit(error_model="numpy", inline="always")


@compiled
def step(p, t, state):
    """One sample: the next state, voltages, errors, and whether Dhat is regular."""
    r, b, d, L, m_C, m_w, I_m, I_C, K1, K2 = p[:10]
    x, y, phi, v, omega, t1, t2, t3, t4, t5, t6 = state
    center0, center1, radius, rate, h = p[28:]
    s, c = sin(phi), cos(phi)
    along, across = radius * cos(rate * t), radius * sin(rate * t)
    e0, e1 = x + L * c - center0 - along, y + L * s - center1 - across
    rate0, rate1 = v * c - L * omega * s + rate * across, v * s + L * omega * c - rate * along
    eta0 = -rate * rate * along - p[10] * rate0 - p[12] * e0
    eta1 = -rate * rate * across - p[11] * rate1 - p[13] * e1
    filtered0, filtered1 = rate0 + p[14] * e0, rate1 + p[15] * e1
    # in the robot's frame Dhat is diagonal
    square, product = omega * omega, omega * v
    total = (c * eta0 + s * eta1 + L * square + t1 * v - t2 * square) / t5
    difference = (c * eta1 - s * eta0 - product + L * (t3 * omega + t4 * product)) / (L * t6)
    a, a_side = t5 * t5, (L * t6) ** 2
    regular = a * a_side >= (SINGULAR * (a - a_side) * c * s) ** 2
    forward, sideways = c * filtered0 + s * filtered1, L * (c * filtered1 - s * filtered0)
    mass = m_C + 2.0 * m_w
    inertia = I_C + 2.0 * I_m + m_C * d * d + 2.0 * m_w * b * b
    thrust, turn, drag = h * K1 / (r * mass), h * K1 * b / (r * inertia), h * 2.0 * K2 / (r * r)
    following = (
        x + h * v * c,
        y + h * v * s,
        phi + h * omega,
        v + thrust * total - drag / mass * v + h * m_C * d / mass * square,
        omega + turn * difference - drag * b * b / inertia * omega - h * m_C * d / inertia * product,
        max(t1 - h * p[16] * v * forward, p[22]),
        max(t2 + h * p[17] * square * forward, p[23]),
        max(t3 - h * p[18] * omega * sideways, p[24]),
        max(t4 - h * p[19] * product * sideways, p[25]),
        max(t5 + h * p[20] * total * forward, p[26]),
        max(t6 + h * p[21] * difference * sideways, p[27]),
    )
    return following, (0.5 * (total + difference), 0.5 * (total - difference), e0, e1), regular


@numba.njit(error_model="numpy")
def run_one(parameters, start, rows):
    """Logs every sample."""
    p, state = to_fixed_tuple(parameters, COUNT), to_fixed_tuple(start, STATES)
    all_regular = True
    for k in range(len(rows)):
        following, (u0, u1, e0, e1), regular = step(p, k * p[COUNT - 1], state)
        row = rows[k]
        row[0], row[1], row[2], row[3], row[4] = state[:5]
        row[5], row[6], row[7], row[8] = u0, u1, e0, e1
        row[9], row[10], row[11], row[12], row[13], row[14] = state[5:]
        state = following
        all_regular &= regular
    return all_regular


@numba.njit(error_model="numpy")
def run_all(parameters, starts, count, final, squares):
    """Robot after robot; squares are summed."""
    all_regular = True
    for i in range(len(starts)):
        p, state = to_fixed_tuple(parameters[i], COUNT), to_fixed_tuple(starts[i], STATES)
        square0, square1 = 0.0, 0.0
        for k in range(count):
            state, (_, _, e0, e1), regular = step(p, k * p[COUNT - 1], state)
            square0 += e0 * e0
            square1 += e1 * e1
            all_regular &= regular
        final[i, 0], final[i, 1], final[i, 2], final[i, 3], final[i, 4] = state[:5]
        squares[i, 0], squares[i, 1] = square0, square1
    return all_regular


def one(work: Work) -> Callable[[], Numbers]:
    """The first robot."""
    parameters, start, count = numbers(work)[0], work.states()[0], len(work.times)

    def run() -> Numbers:
        rows = np.empty((count, SIGNALS))
        if not run_one(parameters, start, rows):
            raise ArithmeticError("the run was lost")
        return rows

    return run


def many(work: Work) -> Callable[[], Summary]:
    """Robot after robot."""
    parameters, starts, count = numbers(work), work.states(), len(work.times)

    def run() -> Summary:
        final, squares = np.empty((len(starts), PLANT)), np.empty((len(starts), ERRORS))
        if not run_all(parameters, starts, count, final, squares):
            raise ArithmeticError("a run was lost")
        return Summary(final, np.sqrt(squares / count))

    return run
