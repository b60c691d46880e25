"""Meshes of the formats that meshio reads well: gmsh .msh, .vtu, .vtk, .med, .cgns, .xdmf, .mesh, ...

Groups are taken from named sets (.msh, .med) and otherwise from integer data of the cells: value 3 of ``medit:ref``
is the group ``ref_3``.
"""

from __future__ import annotations

import contextlib
import io
import re
from pathlib import Path
from typing import Any, Final

import numpy as np

from ..errors import MeshError, Problem
from .content import CORNERS, FLAT, Index, MeshContent

_NEEDS: Final = {"h5py": "pip install h5py", "lxml": "pip install lxml"}
_MOST_VALUES = 1000  # integer data with more values than this numbers cells, it names no groups


def read_with_meshio(path: Path) -> MeshContent:
    """The mesh of a file.

    Raises
    ------
    MeshError : with the reason that meshio gives; a library that meshio lacks is named.
    """
    mesh = _load(path)
    try:
        content = _content(mesh)
    except (ValueError, IndexError, KeyError, TypeError) as error:  # arrays that do not fit each other
        raise MeshError([_unreadable(path, "", error)], "unreadable mesh") from None
    _check_rows(path, content)
    return content


def _content(mesh: Any) -> MeshContent:
    """What meshio has read, by solids, volumes, facets and node sets."""
    points = np.asarray(mesh.points, dtype=float)
    points = np.hstack([points.reshape(len(points), -1), np.zeros((len(points), 3))])[:, :3]
    content = MeshContent(np.ascontiguousarray(points))
    rows: list[Index] = []
    for block in mesh.cells:
        cells = np.asarray(block.data)
        count = len(cells)
        start = len(content.solids[block.type]) if block.type in content.solids else 0
        rows.append(start + np.arange(count, dtype=np.int64))
        if block.type in CORNERS:
            cells = cells.astype(np.int64)
            content.solids[block.type] = cells if not start else np.concatenate([content.solids[block.type], cells])
        elif block.type not in FLAT and block.type not in ("vertex", "line", "line3"):
            content.skipped[block.type] = content.skipped.get(block.type, 0) + count
    for name, chosen in _groups(mesh).items():
        _add(content, name, mesh.cells, rows, chosen)
    for name, nodes in _node_sets(mesh).items():
        if len(nodes):
            content.node_sets[name] = nodes
    return content


def _load(path: Path) -> Any:
    """Read a file with meshio, which calls ``sys.exit`` on some bad files and prints on others."""
    import meshio

    noise = io.StringIO()
    try:
        with contextlib.redirect_stdout(noise), contextlib.redirect_stderr(noise):
            return meshio.read(path)
    except ModuleNotFoundError as error:
        name = str(error.name).split(".")[0]
        raise MeshError(
            [
                Problem(
                    path.name,
                    f"files of this format ({path.suffix}) need the library {name}",
                    remedy=_NEEDS.get(name, f"pip install {name}"),
                )
            ],
            "unreadable mesh",
        ) from None
    except (Exception, SystemExit) as error:  # meshio raises many kinds and calls sys.exit on bad input
        raise MeshError([_unreadable(path, noise.getvalue(), error)], "unreadable mesh") from None


def _unreadable(path: Path, noise: str, error: BaseException) -> Problem:
    """What meshio says of a file: the reasons it prints, not the sum of them, which it prints last."""
    lines = [" ".join(line.split()) for line in noise.splitlines() if line.strip()]
    reasons = [line for line in lines if not line.startswith(("Error: Couldn't read file", "Couldn't read file"))]
    own = "" if isinstance(error, SystemExit) else str(error) or type(error).__name__
    if isinstance(error, KeyError | IndexError | ValueError | AttributeError | TypeError):
        own = f"{type(error).__name__} {own}"
    reason = "; ".join([*reasons[:3], own] if own else reasons[:3]) or "; ".join(lines[-1:]) or "no reason given"
    return Problem(path.name, f"cannot be read: {reason[:300]}", allowed=f"a whole file of the format {path.suffix}")


def _groups(mesh: Any) -> dict[str, list[Index]]:
    """Cells of every group: for each block of cells, the rows that belong to it."""
    nothing = np.zeros(0, dtype=np.int64)
    groups: dict[str, list[Index]] = {}
    for name, blocks in mesh.cell_sets.items():
        if name.startswith("gmsh:"):
            continue
        found = [np.asarray([] if b is None else b, dtype=np.int64) for b in blocks]
        # a set written before later blocks names no cell of them
        groups[name] = found + [nothing] * (len(mesh.cells) - len(found))
    physical = mesh.cell_data.get("gmsh:physical")
    named = {name: tag for name, tag in mesh.field_data.items() if np.size(tag) == 2} if physical is not None else {}
    for name, (tag, dimension) in named.items():
        if name not in groups:
            groups[name] = [
                np.flatnonzero(np.asarray(tags) == tag) if _dimension(block.type) == dimension else nothing
                for block, tags in zip(mesh.cells, physical, strict=True)
            ]
    for tag, names in getattr(mesh, "cell_tags", {}).items():  # families of .med: one tag, several groups
        for name in names:
            before = groups.setdefault(name, [nothing] * len(mesh.cells))
            groups[name] = [
                np.union1d(rows, np.flatnonzero(np.asarray(tags) == tag))
                for rows, tags in zip(before, mesh.cell_data["cell_tags"], strict=True)
            ]
    return groups or _groups_of_data(mesh)


def _groups_of_data(mesh: Any) -> dict[str, list[Index]]:
    """Groups of a file without names: one for each value of its integer data, the first that tells parts apart."""
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
            group = content.volumes.setdefault(name, {})
            before = group.get(block.type, np.zeros(0, dtype=np.int64))
            group[block.type] = np.concatenate([before, start[select]])
        elif block.type in FLAT:
            facets = np.asarray(block.data, dtype=np.int64)[select][:, : FLAT[block.type]]
            content.facets.setdefault(name, []).append(facets)


def _check_rows(path: Path, content: MeshContent) -> None:
    """Cells and sets name nodes that are there."""
    tables = [*content.solids.values(), *content.node_sets.values()]
    tables += [facets for found in content.facets.values() for facets in found]
    if any(t.size and not (t.min() >= 0 and t.max() < len(content.points)) for t in tables):
        raise MeshError(
            [Problem(path.name, "cells name nodes that are not there", allowed=f"{len(content.points)} nodes")],
            "unreadable mesh",
        )
