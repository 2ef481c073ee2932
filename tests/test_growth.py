"""The cost of a further trailer is as the docs tell it, and close to constant."""

import re

from benchmarks.growth import operations
from tests.conftest import ROOT


def told() -> dict[int, int]:
    """Operations of the state derivative by number of trailers, from docs/growth.md."""
    page = (ROOT / "docs" / "growth.md").read_text()
    rows = re.findall(r"^\| (\d+) \| \d+ \| [\d.]+ \| [\d.]+ \| (\d+) \|", page, re.MULTILINE)
    return {int(trailers): int(count) for trailers, count in rows}


def test_the_docs_tell_the_operations_that_are_generated() -> None:
    assert {n: operations(n) for n in (0, 2)} == {n: told()[n] for n in (0, 2)}


def test_eight_trailers_stay_within_seven_hundred_operations_and_growth_is_close_to_linear() -> None:
    counts = told()
    assert list(counts) == list(range(9))
    assert counts[8] <= 700
    added = [counts[n + 1] - counts[n] for n in range(8)]
    assert max(added) < 2 * min(added)
