"""Timing on a noisy machine: contenders take turns, and the best of many turns counts."""

from __future__ import annotations

import time
from collections.abc import Callable, Mapping


def best_times(
    contenders: Mapping[str, Callable[[], object]], seconds: float = 0.5, turns: int = 15
) -> dict[str, float]:
    """Seconds of one call of each contender."""
    calls = {}
    for name, call in contenders.items():  # how many calls fill one turn
        start = time.perf_counter()
        call()
        once = time.perf_counter() - start
        calls[name] = max(1, int(seconds / turns / max(once, 1e-7)))
    best = dict.fromkeys(contenders, float("inf"))
    for _ in range(turns):
        for name, call in contenders.items():
            start = time.perf_counter()
            for _ in range(calls[name]):
                call()
            best[name] = min(best[name], (time.perf_counter() - start) / calls[name])
    return best
