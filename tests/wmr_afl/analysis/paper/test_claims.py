"""Every claim of the paper, on runs that are made by hand: it is met by what meets it and by nothing else."""

import base64
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from wmr_afl.analysis.metrics import SETTLED
from wmr_afl.analysis.paper.claims import CLAIMS, Claim, Verdict
from wmr_afl.analysis.paper.figures import FIGURES, draw
from wmr_afl.analysis.paper.report import write_report
from wmr_afl.model.model import load_model
from wmr_afl.numerics.arrays import Floats
from wmr_afl.simulation.result import Failure, Run
from wmr_input import WmrError

TIME = np.arange(0.0, 140.5, 0.5)
NAMES = {
    "study_1": ["AFL", "frozen estimates"],
    "study_2": ["AFL", "AFL with leakage", "robust AFL"],
    "study_2_high_gain": ["AFL", "AFL with leakage", "robust AFL"],
    "study_3": ["AFL", "robust AFL"],
}


def signal(value: float, *steps: tuple[float, float], columns: int = 2) -> Floats:
    """A value over time that is another one from each of these times on, in the last column; zero in the others."""
    found = np.zeros((len(TIME), columns))
    found[:, -1] = value
    for since, later in steps:
        found[since <= TIME, -1] = later
    return found


def run(**signals: Floats) -> Run:
    """A run of 140 s."""
    model = load_model("type_2_0")
    count = len(TIME)
    given: dict[str, Any] = {
        "error": np.zeros((count, 2)), "input": np.zeros((count, 2)), "estimate": np.zeros((count, 6)), **signals
    }  # fmt: skip
    return Run(
        "AFL", model, TIME, np.zeros((count, 5)), command=np.full((count, 2), 999.0), reference=np.zeros((count, 2)),
        parameters=model.parameters(), known=np.ones(1), **given,
    )  # fmt: skip


def beginning(whole: Run, samples: int, failure: Failure) -> Run:
    """A run that failed after so many samples."""
    names = ("time", "state", "input", "command", "error", "estimate", "reference")
    return replace(whole, failure=failure, **{name: getattr(whole, name)[:samples] for name in names})


FAILED = beginning(run(), 6, Failure(3.0, "diverged"))


def claim_of(experiment: str, words: str) -> Claim:
    (found,) = [claim for claim in CLAIMS if claim.experiment == experiment and words in claim.text]
    return found


def judged(claim: Claim, name: str, one: Run, others: Run | None = None) -> Verdict:
    """The verdict where one controller's run is this one, and the others' are perfect unless given."""
    return claim.judge({other: one if other == name else others or run() for other in NAMES[claim.experiment]})


# A claim that an error stays below a bound from a time on, of one controller.
BELOW = [
    ("study_1", "adaptive law tracks", "AFL", 1e-3, 100.0),
    ("study_2", "With leakage", "AFL with leakage", 0.1, 0.0),
    ("study_2", "robust term", "robust AFL", 0.1, 0.0),
    ("study_2_high_gain", "With leakage", "AFL with leakage", 0.1, 0.0),
    ("study_2_high_gain", "robust term", "robust AFL", 0.1, 0.0),
]
ABOVE = [
    ("study_1", "Without adaptation", "frozen estimates", 0.5, 100.0),
    ("study_2", "loses its stability", "AFL", 0.2, 0.0),
    ("study_2_high_gain", "loses its stability", "AFL", 0.2, 0.0),
]


@pytest.mark.parametrize(("experiment", "words", "name", "bound", "since"), BELOW)
def test_an_error_below_its_bound_meets_the_claim(experiment, words, name, bound: float, since: float) -> None:
    """One output above the bound is enough to break it, another controller's run is not; what was before is not."""
    claim = claim_of(experiment, words)
    assert judged(claim, name, run(error=signal(0.98 * bound)), FAILED).is_met
    assert not judged(claim, name, run(error=signal(1.02 * bound))).is_met
    assert not judged(claim, name, run(error=signal(1.02 * bound)[:, ::-1])).is_met
    assert not judged(claim, name, FAILED).is_met
    assert judged(claim, name, run(error=signal(100.0, (since, 0.0)))).is_met
    measured = judged(claim, name, run(error=signal(0.5 * bound))).measured
    assert f"(0, {0.5 * bound:.2g}) m" in measured
    assert ("since 100 s" in measured) == (since == 100.0)


@pytest.mark.parametrize(("experiment", "words", "name", "bound", "since"), ABOVE)
def test_an_error_above_its_bound_meets_the_claim(experiment, words, name, bound: float, since: float) -> None:
    """One output is enough; a run that failed has lost its stability."""
    claim = claim_of(experiment, words)
    assert judged(claim, name, run(error=signal(1.02 * bound))).is_met
    assert not judged(claim, name, run(error=signal(0.98 * bound))).is_met
    assert judged(claim, name, FAILED).is_met
    assert not judged(claim, name, run(), FAILED).is_met
    assert not judged(claim, name, run(error=signal(100.0, (since, 0.0) if since else (0.0, 0.0)))).is_met


@pytest.mark.parametrize("experiment", ["study_1", "study_2", "study_2_high_gain"])
def test_estimates_are_bounded_if_they_hardly_grow_at_the_end(experiment: str) -> None:
    """By less than a twentieth after five sevenths of the run, of every controller that adapts; size, not sign."""
    claim = claim_of(experiment, "Estimates stay bounded")
    late = SETTLED * 140.0 + 0.5
    for name in NAMES[experiment]:
        grows = run(estimate=signal(-2.0, (1.0, 2.0), (late, -2.12), columns=6))
        assert not judged(claim, name, grows).is_met
        assert judged(claim, name, run(estimate=signal(-2.0, (1.0, 2.0), (late, -2.08), columns=6))).is_met
        assert judged(claim, name, run(estimate=signal(1.0, (SETTLED * 140.0, 9.0), columns=6))).is_met
        assert not judged(claim, name, FAILED).is_met
    assert judged(claim, NAMES[experiment][0], run(estimate=np.full((len(TIME), 6), 3.0))).is_met


@pytest.mark.parametrize("experiment", ["study_2", "study_3"])
def test_inputs_are_within_their_limit_if_every_motor_of_every_run_is(experiment: str) -> None:
    """As applied, of either sign; the limit itself is within."""
    claim = claim_of(experiment, "Inputs stay within 24 V")
    for name in NAMES[experiment]:
        for sign in (1.0, -1.0):
            assert judged(claim, name, run(input=signal(0.0, (50.0, sign * 24.0)))).is_met
            assert not judged(claim, name, run(input=signal(0.0, (50.0, sign * 24.01), (51.0, 0.0)))).is_met
    assert "largest 24 V" in judged(claim, "AFL", run(input=signal(-24.0))).measured


def slip(before: float, during: float, after: float) -> Run:
    """Errors before, while and after the wheels slip; those of the start and of the way back do not count."""
    return run(error=signal(9.0, (30.0, before), (50.5, during), (71.5, 9.0), (80.0, after)))


def test_errors_grow_under_slip_and_recover_afterwards() -> None:
    """More than twice, and less than six tenths again, for every controller."""
    claim = claim_of("study_3", "recover")
    for name in NAMES["study_3"]:
        other = slip(0.1, 1.0, 0.1)
        assert judged(claim, name, slip(0.1, 0.21, 0.12), other).is_met
        assert not judged(claim, name, slip(0.1, 0.19, 0.1), other).is_met
        assert not judged(claim, name, slip(0.1, 0.5, 0.31), other).is_met
        assert not judged(claim, name, FAILED, other).is_met


def test_every_claim_is_tried_on_a_run_that_breaks_it() -> None:
    """None is left out above."""
    tried = {(experiment, words) for experiment, words, *_ in (*BELOW, *ABOVE)}
    tried |= {(study, "Estimates stay bounded") for study in ("study_1", "study_2", "study_2_high_gain")}
    tried |= {("study_2", "Inputs stay"), ("study_3", "Inputs stay"), ("study_3", "recover")}
    assert {claim_of(*one) for one in tried} == set(CLAIMS)


def test_a_report_holds_every_verdict_and_what_the_reference_determines(tmp_path: Path) -> None:
    """With figures inside the page; without a run that is long enough nothing is said of excitation."""
    png = tmp_path / "fig4.png"
    png.write_bytes(b"picture")
    random = np.random.default_rng(0)
    rich = run(error=signal(0.5), input=random.normal(size=(len(TIME), 2)))
    rich = replace(rich, state=random.normal(size=(len(TIME), 5)), estimate=np.full((len(TIME), 6), 1.5))
    studies = {"study_1": {"AFL": rich, "frozen estimates": FAILED}}
    page = write_report(studies, {"fig4": png}, None, tmp_path / "report.html").read_text()
    assert base64.b64encode(b"picture").decode() in page
    for claim in CLAIMS:
        assert (claim.text in page) == (claim.experiment == "study_1")
    for word in ("since 100 s", "the reference excites persistently", "stopped at t = 3 s"):
        assert word in page, word
    theta = rich.model.base_parameters(rich.parameters)
    for true in theta:
        assert f"{true:.4g}" in page
        assert f"{(1.5 - true) / true:+.0%}" in page
    poor = {"study_1": {"AFL": FAILED, "frozen estimates": run()}}
    assert "persistently" not in write_report(poor, {}, None, tmp_path / "poor.html").read_text()
    still = {"study_1": {"AFL": run(estimate=np.ones((len(TIME), 6))), "frozen estimates": run()}}
    assert "does not excite persistently" in write_report(still, {}, None, tmp_path / "still.html").read_text()
    with pytest.raises(WmrError, match="cannot be written"):
        write_report(poor, {}, None, tmp_path / "nowhere" / "report.html")


@pytest.mark.parametrize("figure", FIGURES)
def test_a_figure_of_the_paper_shows_the_runs_that_its_caption_names(figure: str) -> None:
    """Paths, outputs, errors or inputs of these controllers, with the reference."""
    random = np.random.default_rng(0)
    kind = FIGURES[figure]
    runs = {
        name: run(error=random.normal(size=(len(TIME), 2)), input=random.normal(size=(len(TIME), 2)))
        for name in NAMES[kind.experiment]
    }
    picture = draw(figure, runs)
    assert picture._suptitle.get_text() == kind.caption
    shown = {line.get_label() for axes in picture.axes for line in axes.get_lines()}
    expected = {
        "fig4": {"AFL", "frozen estimates"}, "fig6": {"AFL", "AFL with leakage"}, "fig8": {"AFL", "robust AFL"},
        "high_gain": {"AFL", "AFL with leakage", "robust AFL"}, "fig10": {"AFL", "robust AFL"},
        "fig7": {"u_r", "u_l"}, "fig9": {"u_r", "u_l"},
    }  # fmt: skip
    if figure in expected:
        assert {name for name in shown if not name.startswith("_")} - {"reference"} == expected[figure]
    if figure in ("fig7", "fig9"):
        titles = [axes.get_title(loc="left") for axes in picture.axes]
        assert titles == ["(a) AFL with leakage" if figure == "fig7" else "(a) robust AFL", "(b) AFL"]
        np.testing.assert_array_equal(picture.axes[1].get_lines()[1].get_ydata(), runs["AFL"].input[:, 1])
    if figure == "fig5":
        assert len(picture.axes[0].get_lines()) == 6
    if figure in ("fig4", "fig6", "fig8", "high_gain", "fig10"):  # two panels share the time below them
        upper, lower = picture.axes[1:]
        assert (upper.get_xlabel(), lower.get_xlabel()) == ("", "time [s]")
        assert [axes.xaxis.get_tick_params()["labelbottom"] for axes in (upper, lower)] == [False, True]
        what = "output" if figure == "fig4" else "error"
        for index, axes in enumerate((upper, lower)):
            found = {line.get_label(): line.get_ydata() for line in axes.get_lines()}
            for name in expected[figure]:
                np.testing.assert_array_equal(found[name], getattr(runs[name], what)[:, index])
    if figure in ("fig6", "fig8", "high_gain", "fig10"):
        path, first, _ = picture.axes
        assert (path.get_title(loc="left"), first.get_title(loc="left")) == ("(a)", "(b)")
