"""The library of mesh formats, by its public names alone: meshlane, or meshio, of which it is the fork that is kept up.

Nothing else of the package imports either. Formats that they read well enough are read by ``read_with_library``; groups
are taken from named sets and otherwise from integer data of the cells: value 3 of ``ref`` is the group ``ref_3``.
"""

from __future__ import annotations

import contextlib
import importlib
import io
from pathlib import Path
from typing import Any, Final

import numpy as np

from ..errors import MeshError, Problem
from .cell_groups import groups_of_data
from .content import CORNERS, FLAT, NO_ROWS, Index, MeshContent

LIBRARIES: Final = ("meshlane", "meshio")
"""The libraries, the one that is taken where both are there first."""

_NO_CELLS: Final = ("vertex", "line", "line3")  # of no body, and of no face


def missing_library(path: Path, name: str, remedy: str = "") -> MeshError:
    """The error where a library is not installed that files like this one need."""
    what = f"files of this format ({path.suffix}) need the library {name}"
    return MeshError.of("unreadable mesh", path.name, what, remedy=remedy or f"pip install {name}")


def mesh_library() -> Any:
    """The module ``meshlane``, or ``meshio`` where that is not installed.

    Raises
    ------
    ModuleNotFoundError : neither of them is there.
    """
    for name in LIBRARIES:
        with contextlib.suppress(ModuleNotFoundError):
            return importlib.import_module(name)
    raise ModuleNotFoundError(LIBRARIES[0], name=LIBRARIES[0])


def read_with_library(path: Path) -> MeshContent:
    """The mesh of a file.

    Raises
    ------
    MeshError : with the message of the library, or a library that it needs.
    """
    return content_of(_load(path), path)


def content_of(mesh: Any, path: Path) -> MeshContent:
    """Content of a mesh of the library: solids, volumes, facets and node sets.

    Raises
    ------
    MeshError : its arrays do not fit each other.
    """
    try:
        content = _content(mesh)
    except (ValueError, IndexError, KeyError, TypeError) as error:
        raise MeshError([_unreadable(path, "", error)], "unreadable mesh") from None
    return content


def _content(mesh: Any) -> MeshContent:
    points = np.asarray(mesh.points, dtype=float)
    # planar meshes: z = 0
    points = np.hstack([points.reshape(len(points), -1), np.zeros((len(points), 3))])[:, :3]
    content = MeshContent(np.ascontiguousarray(points))
    rows: list[Index] = []
    for block in mesh.cells:
        cells = np.asarray(block.data)
        solid = block.type in CORNERS
        rows.append(content.add_cells(block.type, cells.astype(np.int64)))
        if not solid and block.type not in FLAT and block.type not in _NO_CELLS:
            content.skipped[block.type] = content.skipped.get(block.type, 0) + len(cells)
    for name, chosen in _groups(mesh).items():
        _add(content, name, mesh.cells, rows, chosen)
    for name, nodes in _node_sets(mesh).items():
        if len(nodes):
            content.node_sets[name] = nodes
    return content


def _load(path: Path) -> Any:
    """Read a file with the library, which calls ``sys.exit`` on some bad files and prints on others."""
    noise = io.StringIO()
    try:
        library = mesh_library()
        with contextlib.redirect_stdout(noise), contextlib.redirect_stderr(noise):
            return library.read(path)
    except ModuleNotFoundError as error:
        raise missing_library(path, str(error.name).split(".")[0]) from None
    except (Exception, SystemExit) as error:  # many kinds, and calls of sys.exit, on bad input
        raise MeshError([_unreadable(path, noise.getvalue(), error)], "unreadable mesh") from None


def _unreadable(path: Path, noise: str, error: BaseException) -> Problem:
    """Messages of the library on a file, without the summary that it prints last."""
    library = mesh_library()
    name = f"{library.__name__} {library.__version__}"
    lines = [" ".join(line.split()) for line in noise.splitlines() if line.strip()]
    reasons = [line for line in lines if not line.startswith(("Error: Couldn't read file", "Couldn't read file"))]
    if isinstance(error, SystemExit):
        said = ""
    else:
        said = str(error) or type(error).__name__
    if isinstance(error, KeyError):
        said = f"it has or lacks an item {said}, which its reader ({name}) does not expect"
    elif isinstance(error, IndexError | ValueError | AttributeError | TypeError):
        said = f"its parts do not fit each other: {said}"
    parts = [part for part in (*reasons[:3], said) if part]
    reason = "; ".join(parts or lines[-1:]) or "no reason given"
    allowed = f"a whole file of the format {path.suffix}"
    remedy = "export it again, best as .msh, .inp or .bdf, with tetrahedra of 4 or 10 nodes or hexahedra of 8, 20 or 27"
    return Problem(path.name, f"cannot be read: {reason[:300]}", allowed=allowed, remedy=remedy)


def _groups(mesh: Any) -> dict[str, list[Index]]:
    """Cells of every group: for each block of cells, the rows that belong to it."""
    groups: dict[str, list[Index]] = {}
    for name, blocks in mesh.cell_sets.items():
        rows = [np.asarray([] if b is None else b, dtype=np.int64) for b in blocks]
        # a set written before later blocks names no cell of them
        groups[name] = rows + [NO_ROWS] * (len(mesh.cells) - len(rows))
    counts = [len(block.data) for block in mesh.cells]
    return groups or groups_of_data(mesh.cell_data, counts)


def _node_sets(mesh: Any) -> dict[str, Index]:
    sets = {str(name): np.asarray(rows).ravel() for name, rows in mesh.point_sets.items()}
    return {name: rows.astype(np.int64) for name, rows in sets.items() if np.issubdtype(rows.dtype, np.integer)}


def _add(content: MeshContent, name: str, blocks: Any, rows: list[Index], chosen: list[Index]) -> None:
    """Cells of a group under its name: solids as a volume group, surface cells as facets."""
    for block, start, select in zip(blocks, rows, chosen, strict=True):
        if not len(select):
            continue
        if block.type in CORNERS:
            content.add_volume(name, block.type, start[select])
        elif block.type in FLAT:
            content.add_facets(name, block.type, np.asarray(block.data, dtype=np.int64)[select])
