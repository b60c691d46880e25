"""Reading a mesh file of any format known, chosen by its suffix."""

from __future__ import annotations

from pathlib import Path
from typing import Final

from ..errors import MeshError, Problem
from .abaqus import read_abaqus
from .content import MeshContent
from .exodus import read_exodus
from .nastran import read_nastran
from .with_meshio import read_with_meshio

_ABAQUS: Final = (".inp",)
_NASTRAN: Final = (".bdf", ".nas", ".fem")
_EXODUS: Final = (".e", ".exo", ".ex2")
_MESHIO: Final = (
    ".msh",
    ".vtk",
    ".vtu",
    ".xdmf",
    ".xmf",
    ".cgns",
    ".med",
    ".mesh",
    ".meshb",
    ".h5m",
    ".hmf",
    ".avs",
    ".f3grid",
    ".mdpa",
    ".su2",
    ".ugrid",
    ".vol",
    ".node",
    ".ele",
    ".xml",
    ".stl",
    ".ply",
    ".obj",
    ".off",
    ".dat",
    ".tec",
    ".post",
    ".dato",
    ".gz",
    ".wkt",
    ".svg",
)
_ALLOWED: Final = "msh, inp, bdf, nas, fem, vtu, vtk, e, exo, med, xdmf, mesh and others of meshio"
MAX_BYTES: Final = 4_000_000_000


def read_content(path: Path) -> MeshContent:
    """The content of a mesh file.

    Raises
    ------
    MeshError : missing or unreadable file, with the reason its reader gives.
    """
    try:
        if not path.is_file():
            raise MeshError([Problem(path.name, "no such mesh file", remedy="the path is relative to the scene file")])
        state = path.stat()
    except (OSError, ValueError) as error:  # a name that the system refuses
        raise MeshError([Problem(str(path)[:80], f"not a file name: {error}")], "unreadable mesh") from None
    if state.st_size > MAX_BYTES:
        raise MeshError([Problem(path.name, "the file is too large", str(state.st_size), f"at most {MAX_BYTES} bytes")])
    suffix = path.suffix.lower()
    if suffix in _ABAQUS:
        return read_abaqus(_text(path), path.name, lambda name: _included(path, name))
    if suffix in _NASTRAN:
        return read_nastran(_text(path), path.name, lambda name: _included(path, name))
    if suffix in _EXODUS:
        try:
            return read_exodus(path, path.name)
        except MeshError:
            raise
        except Exception as error:  # netCDF4 raises many kinds on damaged files
            raise MeshError([Problem(path.name, f"not a usable Exodus file: {error}")], "unreadable mesh") from None
    if suffix not in _MESHIO:
        raise MeshError(
            [
                Problem(
                    path.name,
                    "no reader for files of this kind",
                    suffix or "no suffix",
                    _ALLOWED,
                    "export .msh, .inp or .bdf",
                )
            ],
            "unreadable mesh",
        )
    return read_with_meshio(path)


def _included(path: Path, name: str) -> str:
    """Text of a file that a deck includes, relative to the deck."""
    try:
        return _text(path.parent / name)
    except MeshError as error:
        what = f"the included {error.problems[0].where} cannot be read"
        problem = Problem(path.name, what, error.problems[0].what, remedy="the path is relative to the deck")
        raise MeshError([problem], "unreadable mesh") from None


def _text(path: Path) -> str:
    """Text of a deck; bytes that are no UTF-8 (in comments, mostly) are replaced."""
    try:
        return path.read_bytes().decode("utf-8-sig", "replace")
    except (OSError, ValueError) as error:
        reason = getattr(error, "strerror", None) or str(error)
        raise MeshError([Problem(path.name[:80], reason)], "unreadable mesh") from None
