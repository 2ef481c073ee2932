"""`report.html`: one self-contained page with every figure, its parameters, metrics and verdicts."""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path
from typing import Any

import numpy as np

from wmr_afl.analysis.excitation import excitation, sentence
from wmr_afl.analysis.metrics import SETTLED, metrics
from wmr_afl.analysis.page import inline, write_page
from wmr_afl.analysis.paper.beyond import DELAYED, NOISY, ONE_ROBOT, Beyond
from wmr_afl.analysis.paper.beyond_figures import CAPTIONS
from wmr_afl.analysis.paper.claims import CLAIMS
from wmr_afl.analysis.paper.figures import FIGURES
from wmr_afl.analysis.plots import Runs
from wmr_afl.errors import SimulationError
from wmr_afl.experiments.experiment import read_experiment
from wmr_afl.simulation.result import Run


def write_report(studies: Mapping[str, Runs], pictures: Mapping[str, Path], beyond: Beyond | None, path: Path) -> Path:
    """Write the page on these studies, and on what is beyond them; `pictures`: PNG files by the figures' names.

    Raises:
        WmrError: if it cannot be written.
    """
    parts = [_study(name, runs, pictures) for name, runs in studies.items()]
    told = None if beyond is None else _beyond(beyond, pictures)
    return write_page("paper/report.html.jinja", path, studies=parts, beyond=told)


def _study(name: str, runs: Runs, pictures: Mapping[str, Path]) -> dict[str, Any]:
    experiment, path = read_experiment(name)
    return {
        "name": name,
        "title": experiment.title,
        "source": experiment.source,
        "text": path.read_text(encoding="utf-8"),
        "verdicts": [claim.judge(runs) for claim in CLAIMS if claim.experiment == name],
        "settled_since": f"{SETTLED * experiment.simulation.duration:g}",
        "metrics": [_metrics(run) for run in runs.values()],
        "figures": [
            {"name": figure, "caption": FIGURES[figure].caption, "png": inline(png)}
            for figure, png in pictures.items()
            if figure in FIGURES and FIGURES[figure].experiment == name
        ],
        "excitation": _excitation(runs),
    }


def _beyond(beyond: Beyond, pictures: Mapping[str, Path]) -> dict[str, Any]:
    figures = [{"caption": CAPTIONS[name], "png": inline(png)} for name, png in pictures.items() if name in CAPTIONS]
    laws = {**NOISY, **DELAYED, **ONE_ROBOT}
    return {"sheets": beyond.sheets, "figures": figures, "laws": {law: table for law, table in laws.items() if table}}


def _metrics(run: Run) -> dict[str, Any]:
    found = metrics(run)

    def numbers(key: str, unit: str) -> str:
        return ", ".join(f"{value:.3g}" for value in found[key]) + f" {unit}" if key in found else "–"

    return {
        "controller": run.controller,
        "rms": numbers("rms", "m"),
        "rms_settled": numbers("rms_settled", "m"),
        "largest_error": numbers("largest_error_settled", "m"),
        "largest_input": numbers("largest_input", "V"),
        "largest_estimate": f"{found['largest_estimate']:.3g}" if "largest_estimate" in found else "–",
        "failure": found["failure"] or "",
        "warnings": run.warnings,
        "conditions": [{"text": str(one), "holds": one.holds, "share": f"{one.share:.2%}"} for one in run.conditions],
        "estimates": _estimates(run),
    }


def _estimates(run: Run) -> list[str]:
    """Each estimate at the end with its deviation, of a law that knows one, and what stays undetermined."""
    if run.deviation is None or not len(run.deviation):
        return []
    rows = zip(run.estimate_units.items(), run.estimate[-1], run.deviation[-1], strict=True)
    told = [f"{name} = {last:.4g} ± {deviation:.2g} {unit}" for (name, unit), last, deviation in rows]
    return [*told, *filter(None, [sentence(run)])]


def _excitation(runs: Runs) -> dict[str, Any] | None:
    """What the reference determines, from the first controller's run without its first 20 s; None if it failed."""
    run = next(iter(runs.values()))
    theta = np.asarray(getattr(run.model, run.estimated)(run.parameters))
    try:
        found = excitation(run, theta, window=40.0, since=20.0)
    except SimulationError:
        return None
    verdict = "excites persistently" if found.is_persistent else "does not excite persistently"
    sentence = (
        f"Over windows of {found.window:g} s, every base parameter in units of its true value, the integral of W^T W "
        f"has smallest eigenvalues of at least {max(found.level.min(), 0.0):.2g} and largest ones of up to "
        f"{found.highest.max():.3g}: the reference {verdict}."
    )
    rows = [
        {
            "name": theta_name,
            "true": f"{true:.4g}",
            "share": f"{share:.2f}",
            "estimate": f"{last:.4g}",
            "error": f"{(last - true) / true:+.0%}",
        }
        for theta_name, true, share, last in zip(found.names, theta, found.directions, run.estimate[-1], strict=True)
    ]
    return {"sentence": sentence, "rows": rows, "controller": run.controller}
