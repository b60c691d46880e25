"""The notebook runs from its first cell to its last, the site shows what it shows, and it is kept without outputs."""

from __future__ import annotations

import html
import json
import re
from pathlib import Path

import pytest

from .test_docs import module_of

DOCS = Path(__file__).parents[1] / "docs"
NOTEBOOK = DOCS / "quick_start.ipynb"


def test_it_is_kept_without_outputs() -> None:
    cells = json.loads(NOTEBOOK.read_text(encoding="utf-8"))["cells"]
    code = [cell for cell in cells if cell["cell_type"] == "code"]
    assert len(code) > 5
    assert all(cell["outputs"] == [] and cell["execution_count"] is None for cell in code)


@pytest.mark.slow
def test_the_site_shows_what_its_cells_show() -> None:
    for name in ("nbformat", "nbclient", "ipykernel"):
        pytest.importorskip(name)
    page = html.unescape(module_of(DOCS / "pages.py").notebook_page())
    # a solution shows itself by its html, a dataset by its text, figures are in the page
    assert '<div class="output"><pre>two_specimen_crushing: converged' in page
    assert re.search(r"\n  crush +peak [\d.]+ kN", page)
    assert '<div class="output"><pre><xarray.Dataset>' in page
    assert page.count("data:image/png;base64,") == 3
    works = [float(work) for work in re.findall(r"mu = [\d.]+: .* friction work ([\d.]+) mJ", page)]
    assert len(works) == 4
    assert works[0] == 0.0
    assert works[1] > 0.0
