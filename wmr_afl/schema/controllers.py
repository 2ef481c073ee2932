"""Tables of controllers: each part of a law has one."""

from __future__ import annotations

from typing import Literal

from pydantic import Field, model_validator

from wmr_afl.schema.kinds import ByName, Estimate, Gain, Named, NotNegative, Number, Numbers, Positive, Table


class OuterLoopTable(Table):
    """(27), (34)"""

    b1: Numbers
    b2: Numbers
    alpha: Numbers | None = None


class AdaptationTable(Table):
    """(25); `relative_gain` g gives Gamma_i = g theta_hat_i(0)^2, for base parameters that differ in size and unit."""

    gain: Gain | None = None
    relative_gain: Positive | None = None
    leakage: Named | None = None  # Sigma of (51)
    normalization: Positive | None = None  # Remark 5
    input: Literal["commanded", "applied"] = "commanded"  # at which W is taken

    @model_validator(mode="after")
    def _one_gain(self) -> AdaptationTable:
        if (self.gain is None) == (self.relative_gain is None):
            raise ValueError("names no or two gains; give gain or relative_gain")
        return self


class ProjectionTable(Table):
    """Remark 7; a plain number bounds the estimates that enter det Dhat, names bound those named.

    `relative` r keeps every estimate within theta_hat(0) +- r |theta_hat(0)|.
    """

    lower: ByName | None = None
    upper: ByName | None = None
    relative: Positive | None = None

    @model_validator(mode="after")
    def _one_kind_of_bound(self) -> ProjectionTable:
        if self.relative is not None and (self.lower is not None or self.upper is not None):
            raise ValueError("names relative and absolute bounds; give relative, or lower and upper")
        return self


class RobustTable(Table):
    """(70)-(74); a mu that does not decay wants leakage on a_hat (Remark 9)."""

    gamma: Positive
    mu: Positive = 1.0
    mu_decay: NotNegative = 1.0
    leakage: NotNegative = 0.0


class ControllerTable(Table):
    """The linearizing law; adaptive where `adaptation` is given, robust where `robust` is."""

    outer_loop: OuterLoopTable | None = None
    estimate: Estimate = "exact"
    guess: dict[str, Number] = Field(
        default_factory=dict
    )  # physical parameters as the controller believes them, in the place of `estimate`
    adaptation: AdaptationTable | None = None
    projection: ProjectionTable | None = None
    robust: RobustTable | None = None
    input_weights: Numbers = 1.0
