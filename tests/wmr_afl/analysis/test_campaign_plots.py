"""The figures and files of a campaign, from results that are made by hand."""

import json
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from tests.wmr_afl.experiments.campaigns.handmade import INF, NAN, result
from wmr_afl.analysis.campaign_plots import (
    BINS,
    _binned,
    draw_comparison,
    draw_errors,
    draw_success,
    write,
    write_comparison,
)
from wmr_afl.experiments.campaigns.result import wilson
from wmr_afl.experiments.distributions import SuccessTable
from wmr_input import WmrError


def test_bars_reach_from_the_bound_below_to_the_bound_above() -> None:
    """In each bin of a drawn quantity, in percent; asymmetric where few succeed."""
    column = np.arange(100.0)
    succeeded = column >= 95.0
    places, rates, bars = _binned(column, succeeded)
    assert (places.shape, rates.shape, bars.shape) == ((BINS,), (BINS,), (2, BINS))
    np.testing.assert_array_equal(places, 4.5 + 10.0 * np.arange(10))
    np.testing.assert_array_equal(rates, [0.0] * 9 + [50.0])
    none, half = wilson(0, 10, 0.95), wilson(5, 10, 0.95)
    np.testing.assert_allclose(bars[:, 0], [0.0, 100.0 * none[2]], atol=1e-12)
    np.testing.assert_allclose(bars[:, -1], 100.0 * np.array([0.5 - half[1], half[2] - 0.5]), rtol=1e-12)


def test_of_a_choice_of_few_values_each_is_a_bin() -> None:
    """However often it was drawn."""
    column = np.array([2.0, 1.0, 1.0, 2.0, 1.0])
    places, rates, _ = _binned(column, np.array([True, True, False, True, False]))
    assert places.tolist() == [1.0, 2.0]
    np.testing.assert_allclose(rates, [100.0 / 3.0, 100.0])


def test_curves_end_at_the_share_of_all_runs_that_did_not_fail() -> None:
    """A failure lowers the curve: the share is one of all runs."""
    one = result([[0.1, 0.2], [INF, INF], [0.3, 0.4], [0.2, 0.1]], [NAN, 2.0, NAN, NAN], success=SuccessTable(rms=0.35))
    axes = draw_errors(one).axes[0]
    first, second = axes.lines[:2]
    np.testing.assert_array_equal(first.get_xdata(), [0.1, 0.2, 0.3])
    np.testing.assert_array_equal(first.get_ydata(), [25.0, 50.0, 75.0])
    np.testing.assert_array_equal(second.get_xdata(), [0.1, 0.2, 0.4])
    assert first.get_label() == "y1 [m]"
    assert axes.lines[2].get_xdata()[0] == 0.35
    rate, low, high = one.success_rate()
    assert axes.texts[0].get_text() == f"success {rate:.1%}"
    extent = axes.patches[0].get_extents().transformed(axes.transData.inverted())
    np.testing.assert_allclose([extent.y0, extent.y1], [100.0 * low, 100.0 * high], rtol=1e-9)


def test_success_is_drawn_over_every_quantity_but_seeds() -> None:
    """One panel each."""
    one = result([[0.1, 0.2]] * 4)
    one.draws["noise_seed"] = np.arange(4)
    one.draws["scale.m_C"] = np.arange(4.0)
    assert [axes.get_xlabel() for axes in draw_success(one).axes] == ["start.x", "scale.m_C"]
    only = result([[0.1, 0.2]] * 4)
    only.draws.clear()
    only.draws["noise_seed"] = np.arange(4)
    assert [axes.get_xlabel() for axes in draw_success(only).axes] == ["noise_seed"]


def test_above_each_figure_it_stands_whose_runs_it_shows() -> None:
    """And how many they are; a name is no mathematics."""
    one = result([[0.1, 0.2], [0.3, 0.4], [INF, INF]], [NAN, NAN, 1.0])
    for draw in (draw_errors, draw_success):
        assert draw(one).get_suptitle() == "3 runs of AFL"
        assert draw(replace(one, controller="$x$")).get_suptitle() == r"3 runs of \$x\$"
    assert draw_comparison({"AFL": one, "other": one}).get_suptitle() == "3 runs, the same draws for each law"
    assert draw_success(one).get_supylabel() == "success [%]"
    assert [axes.get_ylabel() for axes in draw_errors(one).axes] == ["runs that stay below [%]"]


def test_files_of_a_campaign_are_its_summary_and_two_figures(tmp_path: Path) -> None:
    """summary.json holds what `summary` gives."""
    one = result([[0.1, 0.2], [0.3, 0.4]])
    files = write(one, tmp_path / "folder")
    assert [file.name for file in files] == ["summary.json", "errors.png", "errors.svg", "success.png", "success.svg"]
    assert json.loads(files[0].read_text()) == one.summary()
    (tmp_path / "file").write_text("")
    with pytest.raises(WmrError, match="cannot be written"):
        write(one, tmp_path / "file" / "folder")


def test_a_comparison_has_a_panel_for_each_unit_and_a_curve_for_each_law(tmp_path: Path) -> None:
    """The worst of the outputs of that unit in each run, in order, with the bound that was wanted; one legend."""
    wanted = SuccessTable(rms=0.35)
    one = result([[0.1, 0.2], [0.4, 0.3], [INF, INF]], [NAN, NAN, 1.0], success=wanted)
    three = {"y1": "m", "a": "rad", "y2": "m"}
    laws = {
        "x$": replace(one, outputs=three, runs=replace(one.runs, rms=np.array([[0.1, 9.0, 0.3], [0.2, 8.0, 0.1]]))),
        "other": replace(one, outputs=three, runs=replace(one.runs, rms=np.array([[0.5, 1.0, 0.3], [0.0, INF, 0.7]]))),
    }
    figure = draw_comparison(laws)
    metres, radians = figure.axes
    assert [axes.get_xlabel() for axes in figure.axes] == [f"RMS tracking error [{unit}]" for unit in ("m", "rad")]
    assert [axes.get_ylabel() for axes in figure.axes] == ["runs that stay below [%]", ""]
    assert [axes.get_legend() is None for axes in figure.axes] == [True, False]
    assert [text.get_text() for text in radians.get_legend().get_texts()] == [r"x\$", "other", "wanted"]
    curves = [[line.get_xdata() for line in axes.lines] for axes in figure.axes]
    np.testing.assert_array_equal(curves[0][0], [0.2, 0.3])
    np.testing.assert_array_equal(curves[0][1], [0.5, 0.7])
    np.testing.assert_array_equal(curves[1][0], [8.0, 9.0])
    np.testing.assert_array_equal(curves[1][1], [1.0])
    assert all(one[2][0] == 0.35 for one in curves)
    assert {axes.get_xscale() for axes in figure.axes} == {"log"}
    assert metres.get_shared_y_axes().joined(metres, radians)
    free = {name: replace(law, criteria=SuccessTable()) for name, law in laws.items()}
    assert [len(axes.lines) for axes in draw_comparison(free).axes] == [2, 2]
    files = write_comparison({"AFL": one}, tmp_path / "folder")
    assert [file.name for file in files] == ["comparison.json", "comparison.png", "comparison.svg"]
    assert all(file.is_file() for file in files)
    assert json.loads(files[0].read_text()) == {"AFL": one.brief()}


def test_an_error_of_nothing_is_on_no_logarithmic_axis() -> None:
    """But counts as a run below every bound."""
    curve = draw_errors(result([[0.0, 0.2], [0.3, 0.4]])).axes[0].lines[0]
    assert (curve.get_xdata().tolist(), curve.get_ydata().tolist()) == ([0.3], [100.0])


def test_errors_have_a_legend_and_their_units_once() -> None:
    """Outputs with units, and the bound where one is wanted."""
    one = result([[0.1, 0.2], [0.3, 0.4]])
    for criteria, more in ((SuccessTable(), []), (SuccessTable(rms=0.2), ["wanted"])):
        (axes,) = draw_errors(replace(one, criteria=criteria)).axes
        assert [text.get_text() for text in axes.get_legend().get_texts()] == ["y1 [m]", "y2 [rad]", *more]
        assert axes.get_xlabel() == "RMS tracking error [m, rad]"
        assert axes.get_xscale() == "log"
    (axes,) = draw_errors(replace(one, outputs={"y1": "m", "y2": "m"})).axes
    assert axes.get_xlabel() == "RMS tracking error [m]"


@pytest.mark.parametrize("count", [1, 2, 3, 4, 7])
def test_panels_of_success_stand_three_in_a_row(count: int) -> None:
    """As many as there are quantities; each holds the rate and its bounds at each place."""
    one = result([[0.1, 0.2], [0.3, 0.4], [INF, INF]], [NAN, NAN, 1.0])
    one.draws.clear()
    one.draws.update({f"q{i}": np.array([1.0, 2.0, 3.0]) * (i + 1) for i in range(count)})
    panels = draw_success(one).axes
    assert [axes.get_xlabel() for axes in panels] == list(one.draws)
    places = [axes.get_subplotspec() for axes in panels]
    assert [(place.rowspan.start, place.colspan.start) for place in places] == [divmod(i, 3) for i in range(count)]
    assert places[0].get_gridspec().nrows == -(-count // 3)
    for axes, column in zip(panels, one.draws.values(), strict=True):
        (bars,) = axes.containers
        np.testing.assert_array_equal(bars.lines[0].get_xdata(), column)
        np.testing.assert_array_equal(bars.lines[0].get_ydata(), [100.0, 100.0, 0.0])
        ends = np.array([line.vertices for line in bars.lines[2][0].get_paths()])[:, :, 1]
        _, low, high = wilson(1, 1, 0.95)
        np.testing.assert_allclose(ends[0], [100.0 * low, 100.0 * high])


@pytest.mark.parametrize(("values", "bins"), [(BINS - 1, BINS - 1), (BINS, BINS), (BINS + 1, BINS)])
def test_many_values_are_put_into_bins(values: int, bins: int) -> None:
    """Ten at most, with equally many runs, as near as that goes; the middle of each is its median."""
    column = np.repeat(np.arange(float(values)), 4)
    places, rates, bars = _binned(column[::-1], (column < 3.0)[::-1])
    assert len(places) == len(rates) == bars.shape[1] == bins
    assert np.all(np.diff(places) >= 0.0)
    assert (rates[0], rates[-1]) == (100.0, 0.0)
    assert np.all(bars >= 0.0)


def test_a_full_disk_is_told_with_the_file(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    def full(*_: object) -> None:
        raise OSError(28, "No space left on device")

    monkeypatch.setattr("wmr_input.whole_files.os.fsync", full)
    with pytest.raises(
        WmrError, match=r"summary.json: cannot be written .No space left.*make room or name another --out"
    ):
        write(result([[0.1, 0.2]]), tmp_path / "folder")
