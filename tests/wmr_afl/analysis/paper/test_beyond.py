"""Beyond the paper: each trouble is what it says, tables hold what runs come to, figures and report show them."""

import html
import re
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest

import wmr_afl
from tests.conftest import EXPERIMENTS
from wmr_afl.analysis.monte_carlo import Crowd, Scores
from wmr_afl.analysis.paper import beyond
from wmr_afl.analysis.paper.beyond import (
    CLAIMED,
    DELAYED,
    LAWS,
    LIMIT,
    NOISES,
    NOISY,
    ONE_ROBOT,
    SETTLED,
    SHIPPED,
    SLIP,
    Beyond,
    Sheet,
    Trouble,
    measure,
    travel,
)
from wmr_afl.analysis.paper.beyond_figures import CAPTIONS, FIRST, SLIPS, draw_beyond
from wmr_afl.analysis.paper.report import write_report
from wmr_afl.experiments.assembly import assemble
from wmr_afl.experiments.experiment import read_experiment

FEW = {name: LAWS[name] for name in ("AFL with leakage", "frozen (25), w = 40", "composite, pose alone")}
COUNT, OTHER_SEED = 2, 12


@pytest.fixture(scope="module")
def found() -> Beyond:
    """Two robots under three laws, without noise and delay."""
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(beyond, "LAWS", FEW)
        patch.setattr(beyond, "ONE_ROBOT", FEW)
        patch.setattr(beyond, "NOISY", {"frozen (25), w = 20": NOISY["frozen (25), w = 20"]})
        patch.setattr(beyond, "DELAYED", {"frozen (25), w = 15": DELAYED["frozen (25), w = 15"]})
        return measure(COUNT, "casadi", seed=OTHER_SEED)


def sheet(found: Beyond, words: str) -> Sheet:
    (one,) = [sheet for sheet in found.sheets if sheet.title.startswith(words)]
    return one


def with_laws(study: str, more: str, folder: Path) -> Path:
    """A study as a file with the three laws, as a reader would write it."""
    text = (EXPERIMENTS / f"{study}.toml").read_text()
    text = text.replace("[uncertainties]\n", f"[uncertainties]\n{more}", 1)
    leakage = (EXPERIMENTS / "study_2.toml").read_text().partition("[shared]")[2]
    shared = leakage.partition("[controllers.AFL]")[0].replace("adaptation", "unused").partition("\n")[2]
    shared = "\n".join(line for line in shared.splitlines() if not line.startswith("unused"))
    gains = next(line for line in leakage.splitlines() if "leakage = 0.001" in line)
    tables = {"AFL with leakage": f"{shared}\n{gains}", **{law: table for law, table in FEW.items() if table}}
    tables["frozen (25), w = 20"] = NOISY["frozen (25), w = 20"]
    told = "".join(f'[controllers."{law}"]\n{table}\n' for law, table in tables.items())
    (folder / f"{study}.toml").write_text(text.partition("[shared]")[0] + told)
    return folder / f"{study}.toml"


@pytest.mark.parametrize(
    ("study", "words", "more", "law"),
    [
        *(("study_2", "Study 2, ", "", law) for law in FEW),
        *(("study_3", "Study 3, ", "", law) for law in FEW),
        ("study_2", "Study 2 with noise", "measurement_noise = { deviation = 0.01 }\n", "frozen (25), w = 20"),
    ],
)
def test_a_table_holds_what_a_batch_comes_to(
    found: Beyond, study: str, words: str, more: str, law: str, tmp_path: Path
) -> None:
    """The same robots under the same law, from a file, by `run_batch`."""
    file = with_laws(study, more, tmp_path)
    loop = next(iter(assemble(*read_experiment("study_2")).values()))
    crowd = Crowd.drawn(loop, OTHER_SEED, COUNT)
    kind = "passivity_parameters" if "composite" in law else "base_parameters"
    scale = {**crowd.robots, **({} if law in SHIPPED else crowd.guesses[kind])}
    seeds = OTHER_SEED + np.arange(COUNT) if more else None
    batch = wmr_afl.run_batch(file, law, scale=scale, start=crowd.start, seeds=seeds, since=10.0, backend="casadi")
    mm = 1e3 * batch.rms.max(axis=1)
    expected = [f"{np.median(mm):.2f}", *2 * [f"{mm.max():.2f}"], f"{100 * np.mean(mm > 10.0):.1f}"]
    (row,) = [row for row in sheet(found, words).rows if row[0] == law and row[1] != "1 mm" and row[1] != "3 mm"]
    assert list(row[-5:-1]) == expected


def test_the_numbers_of_the_slip_are_of_its_seconds(found: Beyond) -> None:
    """Larger than before for every law; the whole run is between."""
    for law, scores in found.scores["study_3"].items():
        row = next(row for row in sheet(found, "Study 3 under slip").rows if row[0] == law)
        assert row[1:4] == tuple(f"{1e3 * value:.2f}" for value in np.quantile(scores.worse[1], [0.5, 1.0, 1.0]))
        assert np.all(scores.worse[1] > scores.worse[0])


def test_the_papers_robot_stands_beside_claim_and_limit(found: Beyond) -> None:
    """RMS of its run in x, y: whole, settled and while wheels slip; the paper's law begins with estimates of 1."""
    rows = {row[0]: row[1:] for row in sheet(found, "The paper's robot").rows}
    assert rows["the paper's claim"][0] == f"< {CLAIMED:g}, < {CLAIMED:g}"
    assert rows["clairvoyant limit"][:2] == (f"{LIMIT[0]}, {LIMIT[1]}", "0, 0")
    assert "not proved" in sheet(found, "The paper's robot").note
    usual = wmr_afl.run("study_2", controllers="AFL with leakage")["AFL with leakage"]
    np.testing.assert_allclose(found.runs["study_2"]["AFL with leakage"].state, usual.state, rtol=1e-9, atol=1e-9)
    for law, run in found.runs["study_2"].items():
        whole, settled, slip, path = rows[law]
        for text, one, window in (
            (whole, run, (0.0, np.inf)), (settled, run, SETTLED), (slip, found.runs["study_3"][law], SLIP)
        ):  # fmt: skip
            assert text == ", ".join(f"{1e3 * value:.3g}" for value in one.rms(*window))
        late = run.time >= 10.0
        assert travel(run) == pytest.approx(np.abs(np.diff(run.input[late], axis=0)).sum() / 2.0 / 130.0)
        assert path == f"{travel(run):.0f}"
        if "composite" not in law:
            np.testing.assert_array_equal(run.estimate[0], np.ones(6))


def test_no_run_is_better_than_the_limit(found: Beyond) -> None:
    """Over the whole run and both outputs, which is what was minimized."""
    for run in found.runs["study_2"].values():
        assert np.hypot(*(1e3 * run.rms())) > np.hypot(*LIMIT)


def test_each_trouble_is_one_thing_more() -> None:
    """With everything else as it was."""
    plain = assemble(*Trouble().experiment(ONE_ROBOT))
    noisy = assemble(*Trouble(noise=0.02, seed=4).experiment(ONE_ROBOT))
    late = assemble(*Trouble(delay=0.04).experiment(ONE_ROBOT))
    heavy = assemble(*Trouble(payload_at=70.0).experiment(ONE_ROBOT))
    slips = assemble(*Trouble("study_3").experiment(ONE_ROBOT))
    shipped = assemble(*read_experiment("study_2"))
    assert list(plain) == list(ONE_ROBOT)
    for name, loop in plain.items():
        assert set(noisy[name].values) - set(loop.values) == {"measurement_noise.deviation"}
        np.testing.assert_array_equal(noisy[name].values["measurement_noise.deviation"], np.full(5, 0.02))
        assert noisy[name].plant.seed == 4
        assert late[name].states["input_delay.under_way"].shape == (4,)
        assert set(heavy[name].values) - set(loop.values) == {"payload.time", "payload.parameters"}
        assert heavy[name].values["payload.time"] == [70.0]
        doubled = heavy[name].values["payload.parameters"] / heavy[name].plant.parameters
        units = loop.model.parameter_units.values()
        np.testing.assert_array_equal(doubled, [2.0 if unit in ("kg", "kg m^2") else 1.0 for unit in units])
        besides = [[part.name for part in one.plant.uncertainties] for one in (loop, slips[name])]
        assert sorted(besides[1]) == sorted([*besides[0], "lateral_slip"])
        if name in SHIPPED:
            assert set(loop.values) == set(shipped[name].values)
            for key, value in shipped[name].values.items():
                np.testing.assert_array_equal(loop.values[key], value)


def test_how_many_robots_there_are_follows_from_the_compiler(monkeypatch: pytest.MonkeyPatch) -> None:
    """Fewer without one; what is asked for is done in any case; progress says what is run."""
    seen: list[Any] = []

    class Stub(Crowd):
        def score(self, experiment, law, loop, windows, threads=1, backend="auto"):
            seen.append((len(self.seeds), backend))
            return Scores(np.ones((2, len(self.seeds), 2)), np.ones(len(self.seeds)))

    monkeypatch.setattr(beyond, "Crowd", Stub)
    monkeypatch.setattr(beyond, "one_robot", lambda trouble, laws, backend: {})
    cells = 2 * len(LAWS) + len(NOISES) * len(NOISY) + len(DELAYED)
    for has_compiler, runs, backend, expected in (
        (True, None, "auto", (beyond.RUNS, "auto")), (False, None, "auto", (beyond.INTERPRETED_RUNS, "casadi")),
        (True, None, "numpy", (beyond.INTERPRETED_RUNS, "casadi")), (False, 7, "auto", (7, "casadi")),
        (True, 9, "compiled", (9, "compiled")),
    ):  # fmt: skip
        monkeypatch.setattr(beyond, "compiler", lambda has=has_compiler: ("cc",) if has else None)
        told: list[str] = []
        seen.clear()
        result = measure(runs, backend, report=told.append)
        assert set(seen) == {expected}
        assert len(seen) == cells
        assert result.count == expected[0]
        assert f"{expected[0]} robots, noise 1 cm, composite, pose alone" in told
        assert all(f"{expected[0]} robots" in one.title for one in result.sheets[2:])


def test_failed_robots_are_counted_and_are_the_worst() -> None:
    """Infinite in the table, above every bound, and not in the curve."""
    rms = np.array([[[0.001, 0.002], [0.02, 0.001], [np.inf, np.inf], [0.004, 0.003]]])
    scores = Scores(rms, np.array([1.0, 3.0, np.inf, 2.0]))
    assert beyond.judged(scores) == ("12.00", "inf", "inf", "50.0", "2")


def test_errors_are_drawn_with_their_transients(found: Beyond) -> None:
    """Some seconds as they are, whole runs as RMS over a period of the force; the slip is shaded."""
    figure = draw_beyond("beyond_errors", found)
    first, whole, slips, whole_slip = figure.axes
    for axes, study, window in ((first, "study_2", FIRST), (slips, "study_3", SLIPS)):
        for line, run in zip(axes.get_lines(), found.runs[study].values(), strict=True):
            inside = (run.time >= window[0]) & (run.time <= window[1])
            np.testing.assert_array_equal(line.get_xdata(), run.time[inside])
            np.testing.assert_allclose(line.get_ydata(), 1e3 * np.linalg.norm(run.error, axis=1)[inside])
    for axes, study in ((whole, "study_2"), (whole_slip, "study_3")):
        for line, run in zip(axes.get_lines(), found.runs[study].values(), strict=True):
            t, y = (np.asarray(data) for data in line.get_data())
            last = run.time > t[-1] - 2.0 * np.pi / 3.0
            assert t[-1] == run.time[-1]
            assert y[-1] == pytest.approx(1e3 * np.sqrt(np.mean(np.sum(run.error[last] ** 2, axis=1))), rel=1e-9)
    assert {text.get_text() for text in figure.legends[0].get_texts()} == set(FEW)
    assert whole_slip.patches
    assert not whole.patches
    assert FIRST[0] == 0.0 < FIRST[1]
    assert SLIPS[0] < SLIP[0] < SLIPS[1] < SLIP[1]  # when the wheels begin to slip
    smoothed = "RMS over one period of the force"
    titles = ["the first seconds", smoothed, "when the wheels begin to slip", smoothed]
    assert [axes.get_title(loc="left") for axes in figure.axes] == titles
    assert [axes.get_ylabel() for axes in figure.axes] == ["study 2: distance [mm]", "", "study 3: distance [mm]", ""]
    assert [axes.get_xlabel() for axes in figure.axes] == ["", "", "time [s]", "time [s]"]
    assert [[text.get_text() for text in axes.texts] for axes in figure.axes] == [[], [], [], ["slip"]]
    assert {axes.get_yscale() for axes in figure.axes} == {"log"}
    assert (first.get_xlim(), slips.get_xlim(), figure._suptitle.get_text()) == (
        FIRST,
        SLIPS,
        CAPTIONS["beyond_errors"],
    )


def test_curves_are_the_share_of_robots_below_an_error(found: Beyond) -> None:
    """Since 10 s in study 2, while the wheels slip in study 3."""
    figure = draw_beyond("beyond_robots", found)
    for axes, study, window in zip(figure.axes, ("study_2", "study_3"), (0, 1), strict=True):
        for line, scores in zip(axes.get_lines(), found.scores[study].values(), strict=True):
            np.testing.assert_allclose(line.get_xdata(), 1e3 * np.sort(scores.worse[window]))
            np.testing.assert_allclose(line.get_ydata(), [50.0, 100.0])
    titles = [f"{which}, {found.count} robots" for which in ("study 2, since 10 s", "study 3, while the wheels slip")]
    assert [axes.get_title(loc="left") for axes in figure.axes] == titles
    assert {axes.get_xlabel() for axes in figure.axes} == {"RMS error of the worse output [mm]"}
    assert [axes.get_ylabel() for axes in figure.axes] == ["robots that stay below [%]", ""]
    assert {axes.get_xscale() for axes in figure.axes} == {"log"}
    assert [text.get_text() for text in figure.legends[0].get_texts()] == list(found.scores["study_2"])
    assert figure._suptitle.get_text() == CAPTIONS["beyond_robots"]


def test_the_report_holds_every_table_figure_and_law(found: Beyond, tmp_path: Path) -> None:
    """And nothing of it where it was not measured."""
    pictures = {name: tmp_path / f"{name}.png" for name in CAPTIONS}
    for png in pictures.values():
        png.write_bytes(b"picture")
    page = write_report({}, {"fig4": png, **pictures}, found, tmp_path / "report.html").read_text()
    assert page.count("<img") == len(CAPTIONS)  # the paper's figures stand with its studies
    told = html.unescape(re.sub(r"<[^>]*>", "", page))
    for one in found.sheets:
        assert one.title in told
        assert one.note in told
        for row in one.rows:
            assert "".join(f"<td>{html.escape(cell, quote=False)}</td>" for cell in row) in page.replace("&#39;", "'")
    for name, caption in CAPTIONS.items():
        assert f'alt="{caption}"' in page, name
    for law, table in {**ONE_ROBOT, **NOISY, **DELAYED}.items():
        assert (f'[controllers."{law}"]\n{table}' in told) == bool(table)
    assert "Beyond" not in write_report({}, {}, None, tmp_path / "alone.html").read_text()


def test_a_run_that_ended_says_so_in_its_cells() -> None:
    """Instead of numbers."""
    failed = SimpleNamespace(failure="stopped at t = 3 s: diverged", time=np.arange(3.0))

    def rms(since: float, until: float) -> None:
        raise wmr_afl.SimulationError("a run failed", "look at it")

    failed.rms = rms
    single: Any = {study: {"law": failed} for study in ("study_2", "study_3")}
    paper, more = beyond._of_the_paper(single), beyond._in_more_trouble(single["study_2"], {"noise": single["study_2"]})
    assert paper.rows[-1] == ("law", *3 * (failed.failure,), "")
    assert more.rows == (("law", *2 * (failed.failure,)),)
