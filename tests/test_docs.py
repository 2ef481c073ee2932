"""The pages in docs/ speak of every key that a description or an experiment may have."""

import re
from typing import Any, get_args

import pytest
from pydantic import BaseModel

from derive.description.tables import RobotDescription
from tests.conftest import ROOT
from wmr_afl.experiments.experiment import Experiment


def keys(annotation: Any) -> set[str]:
    """All keys of a schema, at any depth."""
    if isinstance(annotation, type) and issubclass(annotation, BaseModel):
        own = set(annotation.model_fields)
        return own.union(*(keys(field.annotation) for field in annotation.model_fields.values()))
    return set().union(*(keys(part) for part in get_args(annotation)))


@pytest.mark.parametrize(("page", "schema"), [("robots.md", RobotDescription), ("experiments.md", Experiment)])
def test_every_key_is_explained(page: str, schema: type[BaseModel]) -> None:
    text = (ROOT / "docs" / page).read_text()
    code = " ".join([*re.findall(r"^```.*?^```", text, re.MULTILINE | re.DOTALL), *re.findall(r"`[^`\n]+`", text)])
    words = set(re.findall(r"\w+", code))
    assert len(words) < len(set(re.findall(r"\w+", text)))
    assert [key for key in sorted(keys(schema)) if key not in words] == []


def test_every_page_is_reached_from_the_readme() -> None:
    readme = (ROOT / "README.md").read_text()
    for page in (ROOT / "docs").glob("*.md"):
        assert f"docs/{page.name}" in readme
