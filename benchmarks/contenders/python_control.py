"""python-control: the sampled loop as a nonlinear system in discrete time, its step in plain Python numbers."""

from __future__ import annotations

from collections.abc import Callable
from math import cos, sin

import control

from benchmarks.contenders.study_1 import SIGNALS, SINGULAR, STATES, numbers
from benchmarks.contenders.work import Numbers, Work


def one(work: Work) -> Callable[[], Numbers]:
    """The first robot, driven by time alone."""
    p, start, times = numbers(work)[0].tolist(), work.states()[0], work.times

    def update(t, state, u, params):
        return step(p, t, *state.tolist())[0]

    def output(t, state, u, params):
        return step(p, t, *state.tolist())[1]

    system = control.nlsys(update, output, inputs=1, outputs=SIGNALS, states=STATES, dt=p[-1])

    def run() -> Numbers:
        return control.input_output_response(system, times, 0.0, start).outputs.T

    return run


def step(
    p: list[float], t: float, x: float, y: float, phi: float, v: float, omega: float, *theta: float
) -> tuple[list[float], list[float]]:
    """One sample: the next state, and the signals now."""
    r, b, d, L, m_C, m_w, I_m, I_C, K1, K2 = p[:10]
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
    t1, t2, t3, t4, t5, t6 = theta
    total = (c * eta0 + s * eta1 + L * square + t1 * v - t2 * square) / t5
    difference = (c * eta1 - s * eta0 - product + L * (t3 * omega + t4 * product)) / (L * t6)
    a, a_side = t5 * t5, (L * t6) ** 2
    if not a * a_side >= (SINGULAR * (a - a_side) * c * s) ** 2:
        raise ArithmeticError("the run was lost")
    forward, sideways = c * filtered0 + s * filtered1, L * (c * filtered1 - s * filtered0)
    moves = (
        -v * forward, square * forward, -omega * sideways, -product * sideways, total * forward, difference * sideways,
    )  # fmt: skip
    mass = m_C + 2.0 * m_w
    inertia = I_C + 2.0 * I_m + m_C * d * d + 2.0 * m_w * b * b
    force = K1 / r * total - 2.0 * K2 / (r * r) * v + m_C * d * square
    torque = K1 * b / r * difference - 2.0 * K2 * b * b / (r * r) * omega - m_C * d * product
    adapted = [
        max(value + h * gain * move, low)
        for value, gain, move, low in zip(theta, p[16:22], moves, p[22:28], strict=True)
    ]
    following = [
        x + h * v * c, y + h * v * s, phi + h * omega, v + h * force / mass, omega + h * torque / inertia, *adapted,
    ]  # fmt: skip
    signals = [x, y, phi, v, omega, 0.5 * (total + difference), 0.5 * (total - difference), e0, e1, *theta]
    return following, signals
