"""The cost of a further trailer is as the docs tell it, and close to constant."""

import re

import pytest

from benchmarks.growth import operations
from tests.conftest import ROOT


def told() -> dict[int, int]:
    """Operations of the state derivative by number of trailers, from docs/growth.md."""
    page = (ROOT / "docs" / "growth.md").read_text()
    rows = re.findall(r"^\| (\d+) \| \d+ \| [\d.]+ \| [\d.]+ \| (\d+) \|", page, re.MULTILINE)
    return {int(trailers): int(count) for trailers, count in rows}


@pytest.fixture(scope="module")
def counts() -> dict[int, int]:
    """The same, counted in what is generated now."""
    return {trailers: operations(trailers) for trailers in range(3)}


def test_the_docs_tell_the_operations_that_are_generated(counts: dict[int, int]) -> None:
    """For as many trailers as are derived within seconds."""
    page = told()
    assert list(page) == list(range(9))
    assert counts == {trailers: page[trailers] for trailers in counts}


def test_growth_is_close_to_linear(counts: dict[int, int]) -> None:
    """A further trailer adds less than twice of what any other one adds, here and on the page to its end."""
    for numbers in (counts, told()):
        added = [numbers[n + 1] - numbers[n] for n in range(len(numbers) - 1)]
        assert 0 < max(added) < 2 * min(added)
    assert told()[8] <= 700
