"""Type (2,0) in NumPy as an engineer would write it from the paper: the yardstick for generated code."""

import numpy as np


def state_derivative(x, u, w, p):
    phi, v, omega = x[..., 2], x[..., 3], x[..., 4]
    r, b, d = p[..., 0], p[..., 1], p[..., 2]
    m_C, m_w, I_m, I_C, K1, K2 = (p[..., i] for i in range(4, 10))
    m = m_C + 2 * m_w
    inertia = I_C + 2 * I_m + m_C * d**2 + 2 * m_w * b**2
    force = K1 / r * (u[..., 0] + u[..., 1]) - 2 * K2 / r**2 * v + m_C * d * omega**2 - w[..., 0]
    torque = (
        K1 * b / r * (u[..., 0] - u[..., 1]) - 2 * K2 * b**2 / r**2 * omega - m_C * d * v * omega - w[..., 1]
    )  # fmt: skip
    out = np.empty((*np.broadcast_shapes(x.shape[:-1], u.shape[:-1], w.shape[:-1], p.shape[:-1]), 5))
    out[..., 0] = np.cos(phi) * v
    out[..., 1] = np.sin(phi) * v
    out[..., 2] = omega
    out[..., 3] = force / m
    out[..., 4] = torque / inertia
    return out


def lie_f2_h(x, c):
    phi, v, omega, L = x[..., 2], x[..., 3], x[..., 4], c[..., 0]
    sin, cos = np.sin(phi), np.cos(phi)
    out = np.empty((*np.broadcast_shapes(x.shape[:-1], c.shape[:-1]), 2))
    out[..., 0] = -v * omega * sin - L * omega**2 * cos
    out[..., 1] = v * omega * cos - L * omega**2 * sin
    return out


def lie_q_lie_f_h(x, theta, c):
    phi, v, omega, L = x[..., 2], x[..., 3], x[..., 4], c[..., 0]
    t1, t2, t3, t4 = (theta[..., i] for i in range(4))
    sin, cos = np.sin(phi), np.cos(phi)
    v_drift = -t1 * v + t2 * omega**2
    omega_drift = -t3 * omega - t4 * v * omega
    out = np.empty((*np.broadcast_shapes(x.shape[:-1], theta.shape[:-1], c.shape[:-1]), 2))
    out[..., 0] = cos * v_drift - L * sin * omega_drift
    out[..., 1] = sin * v_drift + L * cos * omega_drift
    return out


def decoupling_matrix(x, theta, c):
    phi, L, t5, t6 = x[..., 2], c[..., 0], theta[..., 4], theta[..., 5]
    sin, cos = np.sin(phi), np.cos(phi)
    out = np.empty((*np.broadcast_shapes(x.shape[:-1], theta.shape[:-1], c.shape[:-1]), 2, 2))
    out[..., 0, 0] = cos * t5 - L * sin * t6
    out[..., 0, 1] = cos * t5 + L * sin * t6
    out[..., 1, 0] = sin * t5 + L * cos * t6
    out[..., 1, 1] = sin * t5 - L * cos * t6
    return out


def regressor(x, u, c):
    phi, v, omega, L = x[..., 2], x[..., 3], x[..., 4], c[..., 0]
    sin, cos = np.sin(phi), np.cos(phi)
    total, difference = u[..., 0] + u[..., 1], u[..., 0] - u[..., 1]
    out = np.empty((*np.broadcast_shapes(x.shape[:-1], u.shape[:-1], c.shape[:-1]), 2, 6))
    out[..., 0, 0] = -v * cos
    out[..., 0, 1] = omega**2 * cos
    out[..., 0, 2] = omega * L * sin
    out[..., 0, 3] = omega * v * L * sin
    out[..., 0, 4] = total * cos
    out[..., 0, 5] = -difference * L * sin
    out[..., 1, 0] = -v * sin
    out[..., 1, 1] = omega**2 * sin
    out[..., 1, 2] = -omega * L * cos
    out[..., 1, 3] = -omega * v * L * cos
    out[..., 1, 4] = total * sin
    out[..., 1, 5] = difference * L * cos
    return out
