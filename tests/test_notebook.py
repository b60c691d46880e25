"""The notebook runs from its first cell to its last, and is kept without outputs."""

from __future__ import annotations

import json
from pathlib import Path

import pytest

NOTEBOOK = Path(__file__).parents[1] / "docs" / "quick_start.ipynb"


def test_it_is_kept_without_outputs() -> None:
    cells = json.loads(NOTEBOOK.read_text(encoding="utf-8"))["cells"]
    code = [cell for cell in cells if cell["cell_type"] == "code"]
    assert len(code) > 5
    assert all(cell["outputs"] == [] and cell["execution_count"] is None for cell in code)


@pytest.mark.slow
def test_it_runs(tmp_path: Path) -> None:
    nbformat, nbclient = pytest.importorskip("nbformat"), pytest.importorskip("nbclient")
    pytest.importorskip("ipykernel")
    notebook = nbformat.read(NOTEBOOK, as_version=4)
    nbclient.NotebookClient(notebook, timeout=300, resources={"metadata": {"path": str(tmp_path)}}).execute()
    printed = [
        "".join(output.get("text", "") for output in cell["outputs"])
        for cell in notebook.cells
        if cell.cell_type == "code"
    ]
    assert any("two_specimen_crushing: converged" in text for text in printed)
    assert any("crush.force_history" in text and "N s^0.5" in text for text in printed)
    lines = [line for text in printed for line in text.splitlines() if line.startswith("mu = ")]
    works = [float(line.split("friction work ")[1].split()[0]) for line in lines]
    assert len(works) == 4
    assert works[0] == 0.0
    assert works[1] > 0.0
    assert {path.name for path in tmp_path.iterdir()} >= {"assembly.png", "crushing.nc", "map.png"}
