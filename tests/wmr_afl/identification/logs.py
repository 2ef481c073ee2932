"""Logs of robots that are known: simulated in base parameters under voltages of several frequencies."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path

import numpy as np

from wmr_afl.identification.effort import Effort
from wmr_afl.identification.log import Log, log_of
from wmr_afl.identification.log_file import write_log
from wmr_afl.identification.simulated import Simulated
from wmr_afl.model.model import load_model
from wmr_afl.numerics.arrays import Floats

STEP = 0.02  # [s]
SMALL = {"m_C": 12.0, "m_w": 0.8, "I_m": 1e-3, "I_C": 0.45, "K1": 0.35, "K2": 0.42, "r": 0.076, "b": 0.28, "d": 0.06}
GEOMETRY = {name: SMALL[name] for name in ("r", "b")}
FRICTION = 0.4  # [V]
FREQUENCIES = np.array([0.11, 0.23, 0.41, 0.67, 1.05, 1.6])  # [Hz]


def effort_of(robot: str, **parameters: float) -> Effort:
    model = load_model(robot)
    return Effort(model, model.parameters(**parameters))


def multisine(seconds: float, inputs: int, amplitude: float, seed: int = 1) -> Floats:
    """Voltages (T, inputs), which begin with zero."""
    t, random = STEP * np.arange(round(seconds / STEP)), np.random.default_rng(seed)
    phases = random.uniform(0.0, 2.0 * np.pi, (inputs, len(FREQUENCIES)))
    waves = np.sin(2.0 * np.pi * FREQUENCIES * t[:, None, None] + phases).mean(axis=2)
    return np.asarray(amplitude * 2.0 * waves * np.minimum(t, 1.0)[:, None])


def logged(effort: Effort, u: Floats, friction: float = FRICTION, counts: int = 2048, segment: str = "") -> Log:
    """What the encoders of all motors say of a motion from rest under u (T, n_u), in whole counts of a turn."""
    unknown = np.concatenate([effort.base(effort.p), np.full(len(effort.friction_groups), friction)])
    x0 = np.zeros((1, effort.n + effort.n_v))
    states = Simulated(effort, STEP).states(unknown[None], x0, u[None])[:-1, :, 0]
    quantum = 2.0 * np.pi / counts
    angles = quantum * np.round(states[:, effort.n + effort.n_v :] / quantum)
    motors = list(effort.model.input_units)
    measured = {f"angle:{name}": column for name, column in zip(motors, angles.T, strict=True)}
    return log_of(effort.model, STEP * np.arange(len(u)), u, measured, [segment] * len(u))


def small_drive(seconds: float = 20.0, segment: str = "") -> Log:
    """A differential drive of 14 kg under up to about 8 V."""
    return logged(effort_of("type_2_0", **SMALL), multisine(seconds, 2, 8.0), segment=segment)


def write(log: Log, path: Path, change: Callable[[list[list[str]]], None] | None = None) -> Path:
    """The log as a CSV file, its cells (header first) changed."""
    write_log(log, path)
    rows = [line.split(",") for line in path.read_text().splitlines()]
    if change is not None:
        change(rows)
    path.write_text("\n".join(",".join(row) for row in rows) + "\n")
    return path
