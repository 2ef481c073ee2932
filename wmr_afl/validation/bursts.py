"""Accelerations at random states: what the model says, beside the slope of v over some microseconds in the engine."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from wmr_afl.numerics.arrays import Floats
from wmr_afl.validation.engine import SLIPS, Engine
from wmr_afl.validation.mechanism import Mechanism
from wmr_afl.validation.mjcf import Contact, ample_friction
from wmr_afl.validation.voltages import Waves

STEP = 1e-6  # [s]
STEPS = 30  # before the slope is taken, and as many while it is
SLOW = 2e-3  # [s], time constant of the vertical
LIGHT = 1e-6  # of the robot's mass, for what has none
SPEED = 0.7  # standard deviation of pseudo-velocities [m/s, rad/s]
TURN = 1.0  # of coordinates, to both sides [m, rad]
HARD = 1.5  # times the voltages of a run


@dataclass(frozen=True)
class Bursts:
    """Of all pseudo-velocities, over the root mean square of each acceleration."""

    rms: Floats  # (n-m,)
    worst: Floats  # (n-m,)
    count: int
    slipped: int  # left out: more friction was needed than there is


def bursts(mechanism: Mechanism, other: Mechanism | None = None, count: int = 200, seed: int = 1) -> Bursts:
    """The model of `mechanism` against the engine's robot of `other` (the same unless given)."""
    model, p, random = mechanism.model, mechanism.p, np.random.default_rng(seed)
    n, n_v = model.coordinate_count, model.pseudo_velocity_count
    built = other or mechanism
    contact = Contact(STEP, ample_friction(mechanism), SLOW, LIGHT)
    engine = Engine(built, contact, built.loads(np.zeros(n)))
    volts = HARD * Waves.of(mechanism).largest
    errors, sizes, slipped = [], [], 0
    for _ in range(count):
        q, v = random.uniform(-TURN, TURN, n), random.normal(0.0, SPEED, n_v)
        u = random.uniform(-1.0, 1.0, len(volts)) * volts
        engine.start(q, np.asarray(model.kinematic_matrix(q, p)) @ v)
        seen = []
        for _ in range(2):
            engine.drive(u, STEPS)
            seen.append(engine.state)
        if np.any(engine.grip.friction > SLIPS * contact.friction):
            slipped += 1
            continue
        slope = (seen[1] - seen[0])[n:] / (STEPS * STEP)
        told = np.asarray(model.state_derivative(0.5 * (seen[0] + seen[1]), u, np.zeros(n_v), p))[n:]
        errors.append(slope - told)
        sizes.append(told)
    if not errors:
        nothing = np.full(n_v, np.nan)
        return Bursts(nothing, nothing, count, slipped)
    size = np.sqrt(np.mean(np.square(sizes), axis=0))
    return Bursts(np.sqrt(np.mean(np.square(errors), axis=0)) / size, np.abs(errors).max(axis=0) / size, count, slipped)
