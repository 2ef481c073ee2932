"""The table of a controller in an experiment: which law, what it takes for true, and its numbers."""

from __future__ import annotations

from typing import Literal

import numpy as np
from pydantic import Field, model_validator

from wmr_afl.controllers.adaptation import AdaptationTable
from wmr_afl.controllers.direct_adaptation import guessed_inertia
from wmr_afl.controllers.groups import RowsOfGroups, groups_of
from wmr_afl.controllers.outer_loop import OuterLoopTable
from wmr_afl.controllers.pose_observer import ObserverTable
from wmr_afl.controllers.projection import ProjectionTable
from wmr_afl.controllers.robust_term import RobustTable
from wmr_afl.controllers.slip_meter import SHARE_OF_OBSERVER
from wmr_afl.model.model import Model
from wmr_afl.numerics.arrays import Floats
from wmr_afl.numerics.rules import Rule, Rules
from wmr_afl.numerics.vectors import by_name
from wmr_input.errors import FieldError
from wmr_input.fields import Estimate, Number, Numbers, Positive, Table

LINEARIZING = ("outer_loop", "adaptation", "projection", "robust")  # keys of the linearizing law only
PASSIVE = ("rate", "learning", "limit")  # keys of the others only
FASTEST = 15.0  # [1/s] of the loop, unless a rate is given: what is measured and modelled is seldom good beyond
SHARE = 0.3  # of 1/(sample time)
OBSERVER_SHARE = 0.6  # of 1/(sample time): rate of the observer, twice the loop's
POSE_SHARE_OF_DELAY = 0.4  # of 1/delay, where an observer cancels what the delay adds
NOISE, NOISE_OBSERVED = 0.05, 0.5  # r [V s^1/2] of least squares, without and with an observer
SHARE_OF_DELAY = 0.25  # of 1/delay
KAPPA = {"composite": 5.0, "direct": 20.0}  # [1/s], less beside least squares
SLOWER = 10.0  # times is the reference model slower than the loop


class LearningTable(Table):
    """How the composite and the direct law learn; every number has a default that needs no tuning."""

    gain: Positive | None = None  # kappa of the direct adaptation [1/s]
    noise: Positive | None = None  # r [V s^1/2]: what the equation of motion leaves unexplained
    filter: Positive = 0.1  # tau [s]
    memory: Positive = 200.0  # T [s]
    box: Positive = 4.0  # estimates stay within the guess divided and multiplied by this

    @model_validator(mode="after")
    def _box_holds_the_guess(self) -> LearningTable:
        if self.box <= 1.0:
            raise FieldError(f"a box of {self.box:g} leaves nothing", "choose box above 1")
        return self


class ControllerTable(Table):
    """A law and what it needs.

    "linearizing" is the paper's, adaptive if `adaptation` is given, robust if `robust` is. "composite", "direct" and
    "frozen" need a guess only; these estimate `passivity_parameters` by least squares and directly, directly, or not.
    """

    law: Literal["linearizing", "composite", "direct", "frozen"] = "linearizing"
    outer_loop: OuterLoopTable | None = None
    estimate: Estimate = "exact"
    guess: dict[str, Number] = Field(default_factory=dict)  # physical parameters that the controller takes for true
    adaptation: AdaptationTable | None = None
    projection: ProjectionTable | None = None
    robust: RobustTable | None = None
    input_weights: Numbers = 1.0
    rate: Positive | None = None  # of the loop [1/s]
    reference_rate: Positive | None = None  # of the reference model [1/s]; the linearizing law has one only if given
    learning: LearningTable = LearningTable()
    limit: Positive | None = None  # of the inputs [V]; that of the drive unless given
    measures: Literal["state", "pose"] = "state"  # whether v is measured, too
    observer: ObserverTable | None = None  # of what is not modelled, and of v unless it is measured; has defaults

    @property
    def estimated(self) -> str:
        """The generated function whose values are estimated."""
        return "base_parameters" if self.law == "linearizing" else "passivity_parameters"

    @property
    def observing(self) -> ObserverTable | None:
        """The observer's table, where there is one."""
        return self.observer or (ObserverTable() if self.measures == "pose" else None)

    @property
    def noise(self) -> float:
        """r [V s^1/2]: what is cancelled disturbs the data, too."""
        return self.learning.noise or (NOISE if self.observing is None else NOISE_OBSERVED)

    def rates(self, sample_time: float, delay: float) -> tuple[float, float]:
        """Of loop and reference model [1/s], for a drive that is `delay` [s] late."""
        if self.measures == "pose":
            bandwidth = min(SHARE / sample_time, POSE_SHARE_OF_DELAY / delay if delay else np.inf)
            usual = (1.0 - np.exp(-bandwidth * sample_time)) / sample_time  # both sampled poles of the loop there
        else:
            usual = min(SHARE / sample_time, FASTEST, SHARE_OF_DELAY / delay if delay else FASTEST)
        rate = self.rate or float(usual)
        return rate, self.reference_rate or rate / SLOWER

    def observer_rate(self, sample_time: float) -> float:
        """wo [1/s] of the observer."""
        given = self.observing
        return (given.rate if given is not None else None) or OBSERVER_SHARE / sample_time

    def slip_rate(self, sample_time: float) -> float:
        """How fast measured slip follows [1/s]."""
        given = self.observing
        return (given.slip_rate if given is not None else None) or SHARE_OF_OBSERVER * self.observer_rate(sample_time)

    def rules(self, model: Model) -> Rules:
        """What follows from other numbers of the loop: c and theta_hat(0) from p, gains and bounds from these."""
        rules: dict[str, Rule] = {"c": lambda n: model.known(n["p"])}
        if self.observing is not None:
            rules["slip.p"] = lambda n: model.replaced(n["p"], self.guess)
        truth, names = getattr(model, self.estimated), list(model.units_of(self.estimated))
        if self.guess or self.estimate == "exact":
            rules["theta_hat"] = lambda n: truth(model.replaced(n["p"], self.guess))
        else:
            estimate = by_name("base parameter", self.estimate, names)
            rules["theta_hat"] = lambda n: estimate
        if self.law != "linearizing":
            return {**rules, **self._of_the_guess(model)}
        for table in (self.outer_loop, self.adaptation, self.projection):
            rules |= table.rules() if table is not None else {}
        return rules

    def _of_the_guess(self, model: Model) -> Rules:
        """Prior, spread, box and inertia."""
        groups, box = groups_of(model), self.learning.box
        packed = RowsOfGroups(groups).packed_diagonals
        spread: Rule = lambda n: spread_of(n["theta_hat"])  # noqa: E731
        return {
            "least_squares.prior": lambda n: n["theta_hat"],
            "least_squares.spread": spread,
            "least_squares.covariance": lambda n: packed(n["least_squares.spread"] ** 2),
            "direct.spread": spread,
            "direct.inertia": lambda n: guessed_inertia(model, n["x"], n["theta_hat"], n["c"]),
            "projection.lower": lambda n: box_around(n["theta_hat"], box)[0],
            "projection.upper": lambda n: box_around(n["theta_hat"], box)[1],
        }


def spread_of(guess: Floats) -> Floats:
    """How far each number of a guess (..., n_pi) may be off: as far as it is large; a zero as far as the others are."""
    sizes = np.abs(guess)
    usual = np.exp(np.log(np.where(sizes > 0.0, sizes, 1.0)).mean(axis=-1, keepdims=True))
    return np.where(sizes > 0.0, sizes, usual)


def box_around(guess: Floats, box: float) -> tuple[Floats, Floats]:
    """From guess/box to guess times box, whatever its sign; a guess of zero may become as large as the others."""
    size = box * spread_of(guess)
    ends = np.stack([guess / box, guess * box])
    return np.where(guess == 0.0, -size, ends.min(axis=0)), np.where(guess == 0.0, size, ends.max(axis=0))
