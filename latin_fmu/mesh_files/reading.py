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
MAX_BYTES: Final = 4_000_000_000


def read_content(path: Path) -> MeshContent:
    """The content of a mesh file.

    Raises
    ------
    MeshError : missing or unreadable file, with the reason its reader gives.
    """
    try:
        if not path.is_file():
            raise MeshError(
                [Problem(path.name, "no such mesh file", remedy="the path is relative to the scene file")]
            )
        state = path.stat()
    except (OSError, ValueError) as error:  # a name that the system refuses
        raise MeshError([Problem(str(path)[:80], f"not a file name: {error}")], "unreadable mesh") from None
    if state.st_size > MAX_BYTES:
        raise MeshError(
            [Problem(path.name, "the file is too large", str(state.st_size), f"at most {MAX_BYTES} bytes")]
        )
    suffix = path.suffix.lower()
    if suffix in _ABAQUS:
        return read_abaqus(_text(path), path.name, lambda name: _text(path.parent / name))
    if suffix in _NASTRAN:
        return read_nastran(_text(path), path.name, lambda name: _text(path.parent / name))
    if suffix in _EXODUS:
        try:
            return read_exodus(path, path.name)
        except MeshError:
            raise
        except Exception as error:  # netCDF4 raises many kinds on damaged files
            raise MeshError(
                [Problem(path.name, f"not a usable Exodus file: {error}")], "unreadable mesh"
            ) from None
    return read_with_meshio(path)


def _text(path: Path) -> str:
    """Text of a deck; bytes that are no UTF-8 (in comments, mostly) are replaced."""
    try:
        return path.read_bytes().decode("utf-8-sig", "replace")
    except (OSError, ValueError) as error:
        reason = getattr(error, "strerror", None) or str(error)
        raise MeshError(
            [Problem(str(path.name)[:80], f"the file cannot be read: {reason}")], "unreadable mesh"
        ) from None
