"""What stands at the top of the package: its errors, and `python -m wmr_afl`."""

import runpy
import sys

import pytest

from wmr_afl import UnknownNameError

KNOWN = ["alpha", "beta"]


@pytest.mark.parametrize(
    ("name", "known", "hint", "expected"),
    [
        ("alpa", KNOWN, "", "unknown thing 'alpa'; did you mean 'alpha'? (there is alpha, beta)"),
        ("ALPHA", KNOWN, "", "unknown thing 'ALPHA'; did you mean 'alpha'? (there is alpha, beta)"),
        ("omega", KNOWN, "", "unknown thing 'omega'; there is alpha, beta"),
        ("omega", KNOWN, "name a file", "unknown thing 'omega'; name a file (there is alpha, beta)"),
        ("alpa", KNOWN, "name a file", "unknown thing 'alpa'; name a file (there is alpha, beta)"),
        ("alpa", [], "", "unknown thing 'alpa'; there is none"),
        ("alpa", [], "name a file", "unknown thing 'alpa'; name a file (there is none)"),
        (7, KNOWN, "", "unknown thing '7'; there is alpha, beta"),
        ("x" * 60, KNOWN, "", f"unknown thing '{'x' * 60}'; there is alpha, beta"),
        ("x" * 61, KNOWN, "", f"unknown thing '{'x' * 57}...'; there is alpha, beta"),
    ],
)
def test_an_unknown_name_is_answered_with_the_nearest_and_all_known_ones(
    name: str, known: list[str], hint: str, expected: str
) -> None:
    """A hint stands where the nearest one would; a long name is shortened."""
    assert str(UnknownNameError("thing", name, iter(known), hint)) == expected


def test_the_package_is_run_as_its_command(monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]) -> None:
    """Under the name of the command, with its arguments."""
    monkeypatch.setattr(sys, "argv", ["wmr_afl", "--help"])
    with pytest.raises(SystemExit) as ended:
        runpy.run_module("wmr_afl", run_name="__main__")
    assert not ended.value.code
    assert "Usage: wmr-afl " in capsys.readouterr().out
