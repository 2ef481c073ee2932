"""The pages in docs/ keep up with the code: public names, generated functions, files."""

import re
import warnings
from typing import Any

import pytest

import wmr_afl
from tests.conftest import ROOT

PAGE = (ROOT / "docs" / "api.md").read_text()
PAGES = ["CONTRIBUTING.md", *sorted(f"docs/{path.name}" for path in (ROOT / "docs").glob("*.md"))]
FOLDERS = ("benchmarks", "derive", "docs", "examples", "generated", "tests", "wmr_afl", "wmr_input")
FILES = {f"/{path.name}" for path in ROOT.iterdir()} | {
    path.as_posix() for folder in FOLDERS for path in (ROOT / folder).rglob("*.*")
}
ROWS = re.findall(r"^\| `(\w+)` \| (.+) \| `(.+)` \|$", PAGE, re.MULTILINE)


def test_the_page_holds_every_public_name_once_and_no_other() -> None:
    assert sorted(name for name, _, _ in ROWS) == sorted(wmr_afl.__all__)
    assert len(ROWS) == len(re.findall(r"^\| `", PAGE, re.MULTILINE))


def test_every_line_runs_and_shows_its_name(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.chdir(ROOT)
    first = re.search(r"```python\n(.*?)```", PAGE, re.DOTALL)
    assert first is not None
    names: dict[str, Any] = {}
    exec(first[1], names)  # noqa: S102
    with warnings.catch_warnings():
        warnings.simplefilter("ignore", wmr_afl.BackendWarning)  # of a machine without a compiler
        for name, _, line in ROWS:
            thing = getattr(wmr_afl, name)
            if line.startswith("issubclass"):
                assert eval(line, names), line  # noqa: S307
            elif isinstance(thing, type) and issubclass(thing, Warning):
                with pytest.warns(thing):
                    exec(line, names)  # noqa: S102
            elif isinstance(thing, type) and issubclass(thing, wmr_afl.WmrError):
                with pytest.raises(thing) as caught:
                    exec(line, names)  # noqa: S102
                assert caught.type is thing or thing is wmr_afl.WmrError, line
                assert caught.value.problem, line
                assert caught.value.remedy or thing is wmr_afl.MissingTermError, line
            else:
                exec(line, names)  # noqa: S102
                assert name in line or any(type(value) is thing for value in names.values()), line


def test_the_notation_holds_every_generated_function_with_its_shape(robot: str) -> None:
    lines = (ROOT / "docs" / "notation.md").read_text().splitlines()
    for name, function in wmr_afl.load_model(robot).metadata["functions"].items():
        sizes = ", ".join(function["shape"]) + ("," if len(function["shape"]) == 1 else "")
        call = f"`{name}({', '.join(function['arguments'])})`"
        assert any(call in line and f"({sizes})" in line for line in lines), f"{call} ({sizes})"


@pytest.mark.parametrize("page", PAGES)
def test_every_file_and_link_of_a_page_is_there(page: str) -> None:
    text = (ROOT / page).read_text()
    links = re.findall(r"\]\(([^)#:]+)\)", text)
    assert [link for link in links if not ((ROOT / page).parent / link).exists()] == []
    named = set(re.findall(r"`([\w/]+\.(?:py|toml|md))`", text))
    assert [name for name in sorted(named) if not any(file.endswith(f"/{name}") for file in FILES)] == []
