"""The process of gmsh: a library that is missing or dies is one message; nothing else imports it."""

from __future__ import annotations

import ast
from pathlib import Path

import pytest

import latin_fmu
from latin_fmu.cli import main

PACKAGE = Path(latin_fmu.__file__).parent


@pytest.mark.parametrize(
    ("library", "message"),
    [
        ("raise ImportError('No module named gmsh')", 'pip install "latin-fmu[meshes]"'),
        ("raise OSError('libGLU.so.1: cannot open shared object file')", "apt install libglu1-mesa"),
        ("import os; os.abort()", "the process of gmsh dies (SIGABRT)"),
        ("while True: pass", "takes more than 1 s of processor time"),
    ],
)
def test_a_library_that_is_missing_dies_or_does_not_return_is_one_message(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str], library: str, message: str
) -> None:
    (tmp_path / "gmsh.py").write_text(library)
    monkeypatch.syspath_prepend(str(tmp_path))
    file = tmp_path / "a.step"
    file.write_text("ISO-10303-21;")
    assert main(["mesh", str(file), "-o", str(tmp_path / "a"), "-q", "--max-cpu", "1"]) == 2
    said = capsys.readouterr().err
    assert message in said
    assert "Traceback" not in said
    assert not list(tmp_path.glob("*.msh")) + list(tmp_path.glob("*.toml"))


def test_what_is_no_cad_file_is_refused_with_what_to_do(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    (tmp_path / "a.msh").write_text("")
    assert main(["mesh", str(tmp_path / "a.msh"), "--size", "-1"]) == 2
    said = capsys.readouterr().err
    assert "--size: not a number above zero" in said
    assert "no CAD file" in said


def test_only_the_room_of_cad_imports_gmsh() -> None:
    """It is GPL: it runs in a process of its own, and where it is not installed nothing else misses it."""
    importing = {
        path.relative_to(PACKAGE)
        for path in PACKAGE.rglob("*.py")
        for node in ast.walk(ast.parse(path.read_text(encoding="utf-8")))
        if isinstance(node, ast.Import) and any(alias.name.split(".")[0] == "gmsh" for alias in node.names)
    }
    assert importing == {Path("cad/making.py")}
