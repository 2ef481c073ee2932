"""The figures and files of a campaign, from results that are made by hand."""

import json
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from tests.wmr_afl.experiments.campaigns.handmade import INF, NAN, result
from wmr_afl.analysis.campaign_plots import BINS, _binned, draw_comparison, draw_errors, draw_success, write
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
