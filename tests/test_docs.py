"""The pages in docs/ speak of every key that a description or an experiment may have."""

import re
from pathlib import Path
from typing import Any, get_args

import numpy as np
import pytest
from pydantic import BaseModel
from typer.testing import CliRunner

import wmr_afl
from derive.description.tables import RobotDescription
from tests.conftest import ROOT
from wmr_afl.cli import app
from wmr_afl.experiments.experiment import Experiment, find_experiment


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


def test_examples_of_references_run(tmp_path: Path) -> None:
    """Pieces in the file of study 1, and what stands there in Python, one block after the other."""
    page = (ROOT / "docs" / "experiments.md").read_text()
    part = page[page.index("## References") : page.index("## Controllers")]
    toml, blocks = (
        re.findall(rf"^```{kind}\n(.*?)^```", part, re.MULTILINE | re.DOTALL) for kind in ("toml", "python")
    )
    study = find_experiment("study_1").read_text()
    table = re.search(r"^\[reference\].*?(?=^\[)", study, re.MULTILINE | re.DOTALL)
    assert table is not None
    for block in toml:
        (tmp_path / "pieces.toml").write_text(study.replace(table[0], f"{block}\n"))
        assert wmr_afl.run(tmp_path / "pieces.toml")["AFL"].failure is None
        done = CliRunner().invoke(app, ["check-reference", str(tmp_path / "pieces.toml")])
        assert done.exit_code == 0, done.output
    names: dict[str, Any] = {}
    for block in blocks:
        exec(block, names)  # noqa: S102
        assert names["run"].failure is None
    assert len(toml) == 1
    assert len(blocks) == 3
    assert np.isfinite(names["u"]).all()
