"""Seed and budget of every fuzz test, read here and nowhere else; `tests/fuzz.py` sets them for long searches."""

from __future__ import annotations

import os
import random
from collections.abc import Callable
from typing import Any

from hypothesis import HealthCheck, Phase, seed, settings

TIMES = int(os.environ.get("WMR_AFL_FUZZ", "1"))  # how many times the budget of the suite
SEED = int(os.environ.get("WMR_AFL_FUZZ_SEED", "0"))  # that of the suite is 0


def budget(rounds: int) -> int:
    """How many rounds to try, where the suite tries `rounds`."""
    return rounds * TIMES


def stream(name: str = "") -> random.Random:
    """The random numbers of this seed; each name has its own."""
    return random.Random(f"{SEED} {name}")  # noqa: S311


def short(examples: int) -> Callable[[Callable[..., Any]], Callable[..., Any]]:
    """As many examples of Hypothesis as the budget allows, the same in every run with this seed.

    Add Phase.shrink to look for the smallest one that fails; it may take minutes.
    """
    chosen = settings(
        max_examples=budget(examples),
        deadline=None,
        database=None,
        phases=[Phase.explicit, Phase.generate],
        suppress_health_check=[HealthCheck.too_slow, HealthCheck.data_too_large],
    )
    return lambda test: seed(SEED)(chosen(test))
