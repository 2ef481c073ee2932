"""Tables of a campaign: what is drawn for each run, and what counts as success; and the draws themselves."""

from __future__ import annotations

from collections.abc import Iterator
from typing import Annotated
from zlib import crc32

import numpy as np
from numpy.typing import NDArray
from pydantic import Field, model_validator

from wmr_afl.numerics.arrays import Floats
from wmr_input.errors import FieldError
from wmr_input.fields import Names, NotNegative, Number, Positive, Table

BLOCK = 1024  # runs; each block draws each quantity from its own stream, so that blocks can be run in any order
PLACES = ("parameters", "start", "gains", "scale")  # tables of [campaign] that hold distributions
Pair = Annotated[list[Number], Field(min_length=2, max_length=2)]


class Distribution(Table):
    """The distribution of one number; exactly one kind is given."""

    uniform: Pair | None = None  # low, high
    log_uniform: Pair | None = None  # low, high, both positive: every factor is as likely as any other
    normal: Pair | None = None  # mean, standard deviation
    choice: Annotated[list[Number], Field(min_length=1)] | None = None  # each as likely as any other

    @model_validator(mode="after")
    def _one_that_can_be_drawn(self) -> Distribution:
        given = [kind for kind, numbers in vars(self).items() if numbers is not None]
        if len(given) != 1:
            kinds = ", ".join(type(self).model_fields)
            raise FieldError(f"names {' and '.join(given) or 'no distribution'}", f"give exactly one of {kinds}")
        for low, high in (pair for pair in (self.uniform, self.log_uniform) if pair is not None):
            if low >= high:
                raise FieldError(f"the range from {low:g} to {high:g} is empty", "give [low, high]")
        if self.log_uniform is not None and self.log_uniform[0] <= 0.0:
            raise FieldError(f"log_uniform from {self.log_uniform[0]:g}", "give a range above zero")
        if self.normal is not None and self.normal[1] <= 0.0:
            raise FieldError(f"a deviation of {self.normal[1]:g}", "give normal = [mean, deviation] with deviation > 0")
        return self


class SuccessTable(Table):
    """Bounds that a run must keep in every entry, besides not failing."""

    rms: Positive | None = None  # of the tracking error, [m] or the output's unit
    largest_error: Positive | None = None
    largest_input: Positive | None = None  # [V]


class CampaignTable(Table):
    """Many runs of one controller, the first unless named, or of several; errors count from `since` [s] on."""

    controller: Names | None = None
    seed: Annotated[int, Field(ge=0)] = 0
    since: NotNegative = 0.0
    parameters: dict[str, Distribution] = Field(default_factory=dict)  # physical
    start: dict[str, Distribution] = Field(default_factory=dict)  # states
    gains: dict[str, Distribution] = Field(default_factory=dict)  # the same number in every entry
    scale: dict[str, Distribution] = Field(default_factory=dict)  # a factor on a physical parameter or a gain
    success: SuccessTable = SuccessTable()


def quantities(table: CampaignTable) -> Iterator[tuple[str, str, Distribution]]:
    """Place, name and distribution of all that is drawn."""
    for place in PLACES:
        for name, distribution in getattr(table, place).items():
            yield place, name, distribution


def draws(table: CampaignTable, block: int, count: int) -> dict[str, Floats]:
    """The numbers that the first `count` runs of a block draw, by "place.name", (count,) each."""
    return {
        f"{place}.{name}": draw(distribution, _stream(table.seed, block, f"{place}.{name}"))[:count]
        for place, name, distribution in quantities(table)
    }


def noise_seeds(table: CampaignTable, block: int, count: int) -> NDArray[np.int64]:
    """Seeds of the measurement noise of each run, (count,)."""
    return _stream(table.seed, block, "noise").integers(2**62, size=BLOCK)[:count]


def draw(distribution: Distribution, stream: np.random.Generator) -> Floats:
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
