"""Reading a mesh file of any known format, chosen by its suffix; formats that are read with libraries.

The formats that meshio reads well: gmsh .msh, .vtu, .vtk, .med, .cgns, .xdmf, .mesh, ... Groups are taken from named
sets (.msh, .med) and otherwise from integer data of the cells: value 3 of ``medit:ref`` is the group ``ref_3``.
"""

from __future__ import annotations

import contextlib
import gzip
import io
import re
import zlib
from collections.abc import Callable
from pathlib import Path
from typing import Any, Final

import numpy as np

from ..errors import MeshError, Problem
from .abaqus import read_abaqus
from .abaqus_cards import is_abaqus
from .content import CORNERS, FLAT, NO_ROWS, Include, Index, MeshContent
from .exodus import read_exodus
from .nastran import read_nastran
from .nastran_entries import is_nastran

_ABAQUS: Final = (".inp",)
_NASTRAN: Final = (".bdf", ".nas", ".fem")
_SHARED: Final = (".dat", ".msh")  # Nastran and Tecplot; gmsh, Ansys and cgx
_EXODUS: Final = (".e", ".exo", ".ex2")
_CAD: Final = (".step", ".stp", ".iges", ".igs", ".brep", ".x_t", ".sldprt", ".fcstd")
_ALLOWED: Final = "msh, inp, bdf, nas, fem, vtu, vtk, e, exo, med, xdmf, mesh and others of meshio"
MAX_BYTES: Final = 4_000_000_000
_MOST_TIMES, _SMALL = 200, 100_000_000  # what unpacks to more than this may be so many times as large as it is packed
_NEEDS: Final = {"h5py": "pip install h5py", "lxml": "pip install lxml"}
_MOST_VALUES = 1000  # integer data with more values than this numbers cells, it names no groups


def read_content(path: Path) -> MeshContent:
    """The content of a mesh file.

    Raises
    ------
    MeshError : missing or unreadable file, with the reason of its reader.
    """
    try:
        if not path.is_file():
            raise MeshError([Problem(path.name, "no such mesh file", remedy="the path is relative to the scene file")])
        state = path.stat()
    except (OSError, ValueError) as error:  # a name that the system refuses
        raise MeshError.of("unreadable mesh", str(path)[:80], f"not a file name: {error}") from None
    if state.st_size > MAX_BYTES:
        raise MeshError([Problem(path.name, "the file is too large", str(state.st_size), f"at most {MAX_BYTES} bytes")])
    suffix = path.suffix.lower()
    if (reader := _deck_reader(path)) is not None:
        return _deck(path, reader, [])
    if suffix in _EXODUS:
        try:
            return read_exodus(path, path.name)
        except MeshError:
            raise
        except Exception as error:  # netCDF4 raises many kinds on damaged files
            raise MeshError.of("unreadable mesh", path.name, f"not a usable Exodus file: {error}") from None
    if suffix in _CAD:
        what, made = "a CAD file holds no mesh", f"{path.stem}.msh"
        remedy = f"mesh it, e.g. gmsh -3 {path.name} -order 2 -clmax 5 -o {made} (lengths in the unit of the file: add "
        raise MeshError.of("unreadable mesh", path.name, what, suffix, _ALLOWED, f"{remedy}scale = 1e-3 for mm)")
    from meshio import extension_to_filetypes

    # ``suffix`` is the last one: that of a packed file is .gz, where meshio lists .vol.gz, .post.gz and .dato.gz
    if suffix not in (".gz", *extension_to_filetypes):
        raise MeshError.of(
            "unreadable mesh",
            path.name,
            "no reader for files of this kind",
            suffix or "no suffix",
            _ALLOWED,
            "export .msh, .inp or .bdf",
        )
    if suffix == ".gz":
        _check_unpacked(path, state.st_size)
    return read_with_meshio(path)


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
    if (reader := _deck_reader(path)) is not None:
        _deck(path, reader, names)
    return list(dict.fromkeys(names))


def _deck_reader(path: Path) -> Callable[[str, str, Include], MeshContent] | None:
    """Reader of a deck, by its suffix; of suffixes that several programs use, by the first lines of the file."""
    suffix = path.suffix.lower()
    if suffix in _ABAQUS:
        return read_abaqus
    if suffix in _NASTRAN:
        return read_nastran
    if suffix in _SHARED and path.is_file():
        with path.open("rb") as file:
            start = file.read(20_000).decode("utf-8-sig", "replace")
        return read_abaqus if is_abaqus(start) else read_nastran if is_nastran(start) else None
    return None


def _deck(path: Path, reader: Callable[[str, str, Include], MeshContent], names: list[str]) -> MeshContent:
    """Content of a deck of Abaqus or Nastran; the names of the files that it includes are appended to ``names``."""

    def include(name: str) -> str:
        names.append(name)
        return _included(path, name)

    return reader(_text(path), path.name, include)


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


def read_with_meshio(path: Path) -> MeshContent:
    """The mesh of a file.

    Raises
    ------
    MeshError : with the message of meshio, or the library that meshio needs.
    """
    if path.suffix.lower() == ".msh":
        _check_tags(path)
    mesh = _load(path)
    try:
        content = _content(mesh)
    except (ValueError, IndexError, KeyError, TypeError) as error:  # arrays that do not fit each other
        raise MeshError([_unreadable(path, "", error)], "unreadable mesh") from None
    _check_rows(path, content)
    return content


def _check_tags(path: Path) -> None:
    """Refuse node tags below 1 in a .msh file of version 2: meshio would count them back from the last node."""
    content = path.read_bytes()
    # version 2; 0 for text, 1 for binary
    match = re.match(rb"\$MeshFormat\s+2[.\d]*\s+([01])\s", content)
    start = content.find(b"$Elements")
    if match is None or start < 0:
        return
    # padded: a file may end here
    count, rest = [*content[start:].split(b"\n", 2), b"", b""][1:3]
    with contextlib.suppress(ValueError, IndexError, KeyError):  # damaged in another way, which meshio reports
        lowest = (_lowest_tag if match[1] == b"0" else _lowest_binary_tag)(int(count), rest)
        if lowest < 1:
            raise MeshError.of("unreadable mesh", path.name, "an element names a node tag below 1", str(lowest), ">= 1")


def _lowest_tag(count: int, rest: bytes) -> int:
    """Lowest node tag of the lines "number type n_tag tags nodes" of .msh 2; 1 where it is higher."""
    rows = [line.split() for line in rest.split(b"\n", count)[:count]]
    return min([1, *(int(tag) for row in rows for tag in row[3 + int(row[2]) :])])  # number, type, n_tag, tags


def _lowest_binary_tag(count: int, rest: bytes) -> int:
    """The same of blocks "type n n_tag" with rows "number tags nodes"."""
    from meshio._common import num_nodes_per_cell
    from meshio.gmsh.common import _gmsh_to_meshio_type

    lowest, at = 1, 0
    while count > 0:
        kind, rows, tags = np.frombuffer(rest, np.int32, 3, at).tolist()
        width = 1 + tags + num_nodes_per_cell[_gmsh_to_meshio_type[kind]]
        table = np.frombuffer(rest, np.int32, rows * width, at + 12).reshape(rows, width)
        # three integers of four bytes before each block
        lowest, count, at = min(lowest, int(table[:, 1 + tags :].min())), count - rows, at + 12 + table.nbytes
    return lowest


def _content(mesh: Any) -> MeshContent:
    """Content of a mesh of meshio: solids, volumes, facets and node sets."""
    points = np.asarray(mesh.points, dtype=float)
    # planar meshes: z = 0
    points = np.hstack([points.reshape(len(points), -1), np.zeros((len(points), 3))])[:, :3]
    content = MeshContent(np.ascontiguousarray(points))
    rows: list[Index] = []
    for block in mesh.cells:
        cells = np.asarray(block.data)
        solid = block.type in CORNERS
        rows.append(content.add_solids(block.type, cells.astype(np.int64)) if solid else NO_ROWS)
        if not solid and block.type not in FLAT and block.type not in ("vertex", "line", "line3"):
            content.skipped[block.type] = content.skipped.get(block.type, 0) + len(cells)
    for name, chosen in _groups(mesh).items():
        _add(content, name, mesh.cells, rows, chosen)
    for name, nodes in _node_sets(mesh).items():
        if len(nodes):
            content.node_sets[name] = nodes
    return content


def _load(path: Path) -> Any:
    """Read a file with meshio, which calls ``sys.exit`` on some bad files and prints on others."""
    import meshio
    from meshio._mesh import topological_dimension

    topological_dimension.setdefault("wedge15", 3)  # missing in a table of meshio, which reads these cells otherwise
    noise = io.StringIO()
    try:
        with contextlib.redirect_stdout(noise), contextlib.redirect_stderr(noise):
            return meshio.read(path)
    except ModuleNotFoundError as error:
        name = str(error.name).split(".")[0]
        raise MeshError.of(
            "unreadable mesh",
            path.name,
            f"files of this format ({path.suffix}) need the library {name}",
            remedy=_NEEDS.get(name, f"pip install {name}"),
        ) from None
    except (Exception, SystemExit) as error:  # meshio raises many kinds and calls sys.exit on bad input
        raise MeshError([_unreadable(path, noise.getvalue(), error)], "unreadable mesh") from None


def _unreadable(path: Path, noise: str, error: BaseException) -> Problem:
    """Messages of meshio on a file, without the summary that it prints last."""
    lines = [" ".join(line.split()) for line in noise.splitlines() if line.strip()]
    reasons = [line for line in lines if not line.startswith(("Error: Couldn't read file", "Couldn't read file"))]
    own = "" if isinstance(error, SystemExit) else str(error) or type(error).__name__
    if isinstance(error, KeyError):
        own = f"it has or lacks an item {own}, which its reader (meshio) does not expect"
    elif isinstance(error, IndexError | ValueError | AttributeError | TypeError):
        own = f"its parts do not fit each other: {own}"
    reason = "; ".join([*reasons[:3], own] if own else reasons[:3]) or "; ".join(lines[-1:]) or "no reason given"
    allowed = f"a whole file of the format {path.suffix}"
    remedy = "export it again, best as .msh, .inp or .bdf, with tetrahedra of 4 or 10 nodes or hexahedra of 8, 20 or 27"
    return Problem(path.name, f"cannot be read: {reason[:300]}", allowed=allowed, remedy=remedy)


def _groups(mesh: Any) -> dict[str, list[Index]]:
    """Cells of every group: for each block of cells, the rows that belong to it."""
    groups: dict[str, list[Index]] = {}
    for name, blocks in mesh.cell_sets.items():
        if name.startswith("gmsh:"):
            continue
        rows = [np.asarray([] if b is None else b, dtype=np.int64) for b in blocks]
        # a set written before later blocks names no cell of them
        groups[name] = rows + [NO_ROWS] * (len(mesh.cells) - len(rows))
    physical = mesh.cell_data.get("gmsh:physical")
    # (tag, dimension): other entries of field_data are no names of groups
    named = {name: tag for name, tag in mesh.field_data.items() if np.size(tag) == 2} if physical is not None else {}
    for name, (tag, dimension) in named.items():
        if name not in groups:
            groups[name] = [
                np.flatnonzero(np.asarray(tags) == tag) if _dimension(block.type) == dimension else NO_ROWS
                for block, tags in zip(mesh.cells, physical, strict=True)
            ]
    for tag, names in getattr(mesh, "cell_tags", {}).items():  # families of .med: one tag, several groups
        for name in names:
            before = groups.setdefault(name, [NO_ROWS] * len(mesh.cells))
            groups[name] = [
                np.union1d(rows, np.flatnonzero(np.asarray(tags) == tag))
                for rows, tags in zip(before, mesh.cell_data["cell_tags"], strict=True)
            ]
    return groups or _groups_of_data(mesh)


def _groups_of_data(mesh: Any) -> dict[str, list[Index]]:
    """Groups of a file without names: one for each value of its integer data, the first that has several values."""
    # gmsh:physical first, then by name
    for key in sorted(mesh.cell_data, key=lambda k: (k != "gmsh:physical", k)):
        tables = [np.asarray(values).ravel() for values in mesh.cell_data[key]]
        whole = all(len(t) == len(b.data) for t, b in zip(tables, mesh.cells, strict=True))
        values = np.unique(np.concatenate(tables)) if tables and whole else np.zeros(0)
        if not 0 < len(values) <= _MOST_VALUES or not np.issubdtype(values.dtype, np.integer):
            continue
        none = 0 if key.startswith(("gmsh:", "medit:")) else None  # cells in no group
        short = re.sub("[^A-Za-z0-9_]+", "_", key.split(":")[-1]).strip("_") or "group"
        return {
            f"{short}_{int(value)}": [np.flatnonzero(table == value) for table in tables]
            for value in values
            if value != none
        }
    return {}


def _node_sets(mesh: Any) -> dict[str, Index]:
    sets = {str(name): np.asarray(rows).ravel() for name, rows in mesh.point_sets.items()}
    for tag, names in getattr(mesh, "point_tags", {}).items():
        rows = np.flatnonzero(np.asarray(mesh.point_data["point_tags"]) == tag)
        for name in names:
            sets[name] = np.union1d(sets.get(name, rows), rows)
    return {
        name: rows.astype(np.int64)
        for name, rows in sets.items()
        if np.issubdtype(rows.dtype, np.integer) and not name.startswith("gmsh:")
    }


def _dimension(kind: str) -> int:
    """Dimension of a type of cells; -1: neither solid nor surface."""
    return 3 if kind in CORNERS else 2 if kind in FLAT else -1


def _add(content: MeshContent, name: str, blocks: Any, rows: list[Index], chosen: list[Index]) -> None:
    """Cells of a group under its name: solids as a volume group, surface cells as facets."""
    for block, start, select in zip(blocks, rows, chosen, strict=True):
        if not len(select):
            continue
        if block.type in CORNERS:
            content.add_volume(name, block.type, start[select])
        elif block.type in FLAT:
            content.add_facets(name, block.type, np.asarray(block.data, dtype=np.int64)[select])


def _check_rows(path: Path, content: MeshContent) -> None:
    """Cells and sets name nodes that are there."""
    tables = [*content.solids.values(), *content.node_sets.values()]
    tables += [facets for group in content.facets.values() for facets in group]
    if any(t.size and not (t.min() >= 0 and t.max() < len(content.points)) for t in tables):
        raise MeshError.of(
            "unreadable mesh", path.name, "cells name nodes that are not there", allowed=f"{len(content.points)} nodes"
        )
