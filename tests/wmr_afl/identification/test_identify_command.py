"""What `wmr-afl identify` prints, writes and ends with."""

import csv
import re
import tomllib
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from typer.testing import CliRunner, Result

from tests.conftest import EXPERIMENTS
from tests.wmr_afl.identification.logs import (
    FRICTION,
    GEOMETRY,
    SMALL,
    STEP,
    effort_of,
    logged,
    multisine,
    small_drive,
    write,
)
from wmr_afl import run
from wmr_afl.analysis.identification_report import open_ends, toml_text, write_identification
from wmr_afl.cli import app, terminal
from wmr_afl.errors import InputError, WmrError
from wmr_afl.experiments.experiment import find_experiment
from wmr_afl.experiments.load import load_experiment
from wmr_afl.identification.identified import Identified
from wmr_afl.identification.identify import identify
from wmr_afl.identification.log import Log, log_of
from wmr_afl.identification.log_file import read_logs

ROBOT = "type_2_0"
SET = [f"--set={name}={value}" for name, value in GEOMETRY.items()]
Rows = list[list[str]]


@pytest.fixture(autouse=True)
def _here(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """Lines are not wrapped, and what is written without a place is written here."""
    for console in (terminal.console, terminal.errors):
        monkeypatch.setattr(console, "_width", 300)
    monkeypatch.chdir(tmp_path)


@pytest.fixture(scope="module")
def drive() -> Log:
    return small_drive()


@pytest.fixture(scope="module")
def found(drive: Log) -> Identified:
    return identify(ROBOT, drive, parameters=GEOMETRY)


def call(*arguments: object) -> Result:
    return CliRunner().invoke(app, ["identify", *map(str, arguments)])


def refused(*arguments: object) -> str:
    """The one line with which a command ends that writes nothing."""
    before = sorted(Path().rglob("*"))
    result = call(*arguments)
    assert (result.exit_code, result.stdout) == (2, ""), result.output
    assert sorted(Path().rglob("*")) == before
    (line,) = result.stderr.splitlines()
    return line


def column(rows: Rows, name: str) -> int:
    return rows[0].index(name)


def renamed(old: str, new: str) -> Callable[[Rows], None]:
    def change(rows: Rows) -> None:
        rows[0][column(rows, old)] = new

    return change


def without(name: str) -> Callable[[Rows], None]:
    def change(rows: Rows) -> None:
        at = column(rows, name)
        for row in rows:
            del row[at]

    return change


def cell(row: int, name: str, text: str) -> Callable[[Rows], None]:
    def change(rows: Rows) -> None:
        rows[row][column(rows, name)] = text

    return change


def shorter(count: int) -> Callable[[Rows], None]:
    def change(rows: Rows) -> None:
        del rows[count + 1 :]

    return change


def filled(**texts: str) -> Callable[[Rows], None]:
    """Columns (`angle_u_r` is angle:u_r) with the same text in every row."""

    def change(rows: Rows) -> None:
        for name, text in texts.items():
            at = column(rows, name.replace("angle_", "angle:"))
            for row in rows[1:]:
                row[at] = text

    return change


def separated(by: str) -> Callable[[Rows], None]:
    def change(rows: Rows) -> None:
        rows[:] = [[by.join(row)] for row in rows]

    return change


CELL = "write a number, or leave the row out"
POSITION = (
    "x alone does not tell how the robot moves; add encoders and gyroscope (angle:u_r, angle:u_l, rate:phi), or what "
    "there is of them"
)
NAMES = "segment, t, u_r, u_l, angle:u_r, rate:u_r, angle:u_l, rate:u_l, x, y, phi, v, omega, rate:x, rate:y, rate:phi"
WRONG: dict[str, tuple[Callable[[Rows], None], str]] = {
    "a missing column": (without("u_l"), "log.csv: column u_l: is missing; add the voltage of each motor of type_2_0"),
    "no time": (without("t"), "log.csv: column t: is missing; add the time of each row in seconds"),
    "an unknown column": (
        renamed("angle:u_l", "angel:u_l"),
        f"log.csv: unknown column 'angel:u_l'; did you mean 'angle:u_l'? (there is {NAMES})",
    ),
    "degrees": (renamed("angle:u_l", "phi [deg]"), "log.csv: column phi: is in deg; convert it to rad"),
    "nothing measured": (
        lambda rows: [without(f"angle:{motor}")(rows) for motor in ("u_r", "u_l")].clear(),
        "log.csv: the log measures no motion; add encoders and gyroscope (angle:u_r, angle:u_l, rate:phi), or what "
        "there is of them",
    ),
    "a position only": (
        lambda rows: [change(rows) for change in (without("angle:u_r"), renamed("angle:u_l", "x"))].clear(),
        POSITION,
    ),
    "semicolons": (
        separated(";"),
        "log.csv: line 1: has semicolons between its cells; write commas between cells, and points in numbers",
    ),
    "tabs": (
        separated("\t"),
        "log.csv: line 1: has tabs between its cells; write commas between cells, and points in numbers",
    ),
    "time backwards": (
        cell(100, "t", "0.5"),
        "log.csv: time goes backwards at t = 0.5 s (row 100); order the rows, and name tests that were run one after "
        "another in a column `segment`",
    ),
    "not a number": (cell(7, "u_r", "nan"), f"log.csv: line 8, column u_r: holds 'nan'; {CELL}"),
    "a word": (cell(7, "u_r", "off"), f"log.csv: line 8, column u_r: holds 'off'; {CELL}"),
    "rest": (
        filled(u_r="0", u_l="0", angle_u_r="0", angle_u_l="0"),
        "the motors never have any voltage; log the voltages that the motors had",
    ),
    "standstill under voltage": (
        filled(angle_u_r="0", angle_u_l="0"),
        "angle:u_r, angle:u_l stand still although the motors have voltage; connect the encoders",
    ),
    "constant voltage": (
        filled(u_r="6", u_l="5"),
        "the voltages never change; vary them, as `wmr-afl excite` proposes, or begin at rest with 0 V",
    ),
    "too short": (shorter(60), "the log lasts 1.2 s, and 2 s are the least; log 20 s of motion, better 60"),
    "header only": (shorter(0), "the log lasts 0 s, and 2 s are the least; log 20 s of motion, better 60"),
}


@pytest.mark.parametrize("name", WRONG)
def test_a_wrong_log_ends_in_one_line(name: str, drive: Log) -> None:
    change, line = WRONG[name]
    write(drive, Path("log.csv"), change)
    assert refused(ROBOT, "log.csv", *SET) == f"error: {line}"


def test_voltages_at_their_limit_throughout_are_refused() -> None:
    """Switched between the largest ones: what was cut cannot be told."""
    u = 9.0 * np.sign(multisine(20.0, 2, 1.0) + 1e-9)
    write(logged(effort_of(ROBOT, **SMALL), u), Path("log.csv"))
    expected = "error: the voltages are at their largest (9, 9 V) throughout; log with less, so that none is cut"
    assert refused(ROBOT, "log.csv", *SET) == expected


@pytest.mark.parametrize(
    ("arguments", "line"),
    [
        (["type_9", "log.csv"], "unknown model or model folder 'type_9'; "),
        ([ROBOT, "none.csv"], "none.csv: cannot be read (No such file or directory); name a CSV file"),
        ([ROBOT, "log.csv", "none.csv"], "none.csv: cannot be read"),
        (["car", "log.csv"], "log.csv: column u_drive: is missing; "),
        ([ROBOT, "log.csv", "--set", "r"], "--set is 'r'; write --set NAME=VALUE, VALUE a number"),
        ([ROBOT, "log.csv", "--set", "r=abc"], "--set r is 'abc'; give a number, with a point as in 0.5"),
        ([ROBOT, "log.csv", "--guess", "m_C = 1,5"], "--guess m_C is '1,5'; give a number, with a point as in 0.5"),
        ([ROBOT, "log.csv", "--guess", "m_C=1e9"], "guess: m_C = 1e+09: is "),
        ([ROBOT, "log.csv", "--guess", "K1=1e-9"], "guess: K1 = 1e-09: is "),
        ([ROBOT, "log.csv", "log.csv"], "log.csv: holds the same rows as log.csv; give each log once"),
        ([ROBOT, "log.csv", "--set", "radius=1"], "unknown parameter of type_2_0 'radius'; "),
        ([ROBOT, "log.csv", "--set", "r=0"], "the radius of wheel 'right' is "),
        ([ROBOT, "log.csv", "--set", "m_C=-3"], "m_C = -3 kg is negative; "),
        ([ROBOT, "log.csv", "--set", "r=nan"], "parameter r is nan; give finite numbers"),
        *(
            (
                [ROBOT, "log.csv", "--hold-out", share],
                f"hold_out: {share}: is no share of the log that can be held out; choose one above 0 and up to 0.8, or "
                "name a segment",
            )
            for share in ("0", "1", "0.9", "3", "-1")
        ),
        ([ROBOT, "log.csv", "--hold-out", "0.001"], "hold_out: 0.001: holds out less than 0.5 s in a row; "),
        ([ROBOT, "log.csv", "--hold-out", "fast"], "hold_out: 'fast': is no segment of the log; "),
        ([ROBOT, "log.csv", "--delay", "20"], "delay: 20: is no dead time of a motor; give it in seconds, as 0.02"),
        ([ROBOT, "log.csv", "--coulomb", "some"], "unknown kind of friction 'some'; there is each, grouped, none"),
        ([ROBOT, "log.csv", "--out", "log.csv"], "log.csv: cannot be written; name a writable folder"),
    ],
)
def test_a_wrong_argument_ends_in_one_line(arguments: list[str], line: str, drive: Log) -> None:
    write(drive, Path("log.csv"))
    assert refused(*arguments).startswith(f"error: {line}")


def test_straight_driving_names_the_motion_that_is_missing() -> None:
    u = np.repeat(multisine(20.0, 1, 8.0), 2, axis=1)
    write(logged(effort_of(ROBOT, **SMALL), u), Path("straight.csv"))
    line = refused(ROBOT, "straight.csv", *SET)
    assert line == (
        "error: the log holds no motion of omega; drive such motions too, or take what the rest tells (--partial)"
    )
    result = call(ROBOT, "straight.csv", *SET, "--partial")
    assert result.exit_code == 0, result.output
    assert "no motion of omega" in result.stdout
    pi = effort_of(ROBOT, **SMALL).base(effort_of(ROBOT, **SMALL).p)
    with open("results/identified-type_2_0/pi.csv", encoding="utf-8") as stream:
        rows = {row["name"]: row for row in csv.DictReader(stream)}
    assert float(rows["pi2"]["value"]) == pytest.approx(pi[1], rel=0.01)
    assert (rows["pi2"]["determined"], rows["pi6"]["determined"]) == ("yes", "described")


def test_a_good_log_is_told_and_written(drive: Log) -> None:
    write(drive, Path("log.csv"))
    result = call(ROBOT, "log.csv", *SET, "--out", "here")
    assert (result.exit_code, result.stderr) == (0, ""), result.output
    assert sorted(path.name for path in Path("here").iterdir()) == [
        "identified.toml",
        "pi.csv",
        "report.html",
        "written.json",
    ]
    pi, text = effort_of(ROBOT, **SMALL).base(effort_of(ROBOT, **SMALL).p), result.stdout
    with open("here/pi.csv", encoding="utf-8") as stream:
        values = {row["name"]: float(row["value"]) for row in csv.DictReader(stream)}
    assert [values[f"pi{k}"] for k in range(1, 7)] == pytest.approx(pi.tolist(), rel=0.05)
    assert values["coulomb_u_r"] == pytest.approx(FRICTION, rel=0.01)
    for part in ("encoders against other sensors", "pi6", "kS 0.", "turning: ", "of what was held out", "in here"):
        assert part in text
    driving = re.search(r"driving: .* kV ([\d.]+) ± [\d.]+ V s/m", text)
    assert driving is not None
    assert float(driving[1]) == pytest.approx(pi[1] / 2, rel=0.01)


def test_lines_fit_into_eighty_columns(drive: Log, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(terminal.console, "_width", 80)
    write(drive, Path("log.csv"))
    text = call(ROBOT, "log.csv", *SET).stdout
    assert max(map(len, text.splitlines())) <= 80
    assert "…" not in text


def test_a_contradiction_ends_with_status_one(drive: Log, monkeypatch: pytest.MonkeyPatch, found: Identified) -> None:
    write(drive, Path("log.csv"))
    impossible = replace(found, physical=replace(found.physical, chi2=100.0))
    monkeypatch.setattr("wmr_afl.identification.identify.identify", lambda *_, **__: impossible)
    result = call(ROBOT, "log.csv")
    assert result.exit_code == 1
    assert "a contradiction" in result.stdout
    assert "verdict bad" in Path("results/identified-type_2_0/report.html").read_text()


def test_the_shipped_experiment_goes_from_a_log_to_control() -> None:
    """What was identified drives study 1 within a millimetre; the wrong description does not come near."""
    runs = run("study_1_identified", "casadi")
    error = {name: float(np.linalg.norm(one.rms(since=100.0))) for name, one in runs.items()}
    assert error["exact from the log"] < 1e-3
    assert error["adaptive from the log"] <= error["exact from the log"]
    assert error["adaptive from the log"] < error["adaptive from ones"]
    assert error["exact from the description"] > 0.1
    true = load_experiment("study_1_identified").loops["exact from the log"].plant.parameters
    guess = tomllib.loads(find_experiment("study_1_identified").read_text())["controllers"]["exact from the log"]
    effort = effort_of(ROBOT)
    names = list(effort.model.parameter_units)
    found = effort.base(np.array([guess["guess"].get(name, true[names.index(name)]) for name in names]))
    np.testing.assert_allclose(found, effort.base(true), rtol=0.02)


def test_a_named_segment_is_held_out() -> None:
    for name, seed in (("one", 1), ("two", 2)):
        write(logged(effort_of(ROBOT, **SMALL), multisine(12.0, 2, 8.0, seed)), Path(f"{name}.csv"))
    result = call(ROBOT, "one.csv", "two.csv", *SET, "--hold-out", "two")
    assert result.exit_code == 0, result.output
    assert "<h3>two, from -0.5 s" in Path("results/identified-type_2_0/report.html").read_text()
    log = read_logs(effort_of(ROBOT).model, ["one.csv", "two.csv"])
    assert [segment.name for segment in log.segments] == ["one", "two"]


def test_numbers_for_an_experiment(found: Identified, tmp_path: Path) -> None:
    """`robot`, `parameters` and `guess` are what an experiment takes; the controller then begins with the true one."""
    text = toml_text(found, "small.csv")
    told = tomllib.loads(text)
    assert told["robot"] == ROBOT
    assert told["parameters"] == found.parameters
    assert told["guess"] == found.guess
    assert {"r", "b"} < told["guess"].keys()
    assert "L" not in told["guess"]
    guess = next(line for line in text.splitlines() if line.startswith("guess = "))
    experiment = re.sub(r"\nestimate = 1.0.*", f"\n{guess}", (EXPERIMENTS / "study_1.toml").read_text())
    file = tmp_path / "mine.toml"
    file.write_text(experiment + text[text.index("\n[parameters]\n") :])
    loop = load_experiment(file).loops["frozen estimates"]
    p = effort_of(ROBOT, **SMALL).p
    assert loop.states["theta_hat"] == pytest.approx(found.model.base_parameters(p), rel=0.02)


def test_what_was_identified_is_no_experiment_and_says_so_in_one_line(found: Identified) -> None:
    Path("identified.toml").write_text(toml_text(found, "small.csv"))
    result = CliRunner().invoke(app, ["simulate", "identified.toml"])
    assert result.exit_code == 2
    assert result.stderr == (
        "error: identified.toml: is no experiment: it has no [reference], no [simulation], no [controllers]; name an "
        "experiment; from a file that identify has written copy robot, [parameters] and guess into one\n"
    )


def test_parameters_given_stay_and_fix_the_scale(drive: Log) -> None:
    weighed = identify(ROBOT, drive, parameters={**GEOMETRY, "m_C": SMALL["m_C"]})
    assert weighed.physical.scaled == ()
    assert weighed.parameters["m_C"] == SMALL["m_C"]
    assert weighed.guess["m_C"] == SMALL["m_C"]
    assert weighed.guess["K1"] == pytest.approx(SMALL["K1"], rel=0.1)
    assert not any("common factor" in text for text in open_ends(weighed))


def test_a_description_that_is_far_off_does_not_bend_the_weak_form(drive: Log) -> None:
    """With the true mass and K1 twenty times too large pi1 is expected near zero, and found nevertheless."""
    far = identify(ROBOT, drive, parameters={**GEOMETRY, "m_C": SMALL["m_C"]})
    weak = far.tried[0].estimate.unknown
    assert weak[0] == pytest.approx(effort_of(ROBOT, **SMALL).base(effort_of(ROBOT, **SMALL).p)[0], rel=0.1)
    assert next(check for check in far.checks if check.name == "dead time").is_fine


def test_angles_that_begin_anew_after_a_turn_are_counted_on(drive: Log) -> None:
    (segment,) = drive.segments
    wrapped = (segment.z + np.pi) % (2.0 * np.pi) - np.pi
    assert np.ptp(wrapped) < 2.0 * np.pi < np.ptp(segment.z)
    columns = {one.name: wrapped[:, k] for k, one in enumerate(drive.channels)}
    whole = log_of(drive.model, segment.time, segment.u, columns)
    assert whole.segments[0].z == pytest.approx(segment.z)
    found = identify(ROBOT, whole, parameters=GEOMETRY)
    assert str(found.checks[0]) == "turns: angle:u_r, angle:u_l begins anew after a turn: counted on"
    assert drive.turned == ()


def test_a_part_at_rest_cannot_be_held_out(drive: Log) -> None:
    (segment,) = drive.segments
    still = replace(segment.part(600, 1000), u=np.zeros((400, 2)), z=np.repeat(segment.z[600:601], 400, axis=0))
    log = drive.of([replace(segment.part(0, 600), name="drive"), replace(still, name="rest")])
    with pytest.raises(InputError, match="hold_out: 'rest': holds out no motion"):
        identify(ROBOT, log, parameters=GEOMETRY, hold_out="rest")


def test_a_wrong_sign_is_a_contradiction(drive: Log) -> None:
    (segment,) = drive.segments
    wrong = identify(ROBOT, drive.of([replace(segment, u=-segment.u)]), parameters=GEOMETRY)
    assert wrong.physical.is_contradiction
    assert "a contradiction" in wrong.verdict
    assert any("of the wrong sign" in text for text in open_ends(wrong))


@pytest.mark.parametrize(
    ("value", "interval", "answer"),
    [
        (0.4, 0.01, "yes"),
        (0.005, 0.01, "about zero"),
        (-0.005, 0.01, "about zero"),
        (-0.03, 0.01, "about zero"),  # of 8 V: less than a log tells
        (-0.4, 0.01, "below zero"),
        (-0.4, 0.2, "below zero"),
        (-0.4, 0.5, "no"),
    ],
)
def test_friction_below_zero_is_none_or_a_contradiction(
    found: Identified, value: float, interval: float, answer: str
) -> None:
    """It never says that it is told: no motor is pushed by its friction."""
    k = found.names.index("coulomb_u_r")
    unknown, covariance = found.estimate.unknown.copy(), found.estimate.covariance.copy()
    unknown[k], covariance[k, k] = value, (0.5 * interval) ** 2
    other = replace(found, estimate=replace(found.estimate, unknown=unknown, covariance=covariance))
    assert other.told()[k] == answer
    assert other.is_contradiction is (answer == "below zero")
    assert ("friction below zero (coulomb_u_r)" in other.verdict) is other.is_contradiction
    assert any("below zero" in text for text in open_ends(other)) is other.is_contradiction


def test_what_voltages_cannot_tell_is_said(found: Identified) -> None:
    assert found.physical.scaled == ("m_C", "m_w", "I_m", "I_C", "K1", "K2")
    texts = list(open_ends(found))
    assert any(text.startswith("Voltages tell m_C, m_w, I_m, I_C, K1, K2 up to one common factor") for text in texts)
    assert any("m_w, I_m" in text and text.startswith("Stayed near the description") for text in texts)


def test_the_page_holds_everything(found: Identified) -> None:
    page = write_identification(found, "<small>.csv", Path("out"))[-1].read_text()
    first = page.index("<body>")
    assert page.index(found.verdict.replace("'", "&#39;"), first) < page.index("<h2>")
    for text in (
        *("Checks of the log", "Base parameters", "SysId", "What was held out", "Physical parameters"),
        *(
            "What is not determined",
            "weak form",
            "output error",
            "<th>of voltage</th>",
            "some exceed 100 %",
            "&lt;small&gt;.csv",
            "guess = {",
        ),
        *(name for name in found.names),
        *(name for name in found.parameters),
        *(check.text for check in found.checks),
        *(f"{value:.5g}" for value in found.estimate.unknown),
    ):
        assert text.replace("'", "&#39;") in page, text
    assert page.count("<table") == page.count('<div class="table"><table') == page.count("</table></div>")  # scrolling
    assert page.count('class="formula"><div>') == len(found.names)
    assert page.count("data:image/png;base64,") == len(found.held) == 1
    assert not re.search(r"(src|href)=\"(?!data:)", page)


def test_what_an_earlier_call_wrote_is_replaced_and_the_rest_stays(found: Identified) -> None:
    Path("out").mkdir()
    Path("out/notes.txt").write_text("mine")
    Path("out/pi.csv").write_text("old")
    write_identification(found, "log.csv", Path("out"))
    assert Path("out/notes.txt").read_text() == "mine"
    assert Path("out/pi.csv").read_text().startswith("name,formula,unit,value,two_sd,share_of_voltage,determined,weak")


def test_a_place_where_nothing_can_be_written_is_told(found: Identified) -> None:
    Path("file").write_text("")
    with pytest.raises(WmrError, match="file/out: cannot be written"):
        write_identification(found, "log.csv", Path("file/out"))


def test_the_table_is_exact(found: Identified) -> None:
    write_identification(found, "log.csv", Path("out"))
    with open("out/pi.csv", encoding="utf-8") as stream:
        rows = list(csv.DictReader(stream))
    assert [row["name"] for row in rows] == found.names
    assert [float(row["value"]) for row in rows] == found.estimate.unknown.tolist()
    assert [float(row["output_error_two_sd"]) for row in rows] == found.tried[1].estimate.interval.tolist()
    assert rows[0]["formula"] == "r*(m_C + 2*m_w)/K1"
    assert {row["determined"] for row in rows} == {"yes"}


def test_the_samples_are_those_of_the_logs(drive: Log) -> None:
    """A log that is written and read again is the same."""
    write(drive, Path("log.csv"))
    (again,) = read_logs(drive.model, ["log.csv"]).segments
    (segment,) = drive.segments
    assert again.step == pytest.approx(STEP)
    assert again.u == pytest.approx(segment.u, abs=1e-7)
    assert again.z == pytest.approx(segment.z, abs=1e-7)
