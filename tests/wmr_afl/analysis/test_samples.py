"""Samples and figures of runs hold each signal under its own name."""

import csv
import json
from dataclasses import replace
from itertools import pairwise
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from wmr_afl.analysis import plots
from wmr_afl.analysis.files import check_writable, columns, write_results
from wmr_afl.analysis.metrics import metrics
from wmr_afl.model.model import load_model
from wmr_afl.simulation.result import Failure, Run
from wmr_input import WmrError

MODEL = load_model("type_2_0")
TIME = np.linspace(0.0, 1.0, 11)


def run(seed: int = 0, **changed: Any) -> Run:
    """A run whose every number is a number of its own."""
    random = np.random.default_rng(seed)
    sizes = {"state": 5, "input": 2, "command": 2, "error": 2, "estimate": 6, "reference": 2}
    signals = {name: random.normal(size=(len(TIME), size)) for name, size in sizes.items()}
    one = {"parameters": MODEL.parameters(), "known": np.ones(1), **signals, **changed}
    return Run("AFL", MODEL, TIME, **one)


def test_a_table_of_samples_holds_every_signal_under_its_name(tmp_path: Path) -> None:
    """Read back to the bit: applied voltages under the inputs' names, commands under their own."""
    one = run()
    files = write_results({"the AFL": one}, tmp_path)
    assert [file.name for file in files] == ["the_AFL.csv", "metrics.json"]
    with open(files[0], encoding="utf-8", newline="") as stream:
        header, *rows = csv.reader(stream)
    assert header == columns(one)
    table = dict(zip(header, np.array(rows, dtype=float).T, strict=True))
    signals = {
        "": (one.state, MODEL.state_units), " ": (one.input, MODEL.input_units),
        "command_": (one.command, MODEL.input_units), "reference_": (one.reference, MODEL.output_units),
        "error_": (one.error, MODEL.output_units), "estimate_": (one.estimate, MODEL.base_parameter_units),
    }  # fmt: skip
    np.testing.assert_array_equal(table["time [s]"], TIME)
    for before, (signal, units) in signals.items():
        for column, (name, unit) in zip(signal.T, units.items(), strict=True):
            np.testing.assert_array_equal(table[f"{before.strip()}{name} [{unit}]"], column)
    assert len(table) == 1 + sum(len(units) for _, units in signals.values())
    assert json.loads(files[1].read_text()) == {"the AFL": metrics(one)}


def test_a_folder_that_cannot_be_written_is_known_before_the_work(tmp_path: Path) -> None:
    """It may not be there yet, but nothing on its way is a file."""
    check_writable(tmp_path)
    check_writable(tmp_path / "a" / "b")
    (tmp_path / "file").write_text("")
    for wrong in (tmp_path / "file", tmp_path / "file" / "a" / "b"):
        with pytest.raises(WmrError, match="file: cannot be written"):
            check_writable(wrong)


def test_deviations_stand_beside_the_estimates(tmp_path: Path) -> None:
    """In the table of samples, in the metrics, and as bands around each estimate with the true value."""
    deviation = np.linspace(1.0, 0.4, 11)[:, None] * np.arange(1.0, 7.0)
    deviation[-1, 3] = 0.6 * deviation[0, 3]
    one = run(estimated="passivity_parameters", deviation=deviation)
    files = write_results({"a": one}, tmp_path)
    header, *rows = csv.reader(files[0].read_text().splitlines())
    table = dict(zip(header, np.array(rows, dtype=float).T, strict=True))
    units = MODEL.units_of("passivity_parameters")
    for index, (name, unit) in enumerate(units.items()):
        np.testing.assert_array_equal(table[f"deviation_{name} [{unit}]"], deviation[:, index])
    found = metrics(one)
    np.testing.assert_allclose(list(found["deviation"].values()), deviation[-1])
    np.testing.assert_allclose(list(found["estimate"].values()), one.estimate[-1])
    assert found["undetermined"] == ["pi4"]
    figure = plots.overview({"a": one}, "title")["estimates_a"]
    panels = [axes for axes in figure.axes if axes.get_title(loc="left")]
    assert len(panels) == len(units)
    for index, axes in enumerate(panels):
        (band,) = axes.collections
        corners = band.get_paths()[0].vertices
        for half in (-deviation[:, index], deviation[:, index]):
            edge = np.column_stack([TIME, one.estimate[:, index] + half])
            assert all((np.abs(corners - corner).max(axis=1) < 1e-12).any() for corner in edge)
        line, true = axes.get_lines()
        np.testing.assert_array_equal(line.get_ydata(), one.estimate[:, index])
        assert true.get_ydata()[0] == MODEL.passivity_parameters(one.parameters)[index]


def lines(axes: Any) -> dict[str, np.ndarray]:
    """The lines of a plot that have a name, (samples, 2)."""
    named = [line for line in axes.get_lines() if not line.get_label().startswith("_")]
    return {line.get_label(): np.column_stack([line.get_xdata(), line.get_ydata()]) for line in named}


def test_plots_show_what_their_labels_say() -> None:
    """Path, outputs, errors, inputs, estimates of each run, with names and units at the axes."""
    runs = {"a": run(1), "b": run(2)}
    figure = plots.new_figure(5.0, 4.0)
    path, output, error, inputs, estimates = figure.subplots(5, 1)
    plots.draw_path(path, runs)
    plots.draw_output(output, runs, 1)
    plots.draw_error(error, runs, 1)
    plots.draw_inputs(inputs, runs["b"])
    plots.draw_estimates(estimates, runs["b"], np.arange(6.0))
    for name, one in runs.items():
        np.testing.assert_array_equal(lines(path)[name], one.output[:, :2])
        np.testing.assert_array_equal(lines(output)[name], np.column_stack([TIME, one.output[:, 1]]))
        np.testing.assert_array_equal(lines(error)[name], np.column_stack([TIME, one.error[:, 1]]))
    np.testing.assert_array_equal(lines(path)["reference"], runs["a"].reference)
    np.testing.assert_array_equal(lines(output)["reference"], np.column_stack([TIME, runs["a"].reference[:, 1]]))
    for index, name in enumerate(MODEL.input_units):
        np.testing.assert_array_equal(lines(inputs)[name][:, 1], runs["b"].input[:, index])
    drawn = estimates.get_lines()
    np.testing.assert_array_equal(drawn[4].get_ydata(), runs["b"].estimate[:, 2])
    assert drawn[5].get_ydata()[0] == 2.0
    assert drawn[0].get_label() == r"$\hat\theta_{1}$"
    assert (path.get_xlabel(), path.get_ylabel()) == ("y1 [m]", "y2 [m]")
    assert (output.get_ylabel(), error.get_ylabel()) == ("y2 [m]", "error of y2 [m]")
    starts = [line for line in path.get_lines() if line.get_marker() == "o"]
    np.testing.assert_array_equal([line.get_xdata()[0] for line in starts], [one.output[0, 0] for one in runs.values()])


def test_the_longest_run_gives_the_reference() -> None:
    """A run that failed early does not shorten it."""
    whole, short = run(1), run(2)
    names = ("time", "state", "input", "command", "error", "estimate", "reference")
    failed = replace(short, failure=Failure(0.3, "why"), **{name: getattr(short, name)[:3] for name in names})
    figure = plots.new_figure(5.0, 4.0)
    path, output = figure.subplots(2, 1)
    plots.draw_path(path, {"failed": failed, "whole": whole})
    plots.draw_output(output, {"failed": failed, "whole": whole}, 0)
    assert len(lines(path)["reference"]) == len(lines(output)["reference"]) == len(TIME)


def test_an_overview_has_a_figure_for_each_kind_of_signal() -> None:
    """Estimates of those that adapt, a path if there are two outputs."""
    still = run(3, estimate=np.ones((len(TIME), 6)))
    figures = plots.overview({"a": run(1), "still": still}, "title $ _")
    assert set(figures) == {"path", "errors", "inputs", "estimates_a"}
    assert len(figures["errors"].axes) == 2
    assert [axes.get_title(loc="left") for axes in figures["inputs"].axes] == ["a", "still"]
    assert figures["errors"]._suptitle.get_text() == r"title \$ _"


@pytest.mark.parametrize(
    ("text", "shown"), [("AFL", "AFL"), ("$x$", r"\$x\$"), ("_hidden", "hidden"), ("__", "(__)"), ("", "()")]
)
def test_a_text_is_drawn_as_it_was_written(text: str, shown: str) -> None:
    """No mathematics, no hidden entry of a legend."""
    assert plots.verbatim(text) == shown


def test_colours_and_dashes_start_again_after_the_last(tmp_path: Path) -> None:
    """Seven colours and four dashes, so that up to 28 runs differ; the first lies above the others."""
    styles = [plots.style_of(index) for index in range(28)]
    assert len({(style["color"], style["linestyle"]) for style in styles}) == 28
    assert plots.style_of(28)["color"] == plots.style_of(0)["color"]
    assert all(one["zorder"] > other["zorder"] for one, other in pairwise(styles))
    files = plots.save(plots.new_figure(1.0, 1.0), tmp_path / "a" / "b.c")
    assert [file.name for file in files] == ["b.c.png", "b.c.svg"]
    (tmp_path / "file").write_text("")
    with pytest.raises(WmrError, match="cannot be written"):
        plots.save(plots.new_figure(1.0, 1.0), tmp_path / "file" / "b")
