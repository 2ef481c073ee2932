"""The paper's claims about its studies, each judged by what was measured here."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np

from wmr_afl.analysis.metrics import SETTLED
from wmr_afl.analysis.plots import Runs
from wmr_afl.errors import SimulationError
from wmr_afl.simulation.result import Run


@dataclass(frozen=True)
class Verdict:
    """A claim, what was measured, and whether they agree."""

    claim: str
    measured: str
    is_met: bool


@dataclass(frozen=True)
class Claim:
    """A claim about the runs of an experiment."""

    experiment: str
    text: str
    measure: Callable[[Runs], tuple[str, bool]]

    def judge(self, runs: Runs) -> Verdict:
        """The verdict; a run that failed meets no claim."""
        try:
            return Verdict(self.text, *self.measure(runs))
        except SimulationError as error:
            return Verdict(self.text, str(error), False)


def _rms_below(name: str, bound: float, since: float = 0.0) -> Callable[[Runs], tuple[str, bool]]:
    def measure(runs: Runs) -> tuple[str, bool]:
        rms = runs[name].rms(since=since)
        return f"RMS {_metres(rms)}" + (f" since {since:g} s" if since else ""), bool(rms.max() < bound)

    return measure


def _some_rms_above(name: str, bound: float, since: float = 0.0) -> Callable[[Runs], tuple[str, bool]]:
    """A run that fails has lost its stability, as the claim says."""

    def measure(runs: Runs) -> tuple[str, bool]:
        if runs[name].failure is not None:
            return str(runs[name].failure), True
        rms = runs[name].rms(since=since)
        return f"RMS {_metres(rms)}" + (f" since {since:g} s" if since else ""), bool(rms.max() > bound)

    return measure


def _settled(runs: Runs) -> tuple[str, bool]:
    """The largest size of all estimates grows by less than a twentieth once a run has settled."""
    texts, settled = [], all(run.failure is None for run in runs.values())
    for name, run in runs.items():
        if len(run.time) and np.ptp(run.estimate, axis=0).any():
            late = run.time > SETTLED * run.time[-1]
            before, after = (np.abs(run.estimate[rows]).max(initial=0.0) for rows in (~late, late))
            texts.append(f"{name}: {before:.3g} before the last 40 s, {after:.3g} in them")
            settled = settled and bool(after < 1.05 * before)
    return "; ".join(texts) or "a run failed", settled


def _inputs_below(limit: float) -> Callable[[Runs], tuple[str, bool]]:
    def measure(runs: Runs) -> tuple[str, bool]:
        largest = max(float(np.abs(run.input).max(initial=0.0)) for run in runs.values())
        return f"largest {largest:.3g} V", largest <= limit

    return measure


def _recovers(runs: Runs) -> tuple[str, bool]:
    """Errors before, during and after the slip."""
    texts, recovers = [], True
    for name, run in runs.items():
        before, during, after = (_largest(run, *window) for window in ((30.0, 50.0), (50.0, 71.0), (80.0, 140.0)))
        texts.append(f"{name}: {before:.2g} m before, {during:.2g} m during, {after:.2g} m after")
        recovers = recovers and during > 2.0 * before and after < 0.6 * during
    return "; ".join(texts), recovers


def _largest(run: Run, since: float, until: float) -> float:
    return float(run.largest_error(since, until).max())


def _metres(values: np.ndarray) -> str:
    return "(" + ", ".join(f"{value:.2g}" for value in values) + ") m"


CLAIMS = (
    Claim("study_1", "The adaptive law tracks: RMS below 1 mm in the end", _rms_below("AFL", 1e-3, 100.0)),
    Claim("study_1", "Without adaptation the error stays", _some_rms_above("frozen estimates", 0.5, 100.0)),
    Claim("study_1", "Estimates stay bounded (figure 5): they grow no more", _settled),
    Claim("study_2", "With leakage RMS below 0.1 m", _rms_below("AFL with leakage", 0.1)),
    Claim("study_2", "With the robust term RMS below 0.1 m", _rms_below("robust AFL", 0.1)),
    Claim("study_2", "Inputs stay within 24 V (they are clipped)", _inputs_below(24.0)),
    Claim("study_2", "Estimates stay bounded: they hardly grow any more", _settled),
    Claim("study_2", "The law without modification loses its stability", _some_rms_above("AFL", 0.2)),
    Claim("study_2_high_gain", "The law without modification loses its stability", _some_rms_above("AFL", 0.2)),
    Claim("study_2_high_gain", "With leakage RMS below 0.1 m", _rms_below("AFL with leakage", 0.1)),
    Claim("study_2_high_gain", "With the robust term RMS below 0.1 m", _rms_below("robust AFL", 0.1)),
    Claim("study_2_high_gain", "Estimates stay bounded: they hardly grow any more", _settled),
    Claim("study_3", "Errors grow while the wheels slip and recover afterwards", _recovers),
    Claim("study_3", "Inputs stay within 24 V (they are clipped)", _inputs_below(24.0)),
)
