"""A robot under setpoints that a planner streams: as good as the formula, and gentle when the stream ends."""

import numpy as np
import pytest

from wmr_afl import Controller
from wmr_afl.controllers.live_reference import BufferState, LiveReference, ReferenceBuffer
from wmr_afl.experiments.load import load_experiment
from wmr_afl.numerics.arrays import Floats
from wmr_afl.numerics.parts import by_part

SETTLED, CUT, END = 40.0, 60.0, 70.0  # [s]


def streamed(hertz: float) -> tuple[Floats, Floats, Floats, list[BufferState]]:
    """Times, errors, voltages and states of the buffer of study 1, two points ahead until the stream is cut."""
    loop = load_experiment("study_1").loops["AFL"]
    outputs = list(loop.model.output_units)
    controller = Controller(loop.model, loop.law, LiveReference(outputs), loop.sample_time)
    buffer = ReferenceBuffer(outputs, timeout=0.5, stop=5.0)
    model, values, state = loop.model.in_library("numpy"), by_part(loop.values), dict(loop.plant.states)
    pushed, times, errors, volts, states = 0, [], [], [], []
    for k in range(round(END / loop.sample_time)):
        t = k * loop.sample_time
        while pushed / hertz <= t + 2.0 / hertz and pushed / hertz <= CUT:
            now = loop.reference.at(pushed / hertz)
            buffer.push(pushed / hertz, now.position, now.velocity, now.acceleration)
            pushed += 1
        u = controller.update(t, state["x"], buffer)
        errors.append(controller.diagnostics.error)
        times.append(t)
        volts.append(u)
        states.append(buffer.state)
        state |= loop.plant.update(t, u, by_part(state), values, model, loop.sample_time)
    return np.array(times), np.array(errors), np.array(volts), states


def by_formula() -> Floats:
    """Root mean square of the same run's settled error under the formula."""
    loop = load_experiment("study_1").loops["AFL"]
    controller = Controller(loop.model, loop.law, loop.reference, loop.sample_time)
    model, values, state = loop.model.in_library("numpy"), by_part(loop.values), dict(loop.plant.states)
    errors = []
    for k in range(round(CUT / loop.sample_time)):
        u = controller.update(k * loop.sample_time, state["x"])
        errors.append(controller.diagnostics.error)
        state |= loop.plant.update(0.0, u, by_part(state), values, model, loop.sample_time)
    return np.sqrt(np.mean(np.array(errors)[round(SETTLED / loop.sample_time) :] ** 2))


@pytest.mark.parametrize("hertz", [50.0, 10.0, 1.0])
def test_a_stream_tracks_like_the_formula_and_its_end_is_gentle(hertz: float) -> None:
    """Two points ahead; after the cut the robot comes to rest with less than two volts."""
    times, errors, volts, states = streamed(hertz)
    settled = (times >= SETTLED) & (times < CUT)
    assert np.sqrt(np.mean(errors[settled] ** 2)) == pytest.approx(by_formula(), rel=0.02)
    assert np.abs(volts[times >= CUT]).max() < 2.0
    assert np.abs(volts[-1]).max() < 0.05
    order = [BufferState.FRESH, BufferState.HOLDING, BufferState.STOPPING, BufferState.STOPPED]
    assert [one for k, one in enumerate(states) if k == 0 or states[k - 1] is not one] == order
