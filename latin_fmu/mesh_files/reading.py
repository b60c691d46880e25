"""Reading a mesh file of any known format (``formats.FORMATS``): limits of size, decks with the files they include."""

from __future__ import annotations

import gzip
import zlib
from pathlib import Path
from typing import Final

from ..errors import MeshError, Problem
from .child import read_in_child
from .content import MeshContent
from .formats import CAD, SURFACES, Format, format_of, known_suffixes, suffix_of
from .node_orders import in_another_order, n_node_of

MAX_BYTES: Final = 4_000_000_000
_MOST_TIMES, _SMALL = 200, 100_000_000  # what unpacks to more than this may be so many times as large as it is packed


def read_content(path: Path) -> MeshContent:
    """The content of a mesh file.

    Raises
    ------
    MeshError : missing or unreadable file, with the reason of its reader.
    """
    try:
        if not path.is_file():
            raise MeshError([Problem(path.name, "no such mesh file", remedy="the path is relative to the scene file")])
        size = path.stat().st_size
    except (OSError, ValueError) as error:  # a name that the system refuses
        raise MeshError.of("unreadable mesh", str(path)[:80], f"not a file name: {error}") from None
    if size > MAX_BYTES:
        raise MeshError([Problem(path.name, "the file is too large", str(size), f"at most {MAX_BYTES} bytes")])
    row = _format(path)
    if row.deck is not None:
        return _deck(path, row, [])
    assert row.read is not None
    if path.suffix.lower() == ".gz":
        _check_unpacked(path, size)
    if row.library:
        content = read_in_child(row.read, path, f"{row.name} files ({row.library})")
    else:
        content = row.read(path)
    _check_rows(path, content)
    _check_orders(path, content)
    return content


def _format(path: Path) -> Format:
    """The format of a file. Raises MeshError where there is no reader, with the reason."""
    try:
        row = format_of(path)
    except OSError as error:
        raise MeshError.of("unreadable mesh", path.name, error.strerror or str(error)) from None
    if row is not None:
        return row
    suffix, allowed = suffix_of(path), known_suffixes()
    if suffix in CAD:
        what, remedy = "a CAD file holds no mesh", f"mesh it, with a scene: latin-fmu mesh {path.name}"
        raise MeshError.of("unreadable mesh", path.name, what, suffix, allowed, remedy)
    if suffix in SURFACES:
        what, remedy = "files of this kind hold surfaces and no solid cells", "mesh the volume inside, e.g. with gmsh"
        raise MeshError.of("unreadable mesh", path.name, what, suffix, allowed, remedy)
    what, remedy = "no reader for files of this kind", "export .msh, .inp or .bdf"
    raise MeshError.of("unreadable mesh", path.name, what, suffix or "no suffix", allowed, remedy)


def _check_unpacked(path: Path, packed: int) -> None:
    """Refuse a compressed file that unpacks to absurdly much, without keeping any of it."""
    # a limit on the ratio alone would refuse small files of zeros
    most, size = min(MAX_BYTES, max(_SMALL, _MOST_TIMES * packed)), 0
    try:
        with gzip.open(path) as file:
            while size <= most and (block := file.read(1 << 20)):  # stops as soon as it is too much
                size += len(block)
    except (OSError, EOFError, zlib.error) as error:
        raise MeshError.of("unreadable mesh", path.name, f"damaged: {error}") from None
    if size > most:
        what = "the file is too large when unpacked"
        raise MeshError.of("unreadable mesh", path.name, what, f"{packed} bytes packed", f"at most {most} bytes")


def included_files(path: Path) -> list[str]:
    """Names of the files that a deck includes, as it writes them; they are relative to it.

    Raises MeshError where one of them cannot be read.
    """
    names: list[str] = []
    row = format_of(path)
    if row is not None and row.deck is not None:
        _deck(path, row, names)
    return list(dict.fromkeys(names))


def _deck(path: Path, row: Format, names: list[str]) -> MeshContent:
    """Content of a deck; the names of the files that it includes are appended to ``names``."""

    def include(name: str) -> str:
        names.append(name)
        return _included(path, name)

    assert row.deck is not None
    return row.deck(_text(path), path.name, include)


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
        return path.read_bytes().decode("utf-8-sig", "replace")  # with or without a mark of the byte order
    except (OSError, ValueError) as error:
        reason = getattr(error, "strerror", None) or str(error)
        raise MeshError.of("unreadable mesh", path.name[:80], reason) from None


def _check_orders(path: Path, content: MeshContent) -> None:
    """Refuse middle nodes in the order of another format: the volume would be a little wrong, and nothing else."""
    if wrong := [kind for kind, cells in content.solids.items() if in_another_order(content.points, kind, cells)]:
        what = "middle nodes are not on their edges, in the order of another format they are: its writer is wrong"
        remedy = "save it in another format, best as .msh or .vtu"
        raise MeshError.of("unreadable mesh", path.name, what, ", ".join(wrong), "the order of the format", remedy)


def _check_rows(path: Path, content: MeshContent) -> None:
    """Cells have the nodes of their type, and with the sets name nodes that are there."""
    for kind, cells in content.solids.items():
        if cells.ndim != 2 or cells.shape[1] != n_node_of(kind):
            what, allowed = f"cells of the type {kind} with {cells.shape[-1]} nodes", f"{n_node_of(kind)} nodes"
            raise MeshError.of("unreadable mesh", path.name, what, f"{len(cells)} cells", allowed)
    tables = [*content.solids.values(), *content.node_sets.values()]
    tables += [facets for group in content.facets.values() for facets in group]
    if any(t.size and not (t.min() >= 0 and t.max() < len(content.points)) for t in tables):
        raise MeshError.of(
            "unreadable mesh", path.name, "cells name nodes that are not there", allowed=f"{len(content.points)} nodes"
        )
