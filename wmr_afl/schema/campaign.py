"""Tables of a campaign: what is drawn for each run, and what counts as success."""

from __future__ import annotations

from typing import Annotated

from pydantic import Field, model_validator

from wmr_afl.schema.kinds import NotNegative, Number, Positive, Table

Pair = Annotated[list[Number], Field(min_length=2, max_length=2)]


class Distribution(Table):
    """Of one number; exactly one kind."""

    uniform: Pair | None = None  # low, high
    log_uniform: Pair | None = None  # low, high, both positive: every factor is as likely as any other
    normal: Pair | None = None  # mean, standard deviation
    choice: Annotated[list[Number], Field(min_length=1)] | None = None  # each as likely as any other

    @model_validator(mode="after")
    def _one_that_can_be_drawn(self) -> Distribution:
        given = [kind for kind, numbers in vars(self).items() if numbers is not None]
        if len(given) != 1:
            kinds = ", ".join(type(self).model_fields)
            raise ValueError(f"names {' and '.join(given) or 'no distribution'}; give exactly one of {kinds}")
        for low, high in (pair for pair in (self.uniform, self.log_uniform) if pair is not None):
            if low >= high:
                raise ValueError(f"the range from {low:g} to {high:g} is empty; give [low, high]")
        if self.log_uniform is not None and self.log_uniform[0] <= 0.0:
            raise ValueError(f"log_uniform from {self.log_uniform[0]:g}; give a range above zero")
        if self.normal is not None and self.normal[1] <= 0.0:
            raise ValueError(f"a deviation of {self.normal[1]:g}; give normal = [mean, deviation] with deviation > 0")
        return self


class SuccessTable(Table):
    """Bounds that a run must keep in every entry, besides not failing."""

    rms: Positive | None = None  # of the tracking error, [m] or the output's unit
    largest_error: Positive | None = None
    largest_input: Positive | None = None  # [V]


class CampaignTable(Table):
    """Many runs of one controller, the first unless named; errors count from `since` [s]."""

    controller: str | None = None
    seed: Annotated[int, Field(ge=0)] = 0
    since: NotNegative = 0.0
    parameters: dict[str, Distribution] = Field(default_factory=dict)  # physical
    start: dict[str, Distribution] = Field(default_factory=dict)  # states
    gains: dict[str, Distribution] = Field(default_factory=dict)  # the same number in every entry
    scale: dict[str, Distribution] = Field(default_factory=dict)  # a factor on a physical parameter or a gain
    success: SuccessTable = SuccessTable()
