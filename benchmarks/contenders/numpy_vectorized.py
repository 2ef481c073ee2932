"""NumPy by hand: all robots at once, one array a quantity, overwritten where it can be."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np

from benchmarks.contenders.study_1 import SINGULAR, numbers
from benchmarks.contenders.work import Summary, Work


def many(work: Work) -> Callable[[], Summary]:
    """All robots in lockstep, the same gains for all."""
    parameters, start, times = numbers(work), work.states(), work.times

    def run() -> Summary:
        r, b, d, L, m_C, m_w, I_m, I_C, K1, K2 = parameters[:, :10].T.copy()
        b1, b2, alpha = parameters[0, 10:16].reshape(3, 2, 1)
        gamma, lower = parameters[0, 16:28].reshape(2, 6, 1)
        center, (radius, rate, h) = parameters[0, 28:30, None], parameters[0, 30:]
        mass = m_C + 2.0 * m_w
        inertia = I_C + 2.0 * I_m + m_C * d**2 + 2.0 * m_w * b**2
        thrust, drag, pull = h * K1 / (r * mass), h * 2.0 * K2 / (r**2 * mass), h * m_C * d / mass
        turn, brake, twist = h * K1 * b / (r * inertia), h * 2.0 * K2 * b**2 / (r**2 * inertia), h * m_C * d / inertia
        gain = h * gamma
        state = start.T.copy()
        position, (phi, v, omega), theta = state[:2], state[2:5], state[5:]
        t1, t2, t3, t4, t5, t6 = theta
        axis, normal, e, e_dot, spare = (np.empty_like(position) for _ in range(5))
        direction, squares = np.empty_like(theta), np.zeros_like(position)
        cos, sin = axis
        lost = np.zeros(work.robots, dtype=bool)
        for t in times:
            along, across = np.cos(rate * t), np.sin(rate * t)
            circle = np.array([[radius * along], [radius * across]])
            moving = np.array([[-radius * rate * across], [radius * rate * along]])
            np.cos(phi, out=cos)
            np.sin(phi, out=sin)
            np.negative(sin, out=normal[0])
            normal[1] = cos
            ahead = L * omega
            # the output's error and its rate, the filtered error, and the wanted acceleration
            np.multiply(axis, L, out=e)
            e += position
            e -= center + circle
            np.multiply(axis, v, out=e_dot)
            np.multiply(normal, ahead, out=spare)
            e_dot += spare
            e_dot -= moving
            filtered = alpha * e
            filtered += e_dot
            eta = -(rate**2) * circle - b1 * e_dot
            np.multiply(e, b2, out=spare)
            eta -= spare
            # in the robot's frame Dhat is diagonal
            square, product = omega * omega, omega * v
            total = (cos * eta[0] + sin * eta[1] + L * square + t1 * v - t2 * square) / t5
            difference = (cos * eta[1] - sin * eta[0] - product + L * (t3 * omega + t4 * product)) / (L * t6)
            forward, sideways = cos * filtered[0] + sin * filtered[1], L * (cos * filtered[1] - sin * filtered[0])
            a, a_side = t5 * t5, (L * t6) ** 2
            lost |= ~(a * a_side >= (SINGULAR * (a - a_side) * cos * sin) ** 2)
            np.multiply(e, e, out=spare)
            squares += spare
            np.multiply(forward, v, out=direction[0])
            np.negative(direction[0], out=direction[0])
            np.multiply(forward, square, out=direction[1])
            np.multiply(sideways, -omega, out=direction[2])
            np.multiply(direction[2], v, out=direction[3])
            np.multiply(forward, total, out=direction[4])
            np.multiply(sideways, difference, out=direction[5])
            direction *= gain
            theta += direction
            np.maximum(theta, lower, out=theta)
            np.multiply(axis, h * v, out=spare)
            position += spare
            phi += h * omega
            v += thrust * total - drag * v + pull * square
            omega += turn * difference - brake * omega - twist * product
        if lost.any():
            raise ArithmeticError("a run was lost")
        return Summary(state[:5].T, np.sqrt(squares / len(times)).T)

    return run
