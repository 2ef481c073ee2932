"""What a log says of a robot: numbers with intervals, what foretold them, and the robot that they belong to."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from wmr_afl.identification.checks import UNITS, Finding
from wmr_afl.identification.effort import Effort
from wmr_afl.identification.estimate import NOT_DETERMINED, ROUGH, Estimate
from wmr_afl.identification.feedforward import Feedforward, feedforward
from wmr_afl.identification.held_out import Score
from wmr_afl.identification.log import Log
from wmr_afl.identification.motion import Motion, Smoother
from wmr_afl.identification.physical import Physical
from wmr_afl.model.model import Model
from wmr_afl.numerics.arrays import Floats

EXPLAINED = 50.0  # [%] of what was held out: with less a robot does not match its log
SLIGHT = 5e-3  # of the largest voltage: friction that is told to less is told, even if it is none


@dataclass(frozen=True)
class Tried:
    """An estimate from the part of the log that was not held out, and what it foretells of the other part."""

    estimate: Estimate
    score: Score
    misfit: float  # what it leaves of windows of the other part, in units of the noise; the least decides


@dataclass(frozen=True, repr=False)
class Identified:
    """What a log says of a robot."""

    smoother: Smoother  # how the log was read
    log: Log
    checks: tuple[Finding, ...]
    tried: tuple[Tried, ...]  # weak form and output error
    estimate: Estimate  # of the whole log, by the method that foretold best
    share: Floats  # (unknown,), of each number in the voltages
    physical: Physical
    held: tuple[Motion, ...]  # what was held out
    delay: float  # [s], by which voltages were taken as later
    described: tuple[str, ...] = ()  # numbers that only motions tell which the log has not: as the description has them

    @property
    def effort(self) -> Effort:
        """The robot as the log sees it."""
        return self.smoother.effort

    @property
    def model(self) -> Model:
        """The robot's model."""
        return self.effort.model

    @property
    def names(self) -> list[str]:
        """Of what was unknown: base parameters, ratios of gains, Coulomb friction in volts."""
        return list(self.effort.units)

    @property
    def chosen(self) -> Tried:
        """The method that foretold best."""
        return next(one for one in self.tried if one.estimate.method == self.estimate.method)

    def told(self, estimate: Estimate | None = None) -> list[str]:
        """How well an estimate, the final one unless given, tells each number: yes, roughly, no, known or described.

        By two standard deviations as a share of the number, and of friction as a share of the voltage: `about zero` if
        it is no further from zero than either. `below zero` is a friction that would push its motor.
        """
        estimate = self.estimate if estimate is None else estimate
        most = max(float(np.abs(segment.u).max()) for segment in self.log.segments)
        answers = []
        rows = zip(self.names, estimate.interval, estimate.unknown, self.effort.is_free, strict=True)
        for name, interval, value, is_free in rows:
            rubs, size = name in self.effort.friction_groups, abs(value)
            is_slight = rubs and interval <= SLIGHT * most
            if name in self.described:
                answers.append("described")
            elif not is_free:
                answers.append("known")
            elif is_slight and (size <= interval or -SLIGHT * most <= value < 0.0):
                answers.append("about zero")
            elif rubs and value < -interval:
                answers.append("below zero")
            elif interval <= ROUGH * size or is_slight:
                answers.append("yes")
            else:
                answers.append("roughly" if interval <= NOT_DETERMINED * size else "no")
        return answers

    @property
    def undetermined(self) -> list[str]:
        """The numbers of which the log says too little; what is known needs no log."""
        return [name for name, answer in zip(self.names, self.told(), strict=True) if answer == "no"]

    @property
    def pushing(self) -> list[str]:
        """The Coulomb frictions that are clearly below zero, as no motor's is."""
        return [name for name, answer in zip(self.names, self.told(), strict=True) if answer == "below zero"]

    @property
    def rough(self) -> list[str]:
        """The numbers that the log tells roughly."""
        return [name for name, answer in zip(self.names, self.told(), strict=True) if answer == "roughly"]

    @property
    def disagreeing(self) -> list[str]:
        """The numbers in which the two methods differ by more than their noise, and by a tenth besides."""
        if len(self.tried) < 2:
            return []
        one, other = (tried.estimate for tried in self.tried)
        apart = np.abs(one.unknown - other.unknown)
        noise, size = one.interval + other.interval, 0.1 * np.maximum(np.abs(one.unknown), np.abs(other.unknown))
        return [name for name, is_apart in zip(self.names, apart > np.maximum(noise, size), strict=True) if is_apart]

    @property
    def parameters(self) -> dict[str, float]:
        """The physical parameters by name."""
        return dict(zip(self.model.parameter_units, self.physical.p.tolist(), strict=True))

    @property
    def guess(self) -> dict[str, float]:
        """Those that were sought or given: the `guess` of a controller in an experiment, which knows the others."""
        chosen = {*self.physical.uncertain, *self.effort.given} - self.model.known_units.keys()
        return {name: value for name, value in self.parameters.items() if name in chosen}

    @property
    def feedforward(self) -> tuple[Feedforward, ...] | None:
        """kS, kV and kA of a differential drive, of motions that the log has; None of another robot."""
        gains = feedforward(self.effort, self.estimate)
        return gains if gains is None else tuple(one for one in gains if all(one.interval[1:]))

    @property
    def verdict(self) -> str:
        """In a sentence how far the model explains what was held out of the log."""
        best = self.chosen
        leaves = f"leaves {best.misfit:.2f} times the measurement's noise, " if np.isfinite(best.misfit) else ""
        fit = f"{best.score.overall:.1f} %" if np.isfinite(best.score.overall) else "nothing"
        text = f"{best.estimate.method}: {leaves}foretells {fit} of what was held out"
        doubts = ", ".join(dict.fromkeys(one.name for one in self.checks if not one.is_fine))
        text += f"; look at the checks ({doubts})" if doubts else ""
        if not self.is_explained:
            return f"{text}: this robot does not match the log; look at signs of voltages and lengths"
        if self.pushing:
            return f"{text}; a contradiction: friction below zero ({', '.join(self.pushing)})"
        if self.has_other_units:
            return f"{text}; a contradiction: sensors differ as degrees from radians do"
        if self.physical.is_contradiction:
            return f"{text}; a contradiction: no possible robot is like that (chi^2/n {self.physical.chi2:.3g})"
        return text

    @property
    def is_explained(self) -> bool:
        """Whether more than half of what was held out is foretold; by its mean nothing is."""
        return self.chosen.score.overall > EXPLAINED

    @property
    def is_contradiction(self) -> bool:
        """Whether the log contradicts the description: not explained, or by no possible robot only."""
        return self.physical.is_contradiction or bool(self.pushing) or not self.is_explained or self.has_other_units

    @property
    def has_other_units(self) -> bool:
        """Whether sensors differ as degrees from radians do."""
        return any(one.name == UNITS for one in self.checks)

    @property
    def cost(self) -> float | None:
        """What output error leaves of what it was made from, in units of the noise (an encoder's step over sqrt 12)."""
        return next((one.estimate.cost for one in self.tried if one.estimate.cost is not None), None)

    def __repr__(self) -> str:
        return f"<Identified {self.model.name}: {self.verdict}>"

    def __str__(self) -> str:
        width = max(map(len, self.names))
        lines = [f"{self.model.name}: {self.verdict}", ""]
        lines += [str(check) for check in self.checks]
        lines += ["", f"{'':{width}}  {'value':>12}  {'+- 2 sd':>10}  share of the voltage"]
        rows = zip(
            self.names,
            self.effort.units.values(),
            self.estimate.unknown,
            self.estimate.interval,
            self.share,
            self.told(),
            strict=True,
        )
        for name, unit, value, interval, share, answer in rows:
            words = {"no": "not determined", "roughly": f"{100 * share:.1f} %, roughly"}
            words |= {one: one for one in ("about zero", "below zero")}
            told = words.get(answer, f"{100 * share:.1f} %")
            lines.append(f"{name:{width}}  {value:12.5g}  {interval:10.2g}  {told} [{unit}]")
        lines += ["", "guess = { " + ", ".join(f"{name} = {value:.5g}" for name, value in self.guess.items()) + " }"]
        return "\n".join(lines)
