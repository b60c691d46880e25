"""The table of formats: a suffix stands there and nowhere else; libraries are used by their public names."""

from __future__ import annotations

import ast
import re
from pathlib import Path

import pytest

import latin_fmu
from latin_fmu.errors import MeshError
from latin_fmu.mesh_files.formats import CAD, FORMATS, SURFACES, format_of, known_suffixes
from latin_fmu.mesh_files.library import LIBRARIES
from latin_fmu.mesh_files.reading import read_content

PACKAGE = Path(latin_fmu.__file__).parent
SUFFIXES = {suffix for row in FORMATS for suffix in row.suffixes}


def literals(path: Path) -> set[str]:
    """Texts of a module, but for parts of messages."""
    nodes = list(ast.walk(ast.parse(path.read_text(encoding="utf-8"))))
    parts = {part for node in nodes if isinstance(node, ast.JoinedStr) for part in node.values}
    return {n.value for n in nodes if isinstance(n, ast.Constant) and isinstance(n.value, str) and n not in parts}


def test_a_suffix_stands_in_the_table_alone() -> None:
    """A text of the package that is a suffix of mesh files, outside the table: a second place to remember."""
    wrong = {
        f"{path.relative_to(PACKAGE)}: {text}"
        for path in PACKAGE.rglob("*.py")
        if path.name != "formats.py" and path.parent.name not in ("results", "assembly", "aot")
        for text in literals(path)
        if text in SUFFIXES
    }
    assert not wrong, wrong


def test_libraries_of_meshes_are_imported_in_one_place_by_public_names() -> None:
    wrong = []
    for path in PACKAGE.rglob("*.py"):
        for node in ast.walk(ast.parse(path.read_text(encoding="utf-8"))):
            names = [a.name for a in node.names] if isinstance(node, ast.Import) else []
            if isinstance(node, ast.ImportFrom) and not node.level:
                names = [node.module or ""]
            wrong += [f"{path.name}: {name}" for name in names if name.split(".")[0] in LIBRARIES]
    assert not wrong, wrong


def test_every_format_has_one_reader_and_no_suffix_is_cad() -> None:
    for row in FORMATS:
        assert (row.read is None) != (row.deck is None), row.name
        assert all(re.fullmatch(r"(\.[a-z0-9]+)+", suffix) for suffix in row.suffixes), row.name
    assert not SUFFIXES & (CAD | SURFACES)


def test_no_reader_is_said_with_all_suffixes(tmp_path: Path) -> None:
    (tmp_path / "part.zzz").write_text("x")
    with pytest.raises(MeshError, match="no reader for files of this kind") as caught:
        read_content(tmp_path / "part.zzz")
    assert known_suffixes() in str(caught.value)
    for name, what in (("part.stl", "surfaces and no solid cells"), ("part.STEP", "holds no mesh")):
        (tmp_path / name).write_text("x")
        with pytest.raises(MeshError, match=what):
            read_content(tmp_path / name)


@pytest.mark.parametrize(
    ("name", "start", "title"),
    [
        ("cube.msh", "$MeshFormat\n4.1 0 8\n", "gmsh"),
        ("all.msh", "*NODE, NSET=Nall\n", "Abaqus, CalculiX"),
        ("all.MSH", "** a comment\n*NODE\n", "Abaqus, CalculiX"),
        ("damaged.msh", "hello", "gmsh"),
        ("deck.dat", "CEND\nBEGIN BULK\n", "Nastran"),
        ("deck.nas", "GRID,1,,0.,0.,0.\n", "Nastran"),
        ("mesh.gen", "CDF", "Exodus"),
        ("mesh.vol.gz", "", "Netgen"),
    ],
)
def test_the_format_follows_from_suffix_and_beginning(tmp_path: Path, name: str, start: str, title: str) -> None:
    (tmp_path / name).write_text(start)
    row = format_of(tmp_path / name)
    assert row is not None
    assert row.name == title


def test_the_page_names_every_suffix() -> None:
    page = (PACKAGE.parent / "docs" / "mesh_files.md").read_text(encoding="utf-8")
    missing = [suffix for suffix in sorted(SUFFIXES) if not re.search(rf"(?<![\w.]){re.escape(suffix)}(?![\w.])", page)]
    assert not missing, missing
