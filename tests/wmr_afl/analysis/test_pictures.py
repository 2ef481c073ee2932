"""Which samples of a run the pictures of an animation show."""

from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest

from wmr_afl.analysis.animation import _rows


@pytest.mark.parametrize(("speed", "samples"), [(1.0, [0, 2, 4, 6, 8, 10]), (2.0, [0, 4, 8]), (0.5, list(range(11)))])
def test_pictures_show_the_samples_of_their_times(speed: float, samples: list[int]) -> None:
    """Five pictures a second of a run of one second, at its speed, twice and half of it."""
    run: Any = SimpleNamespace(time=0.1 * np.arange(11), failure=None)
    assert _rows(run, 5, speed).tolist() == samples
