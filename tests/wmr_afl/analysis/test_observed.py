"""The figure of what an observer sees."""

import numpy as np

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
