"""The figure of what an observer sees, and panels that share the time below them."""

from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest

from tests.wmr_afl.analysis.test_samples import MODEL, TIME, run
from wmr_afl.analysis import plots


def test_velocities_and_what_was_not_expected_are_drawn() -> None:
    """A panel for each entry that is not measured, true and observed, and one for each output's d^, with units."""
    random = np.random.default_rng(4)
    n = MODEL.coordinate_count
    observed = np.hstack([run().state[:, :n], random.normal(size=(len(TIME), 2))])
    one = run(observed=observed, unexpected=random.normal(size=(len(TIME), 2)))
    panels = plots.overview({"a": one}, "title")["observed_a"].axes
    assert [axes.get_ylabel() for axes in panels] == [
        "v [m/s]", "omega [rad/s]", "unexpected of\ny1 [m/s^2]", "unexpected of\ny2 [m/s^2]"
    ]  # fmt: skip
    for index, axes in enumerate(panels[:2]):
        true, seen = axes.get_lines()
        np.testing.assert_array_equal(seen.get_ydata(), one.observed[:, n + index])
        np.testing.assert_array_equal(true.get_ydata(), one.state[:, n + index])
    for index, axes in enumerate(panels[2:]):
        np.testing.assert_array_equal(axes.get_lines()[0].get_ydata(), one.unexpected[:, index])
    assert "observed_a" not in plots.overview({"a": run()}, "title")
    blind = run(observed=observed + np.array([0.0, 0.0, 1e-9, 0.0, 0.0]), unexpected=one.unexpected)
    first = plots.overview({"a": blind}, "title")["observed_a"].axes[0]
    assert first.get_ylabel() == "phi [rad]"


def test_slip_is_drawn_over_what_it_is() -> None:
    """A panel for each wheel and direction; what is not known is not drawn."""
    random = np.random.default_rng(5)
    slip, true = random.normal(size=(2, len(TIME), 2))
    names = ("right sideways", "left along")
    panels = plots.overview({"a": run(slip=slip, slip_true=true, slip_names=names)}, "title")["slip_a"].axes
    assert [axes.get_ylabel() for axes in panels] == ["right slips\nsideways [m/s]", "left slips\nalong [m/s]"]
    for index, axes in enumerate(panels):
        drawn = {line.get_label(): line.get_ydata() for line in axes.get_lines()}
        np.testing.assert_array_equal(drawn["measured"], slip[:, index])
        np.testing.assert_array_equal(drawn["of the robot"], true[:, index])
    told = [text.get_text() for text in panels[0].get_legend().get_texts()]
    assert told == [line.get_label() for line in panels[0].get_lines()]
    assert [axes.get_legend() for axes in panels[1:]] == [None] * (len(panels) - 1)
    alone = plots.overview({"a": run(slip=slip, slip_names=names)}, "title")["slip_a"].axes
    assert [len(axes.get_lines()) for axes in alone] == [1, 1]
    assert "slip_a" not in plots.overview({"a": run()}, "title")


def test_below_the_lowest_panel_of_each_figure_over_time_stands_time() -> None:
    """And above each figure the title of the experiment."""
    signals = {"observed": np.ones((len(TIME), 5)), "unexpected": np.ones((len(TIME), 2))}
    figures = plots.overview({"a": run(**signals), "b": run(2)}, "a title")
    assert {"errors", "inputs", "estimates_a", "observed_a"} <= set(figures)
    for name, figure in figures.items():
        assert figure.get_suptitle() == "a title"
        lowest = min(figure.axes, key=lambda axes: axes.get_position().y0)
        assert (lowest.get_xlabel() == "time [s]") == (name != "path")


@pytest.mark.parametrize("count", [1, 2, 3, 4, 5, 7])
def test_below_each_column_of_estimates_stand_times(count: int) -> None:
    """Numbers and their unit, at the lowest panel of each column and at no other; three columns at most."""
    random = np.random.default_rng(count)
    units = {f"pi{i + 1}": "kg" for i in range(count)}
    library = SimpleNamespace(pi=lambda p: np.arange(float(count)))
    model = SimpleNamespace(in_library=lambda name: library, formulas_of=lambda kind: dict.fromkeys(units, "m**2"))
    signals = random.normal(size=(2, len(TIME), count))
    one: Any = SimpleNamespace(
        time=TIME, estimate=signals[0], deviation=signals[1], estimate_units=units, estimated="pi", model=model,
        parameters=None,
    )  # fmt: skip
    panels = plots._estimates(one).axes
    assert [axes.get_title(loc="left") for axes in panels] == [rf"$\hat\pi_{{{i + 1}}}$ = m^2" for i in range(count)]
    assert [axes.get_ylabel() for axes in panels] == count * ["[kg]"]
    places = [axes.get_subplotspec() for axes in panels]
    assert {place.colspan.start for place in places} == set(range(min(3, count)))
    for axes, place in zip(panels, places, strict=True):
        is_lowest = place.rowspan.start == max(
            other.rowspan.start for other in places if other.colspan.start == place.colspan.start
        )
        assert axes.xaxis.get_tick_params()["labelbottom"] == is_lowest
        assert axes.get_xlabel() == ("time [s]" if is_lowest else "")
    assert [axes.get_lines()[1].get_ydata()[0] for axes in panels] == list(range(count))


def test_a_long_formula_above_a_panel_is_cut_and_a_short_one_is_not() -> None:
    """To as many characters as there is room for, dots included."""
    for length in (plots.LONGEST - 1, plots.LONGEST, plots.LONGEST + 1, 90):
        formula = "a" * length
        model = SimpleNamespace(
            in_library=lambda name: SimpleNamespace(pi=lambda p: np.ones(1)),
            formulas_of=lambda kind, formula=formula: {"b": formula},
        )
        one: Any = SimpleNamespace(
            time=TIME, estimate=np.ones((len(TIME), 1)), deviation=None, estimate_units={"b": "m"}, estimated="pi",
            model=model, parameters=None,
        )  # fmt: skip
        axes = plots.new_figure(2.0, 2.0).subplots()
        plots.draw_estimate(axes, one, 0)
        shown = axes.get_title(loc="left").removeprefix("b = ")
        assert len(shown) == min(length, plots.LONGEST)
        assert shown == (formula if length <= plots.LONGEST else formula[: plots.LONGEST - 3] + "...")
        assert not axes.collections  # no band without a deviation


def test_panels_one_below_the_other_share_their_time_and_their_legend() -> None:
    """Of errors and inputs; only the lowest has its numbers, and only the first a legend for all."""
    figures = plots.overview({"a": run(1), "b": run(2)}, "title")
    for name, count in (("errors", 2), ("inputs", 2)):
        panels = figures[name].axes
        assert len(panels) == count
        assert [axes.xaxis.get_tick_params()["labelbottom"] for axes in panels] == [False, True]
        assert panels[0].get_shared_x_axes().joined(*panels)
    legend = figures["errors"].axes[0].get_legend()
    assert [text.get_text() for text in legend.get_texts()] == ["a", "b"]
    assert figures["errors"].axes[1].get_legend() is None
    for axes in figures["inputs"].axes:
        assert [text.get_text() for text in axes.get_legend().get_texts()] == list(MODEL.input_units)
    path = figures["path"].axes[0]
    assert [text.get_text() for text in path.get_legend().get_texts()] == ["reference", "a", "b"]
    assert path.get_aspect() == 1.0


def test_what_is_observed_has_a_legend_and_is_drawn_of_runs_with_samples_only() -> None:
    """Velocities of the robot are shown even where nothing was observed; without a run there is no figure."""
    one = run(observed=np.ones((len(TIME), 5)), unexpected=np.ones((len(TIME), 2)))
    panels = plots.overview({"a": one}, "title")["observed_a"].axes
    assert [text.get_text() for text in panels[0].get_legend().get_texts()] == ["of the robot", "observed"]
    assert [axes.get_legend() for axes in panels[1:]] == (len(panels) - 1) * [None]
    assert panels[0].get_shared_x_axes().joined(panels[0], panels[-1])
    with pytest.raises(plots.WmrError, match="there is nothing to draw; give a run"):
        plots.overview({}, "title")
    bare = plots._observed(run())
    assert [axes.get_ylabel().split()[0] for axes in bare.axes] == ["v", "omega", "unexpected", "unexpected"]
    assert [len(axes.get_lines()) for axes in bare.axes] == [1, 1, 0, 0]


def test_many_estimates_differ_by_dashes_once_colours_are_used_up() -> None:
    """In one panel, the true values dotted in the same colour."""
    count = 2 * len(plots.COLOURS) + 1
    one: Any = SimpleNamespace(
        time=TIME, estimate=np.ones((len(TIME), count)), estimate_units={f"theta{i}": "1" for i in range(count)}
    )
    axes = plots.new_figure(4.0, 3.0).subplots()
    plots.draw_estimates(axes, one, np.arange(float(count)))
    drawn = axes.get_lines()
    estimates, true = drawn[::2], drawn[1::2]
    assert len({(line.get_color(), line.get_linestyle()) for line in estimates}) == count
    assert [line.get_color() for line in estimates[:7]] == list(plots.COLOURS)
    assert [line.get_color() for line in true] == [line.get_color() for line in estimates]
    assert {line.get_linestyle() for line in true} == {":"}
    assert len(axes.get_legend().get_texts()) == count
    assert (axes.get_xlabel(), axes.get_ylabel()) == ("time [s]", "estimated base parameters")


def test_names_of_panels_one_below_the_other_stand_in_a_line() -> None:
    """However wide the numbers beside them are."""
    random = np.random.default_rng(6)
    wide = np.array([1.0, 1e3])
    signals = {"observed": random.normal(size=(len(TIME), 5)), "unexpected": random.normal(size=(len(TIME), 2)) * wide}
    slip = {"slip": random.normal(size=(len(TIME), 2)) * wide, "slip_names": ("right along", "left along")}
    figures = plots.overview({"a": run(error=random.normal(size=(len(TIME), 2)) * wide, **signals, **slip)}, "title")
    for name in ("errors", "observed_a", "slip_a"):
        figures[name].canvas.draw()
        ends = [axes.yaxis.label.get_window_extent().x1 for axes in figures[name].axes]
        assert np.ptp(ends) < 0.5, name
