"""What a run of a campaign draws: it depends on the campaign's seed and on the run's index, on nothing else."""

from __future__ import annotations

from collections.abc import Iterator
from zlib import crc32

import numpy as np
from numpy.typing import NDArray

from wmr_afl.schema.campaign import CampaignTable, Distribution

Numbers = NDArray[np.float64]

BLOCK = 1024  # runs; each block of each quantity has a stream of its own
PLACES = ("parameters", "start", "gains", "scale")


def quantities(table: CampaignTable) -> Iterator[tuple[str, str, Distribution]]:
    """Place, name and distribution of all that is drawn."""
    for place in PLACES:
        for name, distribution in getattr(table, place).items():
            yield place, name, distribution


def draws(table: CampaignTable, block: int, count: int) -> dict[str, Numbers]:
    """The numbers that the first `count` runs of a block draw, by "place.name", (count,) each."""
    return {
        f"{place}.{name}": draw(distribution, _stream(table.seed, block, f"{place}.{name}"))[:count]
        for place, name, distribution in quantities(table)
    }


def noise_seeds(table: CampaignTable, block: int, count: int) -> NDArray[np.int64]:
    """Seeds of the measurement noise of each run, (count,)."""
    return _stream(table.seed, block, "noise").integers(2**62, size=BLOCK)[:count]


def draw(distribution: Distribution, stream: np.random.Generator) -> Numbers:
    """One number for every run of a block, (BLOCK,)."""
    if distribution.uniform is not None:
        low, high = distribution.uniform
        return low + (high - low) * stream.random(BLOCK)
    if distribution.log_uniform is not None:
        low, high = np.log(distribution.log_uniform)
        return np.exp(low + (high - low) * stream.random(BLOCK))
    if distribution.normal is not None:
        mean, deviation = distribution.normal
        return mean + deviation * stream.standard_normal(BLOCK)
    values = np.asarray(distribution.choice, dtype=float)
    return values[stream.integers(len(values), size=BLOCK)]


def _stream(seed: int, block: int, quantity: str) -> np.random.Generator:
    """A stream for each block and quantity, so that a new quantity changes none of the others."""
    return np.random.Generator(np.random.Philox(np.random.SeedSequence([seed, block, crc32(quantity.encode())])))
