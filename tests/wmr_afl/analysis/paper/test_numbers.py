"""Numbers of the paper's page and of the tables beyond it, from runs that are made by hand."""

import tomllib
from dataclasses import replace
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest

from tests.wmr_afl.analysis.paper.test_claims import FAILED, TIME, run, signal
from wmr_afl import SimulationError
from wmr_afl.analysis.monte_carlo import Scores
from wmr_afl.analysis.paper import beyond, report
from wmr_afl.experiments.experiment import read_experiment
from wmr_afl.model.model import load_model
from wmr_afl.simulation.result import Run


def test_errors_of_many_robots_are_told_in_millimetres() -> None:
    """The median between two in the middle; of 99 % none is worse than the second number; the worst at last."""
    errors = np.random.default_rng(2).permutation(np.arange(1.0, 201.0)) * 1e-3
    assert beyond.quantiles(errors) == pytest.approx((100.5, 199.0, 200.0))
    assert beyond.quantiles(np.array([0.002])) == pytest.approx((2.0, 2.0, 2.0))
    rms = np.stack([errors, 0.5 * errors], axis=1)
    scores = Scores(np.stack([0.12 * rms, rms]), np.linspace(1.0, 3.0, 200))
    assert beyond.judged(scores, 1) == ("100.50", "199.00", "200.00", "95.0", "2")
    assert beyond.judged(scores) == ("12.06", "23.88", "24.00", "58.5", "2")


@pytest.mark.parametrize("w", [15, 20, 30, 40])
def test_a_law_that_does_not_adapt_is_damped_critically(w: int) -> None:
    """s^2 + b1 s + b2 = (s + w)^2."""
    table = tomllib.loads(beyond.frozen(w))["outer_loop"]
    np.testing.assert_allclose(np.roots([1.0, table["b1"], table["b2"]]), [-w, -w], rtol=1e-6)


def test_the_laws_that_are_compared_are_named_after_their_numbers() -> None:
    """Frozen ones by their bandwidth; noise by its size, the delay in milliseconds."""
    for laws in (beyond.LAWS, beyond.NOISY, beyond.DELAYED):
        for name, table in laws.items():
            if name.startswith("frozen"):
                assert table == beyond.frozen(int(name.rpartition(" ")[2]))
    sizes = {"mm": 1e-3, "cm": 1e-2}
    for name, size in beyond.NOISES.items():
        number, unit = name.split()
        assert size == pytest.approx(float(number) * sizes[unit])
    assert pytest.approx(0.04) == beyond.DELAY
    troubles = beyond._more_trouble(9)
    assert troubles["40 ms late"] == beyond.Trouble(delay=0.04)
    assert troubles["noise of 2 cm"] == beyond.Trouble(noise=0.02, seed=9)
    assert troubles["masses double at 70 s"] == beyond.Trouble(payload_at=70.0)
    study = read_experiment("study_3")[0].uncertainties.lateral_slip
    assert study is not None
    assert all(f"step(t - {time:g})" in str(study.speed) for time in beyond.SLIP)
    assert ((10.0, np.inf), (0.0, np.inf), (50.0, 70.0)) == (beyond.SETTLED, beyond.WHOLE, beyond.SLIP)


def test_masses_and_inertias_double_unless_they_are_known() -> None:
    experiment, model = read_experiment("study_2")[0], load_model("type_2_0")
    found = beyond.doubled_masses(experiment, model)
    p = dict(zip(model.parameter_units, model.parameters(**experiment.parameters), strict=True))
    assert found == {name: 2.0 * p[name] for name, unit in model.parameter_units.items() if unit in ("kg", "kg m^2")}
    known: Any = SimpleNamespace(
        parameter_units=model.parameter_units, parameters=model.parameters, known_units={"m_C": "kg"}
    )
    assert set(found) - set(beyond.doubled_masses(experiment, known)) == {"m_C"}


def test_travel_is_the_way_of_an_input_by_time() -> None:
    """A mean over the motors, since ten seconds unless told otherwise."""
    volts = np.zeros((len(TIME), 2))
    volts[TIME > 12.0, 0] = 8.0
    volts[TIME > 20.0, 1] = -4.0
    volts[TIME < 5.0] = 50.0
    one = run(input=volts)
    assert beyond.travel(one) == pytest.approx((8.0 + 4.0) / 2.0 / 130.0)
    assert beyond.travel(one, 15.0) == pytest.approx(4.0 / 2.0 / 125.0)


def test_cells_of_the_papers_robot_are_of_their_seconds() -> None:
    """Whole run, settled, and while wheels slip in study 3; a failed run has no travel."""
    usual = run(error=signal(0.1, (10.0, 0.002)), input=signal(0.0, (50.0, 13.0)))
    slipping = run(error=signal(9.0, (50.0, 0.03), (70.5, 9.0)))
    rows = {row[0]: row[1:] for row in beyond._of_the_paper({"study_2": {"a": usual}, "study_3": {"a": slipping}}).rows}
    assert rows["a"] == (f"0, {1e3 * usual.rms()[1]:.3g}", "0, 2", "0, 30", f"{13.0 / 2.0 / 130.0:.0f}")
    more = beyond._in_more_trouble({"a": usual}, {"late": {"a": run(error=signal(0.5, (70.0, 0.004))[:, ::-1])}})
    assert more.headings == ("law", "as it stands", "late")
    assert more.rows == (("a", "2", "4"),)
    assert beyond._worse(FAILED, (0.0, 9.0)) == beyond._both(FAILED, (0.0, 9.0)) == str(FAILED.failure)


def test_metrics_of_a_run_are_told_with_units_and_missing_ones_as_missing() -> None:
    """Of a failed run what it has, and why it ended."""
    volts = np.zeros((len(TIME), 2))
    volts[3] = [-5.0, 2.0]
    told = report._metrics(run(error=signal(0.5, (110.0, 0.25)), input=volts, estimate=np.full((len(TIME), 6), -3.0)))
    assert told["rms_settled"].endswith(" m")
    assert told["rms_settled"].startswith("0, ")
    assert (told["largest_error"], told["largest_input"], told["largest_estimate"]) == ("0, 0.5 m", "5, 2 V", "3")
    assert (told["failure"], told["estimates"], told["controller"]) == ("", [], "AFL")
    failed = report._metrics(FAILED)
    assert (failed["rms"], failed["rms_settled"], failed["largest_error"]) == ("–", "–", "–")
    assert failed["failure"] == "stopped at t = 3 s: diverged"
    signals = ("time", "state", "input", "command", "error", "estimate", "reference")
    nothing = replace(FAILED, **{name: getattr(FAILED, name)[:0] for name in signals})
    assert (report._metrics(nothing)["largest_estimate"], report._metrics(nothing)["largest_input"]) == ("–", "–")


def test_estimates_are_told_with_their_deviations() -> None:
    """At the end of the run, with units; nothing of a law that knows none, or of a run without samples."""
    deviation = np.outer(np.linspace(1.0, 0.25, len(TIME)), np.arange(1.0, 7.0))
    estimate = np.outer(np.linspace(0.0, 2.0, len(TIME)), np.ones(6))
    one = run(estimate=estimate, estimated="passivity_parameters", deviation=deviation)  # type: ignore[arg-type]
    units = one.estimate_units
    told = report._estimates(one)
    assert told[:6] == [f"{name} = 2 ± {0.25 * (i + 1):.2g} {unit}" for i, (name, unit) in enumerate(units.items())]
    assert len(told) == 6
    assert report._estimates(run()) == []
    assert report._estimates(replace(one, deviation=deviation[:0])) == []
    open_one = deviation.copy()
    open_one[:, 2] = 1.0
    (last,) = report._estimates(replace(one, deviation=open_one))[6:]
    assert "undetermined by this reference" in last


def test_what_the_reference_excites_is_asked_of_the_first_run_without_its_beginning() -> None:
    """From 20 s on in windows of 40 s, each parameter in units of its true value; none of a run that is too short."""
    random = np.random.default_rng(3)
    rich: Run = replace(run(input=random.normal(size=(len(TIME), 2))), state=random.normal(size=(len(TIME), 5)))
    early = replace(rich, state=np.where(TIME[:, None] < 20.0, 7.0 + rich.state, rich.state))
    found = [report._excitation({"AFL": one, "other": run()}) for one in (rich, early)]
    assert found[0] == found[1]
    assert found[0] is not None
    assert "windows of 40 s" in found[0]["sentence"]
    theta = rich.model.base_parameters(rich.parameters)
    assert [row["true"] for row in found[0]["rows"]] == [f"{true:.4g}" for true in theta]
    assert [row["error"] for row in found[0]["rows"]] == ["-100%"] * 6
    assert report._excitation({"AFL": FAILED}) is None


def test_a_study_has_its_own_claims_and_figures(tmp_path: Any) -> None:
    """And the time from which its runs count as settled."""
    png = tmp_path / "a.png"
    png.write_bytes(b"picture")
    runs = {name: run() for name in ("AFL", "frozen estimates")}
    part = report._study("study_1", runs, {"fig5": png, "fig6": png, "beyond_errors": png})
    assert [figure["name"] for figure in part["figures"]] == ["fig5"]
    assert part["settled_since"] == "100"
    assert len(part["verdicts"]) == 3
    assert [one["controller"] for one in part["metrics"]] == ["AFL", "AFL"]


def test_numbers_of_no_run_are_said_so() -> None:
    """As an error is that a run raises."""

    def rms(*window: float) -> None:
        raise SimulationError("no samples", "run longer")

    failed: Any = SimpleNamespace(failure="stopped", rms=rms)
    assert beyond._both(failed, beyond.WHOLE) == beyond._worse(failed, beyond.WHOLE) == "stopped"
