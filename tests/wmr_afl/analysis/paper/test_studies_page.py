"""docs/studies.md tells what the studies come to: digits where they are the same everywhere, else the verdict."""

import re

import pytest

from benchmarks.beyond import MARKS as MARKS_BEYOND
from benchmarks.studies import CLAIMED, HEADINGS, MARKS, STUDIES, rows
from tests.conftest import ROOT
from wmr_afl.analysis.paper.beyond import ONE_ROBOT, SETTLED, WHOLE, Trouble, one_robot


def told() -> dict[tuple[str, str], list[str]]:
    """The table of the page: by experiment and controller."""
    page = (ROOT / "docs" / "studies.md").read_text()
    text = page.partition(MARKS[0])[2].partition(MARKS[1])[0]
    lines = [re.split(r" *\| *", line.strip("| ")) for line in text.strip().splitlines()]
    assert lines[0] == list(HEADINGS)
    return {(line[0], line[1]): line[2:] for line in lines[2:]}


@pytest.mark.parametrize("study", STUDIES)
def test_the_page_tells_what_is_measured(study: str) -> None:
    found = {(row[0], row[1]): row[2:] for row in rows((study,))}
    page = {key: row for key, row in told().items() if key[0] == study}
    assert list(found) == list(page)
    for key, measured in found.items():
        expected = page[key]
        assert measured[-1] == expected[-1], key  # whether it chatters
        if measured[-1] == "the same everywhere":
            assert [float(one) for one in measured[:3]] == pytest.approx([float(one) for one in expected[:3]], rel=0.01)
        else:
            assert (float(measured[0]) < CLAIMED) == (float(expected[0]) < CLAIMED), key


def test_the_text_agrees_with_the_table() -> None:
    """The sentences on study_2_high_gain: more than half a metre, estimates above forty, both modified laws below."""
    high = {name: [float(one) for one in row[:3]] for (study, name), row in told().items() if study == STUDIES[2]}
    assert high["AFL"][1] > 0.5
    assert high["AFL"][2] > 40.0
    assert all(high[name][0] < CLAIMED for name in ("AFL with leakage", "robust AFL"))
    assert high["robust AFL"][2] > 40.0 > high["AFL with leakage"][2]


def test_the_page_tells_what_is_beyond_the_paper() -> None:
    """Of the paper's robot, under the laws that do not chatter; the digits are the same everywhere."""
    page = (ROOT / "docs" / "studies.md").read_text().partition(MARKS_BEYOND[0])[2].partition(MARKS_BEYOND[1])[0]
    lines = [re.split(r" *\| *", line.strip("| ")) for line in page.splitlines() if line.startswith("| ")]
    own = lines[: next(index for index, line in enumerate(lines) if line[0] == "law" and index)]
    laws = {law: table for law, table in ONE_ROBOT.items() if law != "robust AFL"}
    runs = one_robot(Trouble(), laws)
    for law, run in runs.items():
        (row,) = [line for line in own if line[0] == law]
        for text, window in ((row[1], WHOLE), (row[2], SETTLED)):
            assert [float(one) for one in text.split(", ")] == pytest.approx(1e3 * run.rms(*window), rel=0.01)
