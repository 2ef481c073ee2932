"""The buffer of setpoints in C, called in this process: it gives what Python's gives, and refuses what that refuses."""

import ctypes

import numpy as np
import pytest

from tests.wmr_afl.onboard.test_c_text import sampled_of
from wmr_afl.controllers.live_reference import BufferState, ReferenceBuffer
from wmr_afl.experiments.load import load_experiment
from wmr_afl.numerics.arrays import Floats
from wmr_afl.onboard.export import export
from wmr_afl.simulation.kernels.c_compiler import compiler, library

pytestmark = pytest.mark.skipif(compiler() is None, reason="there is no C compiler")

STATES = [BufferState.EMPTY, BufferState.FRESH, BufferState.HOLDING, BufferState.STOPPING, BufferState.STOPPED]


class Buffer:
    """With a timeout and a stop [us]; setpoints are rows of yr, yr', yr''."""

    def __init__(self, timeout: int, stop: int, is_single: bool = False) -> None:
        files = {**export("study_1", "AFL", is_unlimited=True, has_reference=False, samples=1, is_single=is_single)}
        texts = [str(files[name]) for name in ("controller.h", "controller_buffer.h", "controller_buffer.c")]
        self.library = library(
            "\n".join(line for text in texts for line in text.split("\n") if 'include "' not in line)
        )
        self.type, self.room = np.float32 if is_single else np.float64, np.zeros(100_000)
        self.place = ctypes.c_void_p(self.room.ctypes.data)
        self.library.controller_buffer_init(self.place, ctypes.c_uint32(timeout), ctypes.c_uint32(stop))

    def push(self, t: int, setpoint: Floats) -> int:
        given = np.ascontiguousarray(setpoint, self.type)
        return int(
            self.library.controller_buffer_push(self.place, ctypes.c_uint32(t), ctypes.c_void_p(given.ctypes.data))
        )

    def at(self, t: int) -> tuple[int, Floats]:
        found = np.full((3, 2), 99.0, self.type)
        status = self.library.controller_buffer_at(self.place, ctypes.c_uint32(t), ctypes.c_void_p(found.ctypes.data))
        return int(status), found.astype(float)


@pytest.mark.parametrize("is_single", [False, True])
@pytest.mark.parametrize("start", [0, 2**32 - 700_000], ids=["from zero", "over the clock's end"])
def test_it_gives_what_pythons_gives(start: int, is_single: bool) -> None:
    """Between points, holding, stopping, stopped; also while the clock begins again."""
    buffer, random = Buffer(400_000, 800_000, is_single), np.random.default_rng(3)
    python = ReferenceBuffer(["y1", "y2"], timeout=0.4, stop=0.8, room=64)
    seen, tolerance = set(), 2e-3 if is_single else 1e-9
    for k in range(300):
        us = 10_000 * k
        if k % 10 == 0 and k <= 120:
            setpoint = random.normal(size=(3, 2)).round(3)
            assert buffer.push((start + us + 150_000) % 2**32, setpoint) == 0
            python.push(1e-6 * (us + 150_000), *setpoint)
        status, found = buffer.at((start + us + 3) % 2**32)
        expected = np.array(python.at(1e-6 * (us + 3)))
        assert STATES[status] == python.state
        np.testing.assert_allclose(found, expected, rtol=tolerance, atol=10.0 * tolerance)
        seen.add(status)
    assert seen == {1, 2, 3, 4}


def test_what_is_not_later_not_finite_or_too_much_is_refused() -> None:
    """An empty buffer is told as such; after a stop nothing is taken until it resumes."""
    buffer, good = Buffer(1000, 2000), np.array([[0.1, 0.3], [0.2, 0.4], [0.0, 0.0]])
    assert buffer.at(0)[0] == 0
    assert [buffer.push(t, good) for t in (1000, 1000, 999, 2000)] == [0, 2, 2, 0]
    for place in range(3):
        bad = good.copy()
        bad[place, 1] = np.nan
        assert buffer.push(3000, bad) == 1
    codes = {buffer.push(3000 + i, good) for i in range(200)}
    assert codes == {0, 3}  # there is room for some
    assert buffer.at(900_000)[0] == 4
    assert buffer.push(950_000, good) == 4
    buffer.library.controller_buffer_resume(buffer.place)
    assert buffer.push(950_000, good) == 0
    assert buffer.at(950_000)[0] == 1


def test_the_replay_looks_at_the_estimates_in_their_places() -> None:
    """All of them, from the first one on; numbers as precise as the law."""
    sampled = sampled_of("study_2_pose", "pose")
    place = sampled.states.places["theta_hat"]
    for is_single in (False, True):
        text = str(export("study_2_pose", "pose", samples=1, is_single=is_single)["main.c"])
        assert f"&other.z[{place.start}], &state->z[{place.start}], {place.stop - place.start}u" in text
    assert load_experiment("study_2_pose").loops["pose"].law.adapts
