"""Notebooks run from the first cell to the last, and are stored with the output that they give."""

import re
from pathlib import Path

import nbformat
import pytest
from nbclient import NotebookClient

from tests.conftest import ROOT

NUMBER = re.compile(r"-?\d+(?:\.\d+)?(?:e[+-]?\d+)?")  # digits of chaotic runs and roundings differ between processors
NOTEBOOKS = sorted((ROOT / "notebooks").glob("*.ipynb"))


@pytest.mark.filterwarnings("ignore")  # of the notebook machinery
@pytest.mark.parametrize("path", NOTEBOOKS, ids=lambda path: path.stem)
def test_a_notebook_prints_what_is_stored_in_it(path: Path) -> None:
    """Text as it is, numbers to 2 %; `make notebooks` stores it anew."""
    stored = texts(nbformat.read(path, as_version=4))
    assert sum(1 for text in stored if text) >= 3
    notebook = nbformat.read(path, as_version=4)
    NotebookClient(notebook, timeout=120, resources={"metadata": {"path": str(path.parent)}}).execute()
    for shown, kept in zip(texts(notebook), stored, strict=True):
        assert NUMBER.split(shown) == NUMBER.split(kept)
        for number, other in zip(NUMBER.findall(shown), NUMBER.findall(kept), strict=True):
            assert float(number) == pytest.approx(float(other), rel=0.02, abs=1e-11)


def texts(notebook: nbformat.NotebookNode) -> list[str]:
    """What each cell of code shows as text."""
    return [
        "".join(output.get("text", "") or output.get("data", {}).get("text/plain", "") for output in cell.outputs)
        for cell in notebook.cells
        if cell.cell_type == "code"
    ]
