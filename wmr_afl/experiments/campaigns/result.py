"""The result of a campaign: success rate, quantiles, worst runs."""

from __future__ import annotations

from collections import Counter
from dataclasses import dataclass
from statistics import NormalDist
from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from wmr_afl.errors import ShapeError, WmrError
from wmr_afl.experiments.distributions import SuccessTable
from wmr_afl.numerics.arguments import checked, real_numbers
from wmr_afl.numerics.arrays import Floats
from wmr_afl.simulation.batch import BatchResult
from wmr_input.errors import shown

IMPOSSIBLE = "impossible draw: "  # in front of the cause, if a robot cannot have what was drawn for it
LEVELS = (0.05, 0.25, 0.5, 0.75, 0.95, 0.99)  # of the quantiles that are printed and saved


@dataclass(frozen=True)
class CampaignResult:
    """N runs, in the order of their indices."""

    controller: str
    outputs: dict[str, str]  # name -> unit
    inputs: dict[str, str]
    seed: int
    draws: dict[str, Floats]  # "place.name" -> (N,); with noise also "noise_seed"
    runs: BatchResult
    criteria: SuccessTable

    def __len__(self) -> int:
        return len(self.runs.failure_time)

    @property
    def succeeded(self) -> NDArray[np.bool_]:
        """Runs that did not fail and kept every bound of [campaign.success], (N,)."""
        kept = ~self.runs.failed
        for name, bound in vars(self.criteria).items():
            if bound is not None:
                kept &= np.all(getattr(self.runs, name) <= bound, axis=1)
        return kept

    @property
    def impossible(self) -> int:
        """How many runs drew what no robot can have; they count as failed at 0 s."""
        return int(np.count_nonzero(np.char.startswith(self.runs.failure_cause, IMPOSSIBLE)))

    def causes(self) -> dict[str, int]:
        """How many runs failed for which cause, the most frequent first; impossible draws as one."""
        kinds = (cause.partition("; ")[0] for cause in self.runs.failure_cause if cause)
        counts = Counter(IMPOSSIBLE.rstrip(": ") if kind.startswith(IMPOSSIBLE) else kind for kind in kinds)
        return dict(counts.most_common())

    @checked
    def success_rate(self, confidence: float = 0.95) -> tuple[float, float, float]:
        """The share of runs that succeeded, with Wilson's bounds at this confidence.

        Raises:
            WmrError: if the confidence is not between 0 and 1.
        """
        return self._rate(int(np.count_nonzero(self.succeeded)), confidence)

    @checked
    def failure_rate(self, confidence: float = 0.95) -> tuple[float, float, float]:
        """The share of runs that failed, whatever else is wanted of them, with Wilson's bounds at this confidence.

        Raises:
            WmrError: if the confidence is not between 0 and 1.
        """
        return self._rate(int(np.count_nonzero(self.runs.failed)), confidence)

    def _rate(self, count: int, confidence: float) -> tuple[float, float, float]:
        if not 0.0 < confidence < 1.0:
            raise WmrError(f"the confidence is {confidence:g}", "choose a number between 0 and 1, such as 0.95")
        return wilson(count, len(self), confidence)

    def quantiles(self, levels: ArrayLike = LEVELS) -> dict[str, Floats]:
        """Quantiles of the measures of all runs, by name, (levels,); a failed run's measures count as infinite.

        Raises:
            ShapeError: if a level is not a number from 0 to 1.
        """
        wanted = real_numbers("levels", levels, "give numbers from 0 to 1")
        if not wanted.size or not np.all((wanted >= 0.0) & (wanted <= 1.0)):
            raise ShapeError(f"levels are {shown(levels)}", "give numbers from 0 to 1")
        return {name: np.quantile(values, wanted, method="higher") for name, values in self.measures().items()}

    def measures(self) -> dict[str, Floats]:
        """Largest and RMS errors, inputs and estimates of every run, by name and unit, (N,) each."""
        columns = {}
        for what, label in (("rms", "RMS error"), ("largest_error", "largest error")):
            for index, (output, unit) in enumerate(self.outputs.items()):
                columns[f"{label} of {output} [{unit}]"] = getattr(self.runs, what)[:, index]
        columns["largest input [V]"] = self.runs.largest_input.max(axis=1, initial=0.0)
        columns["largest estimate"] = self.runs.largest_estimate
        return columns

    @checked
    def worst(self, count: int = 10) -> NDArray[np.int64]:
        """Indices of the worst runs: first those that failed, the earliest first, then by their largest RMS error."""
        early = np.where(self.runs.failed, self.runs.failure_time, np.inf)
        return np.lexsort((np.arange(len(self)), -self.runs.rms.max(axis=1), early))[:count]

    @checked
    def describe(self, index: int) -> dict[str, Any]:
        """One run: what it drew, when it failed, and its measures; -1 is the last one.

        Raises:
            WmrError: if there is no such run.
        """
        if not -len(self) <= index < len(self):
            raise WmrError(f"there is no run {shown(index)}", f"runs are counted from 0 to {len(self) - 1}")
        failure = self.runs.failure_time[index]
        return {
            "run": int(index) % len(self),
            "drawn": {name: column[index].item() for name, column in self.draws.items()},
            "failed_at": None if np.isnan(failure) else float(failure),
            "cause": str(self.runs.failure_cause[index]) or None,
            **{name: _finite(column[index]) for name, column in self.measures().items()},
        }

    def brief(self) -> dict[str, Any]:
        """What is compared between controllers, in types that JSON has: rates with bounds, quantiles of the RMS error.

        The error is the largest of the outputs'; of a failed run it is infinite, and null here.
        """
        (success, *success_bounds), (failure, *failure_bounds) = self.success_rate(), self.failure_rate()
        errors = self.runs.rms.max(axis=1)
        median, most = np.quantile(errors, [0.5, 0.99], method="higher")
        return {
            "runs": len(self), "impossible": self.impossible, "causes": self.causes(),
            "success": success, "success_95": success_bounds, "failed": failure,
            "failed_95": failure_bounds, "rms_median": _finite(median), "rms_99": _finite(most),
            "rms_worst": _finite(errors.max()),
        }  # fmt: skip

    def summary(self) -> dict[str, Any]:
        """The whole result in types that JSON has; infinite measures are null."""
        rate, low, high = self.success_rate()
        return {
            "controller": self.controller,
            "runs": len(self),
            "seed": self.seed,
            "failed": int(np.count_nonzero(self.runs.failed)),
            "impossible": self.impossible,
            "causes": self.causes(),
            "success": {
                "criteria": {name: bound for name, bound in vars(self.criteria).items() if bound is not None},
                "rate": rate,
                "confidence_95": [low, high],
            },
            "levels": list(LEVELS),
            "quantiles": {name: [_finite(q) for q in row] for name, row in self.quantiles().items()},
            "worst": [self.describe(index) for index in self.worst()],
        }


def wilson(successes: int, trials: int, confidence: float) -> tuple[float, float, float]:
    """The share of successes and its bounds at this confidence (E. B. Wilson, J. Am. Stat. Assoc. 22, 1927)."""
    z, share = NormalDist().inv_cdf(0.5 + 0.5 * confidence), successes / trials
    middle = (share + z * z / (2 * trials)) / (1 + z * z / trials)
    half = z / (1 + z * z / trials) * np.sqrt(share * (1 - share) / trials + z * z / (4 * trials * trials))
    return share, max(0.0, float(middle - half)), min(1.0, float(middle + half))


def _finite(value: float) -> float | None:
    return float(f"{value:.9g}") if np.isfinite(value) else None
