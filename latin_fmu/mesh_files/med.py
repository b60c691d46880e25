"""MED files of Salome (.med): groups of cells, facets and nodes by families, the unit of length; read with h5py.

Every cell and node has the number of a family, and a family has any number of groups, also none. Cells are numbered
inside out by the rules of VTK, and turned later. Middle nodes follow the edges in the order of VTK.
"""

from __future__ import annotations

from collections.abc import Iterator
from pathlib import Path
from typing import Any, Final

import numpy as np

from ..errors import MeshError, listed
from .content import CORNERS, FLAT, Array, Index, MeshContent
from .library import missing_library
from .node_orders import EDGES, to_vtk

_TYPES: Final = {
    "TR3": ("triangle", 3),
    "TR6": ("triangle6", 6),
    "TR7": ("triangle7", 7),
    "QU4": ("quad", 4),
    "QU8": ("quad8", 8),
    "QU9": ("quad9", 9),
    "TE4": ("tetra", 4),
    "T10": ("tetra10", 10),
    "HE8": ("hexahedron", 8),
    "H20": ("hexahedron20", 20),
    "H27": ("hexahedron27", 27),
    "PE6": ("wedge", 6),
    "P15": ("wedge15", 15),
    "P18": ("wedge18", 18),
    "PY5": ("pyramid", 5),
    "P13": ("pyramid13", 13),
}
"""Cell types of MED: name and nodes."""

_SMALL: Final = ("PO1", "SE2", "SE3", "SE4")  # points and lines
_HEX27_FACES: Final = (*((0, 1, 2, 3), (0, 1, 5, 4), (1, 2, 6, 5), (2, 3, 7, 6), (3, 0, 4, 7), (4, 5, 6, 7)),)
_COLUMNS: Final = {"hexahedron27": to_vtk("hexahedron27", EDGES["hexahedron27"], _HEX27_FACES)}
_SOLID: Final = 300  # least number of the geometry of a solid (GEO)


def read_med(path: Path) -> MeshContent:
    """The mesh of a file.

    Raises
    ------
    MeshError : what is wrong with it, or that h5py is needed.
    """
    try:
        import h5py
    except ModuleNotFoundError:
        raise missing_library(path, "h5py") from None
    try:
        with h5py.File(path) as file:
            return _content(file, path)
    except MeshError:
        raise
    except Exception as error:  # h5py raises many kinds on damaged files
        what = f"not a usable MED file: {' '.join(str(error).split())[:200]}"
        raise MeshError.of("unreadable mesh", path.name, what, remedy="save it again") from None


def _content(file: Any, path: Path) -> MeshContent:
    meshes = file["ENS_MAA"]
    if len(meshes) != 1:
        what, remedy = "the file does not hold one mesh", "save each mesh as a file"
        raise MeshError.of("unreadable mesh", path.name, what, listed(meshes), "one mesh", remedy)
    (name,) = meshes
    mesh = meshes[name]
    if "NOE" not in mesh:
        steps = [step for step in mesh.values() if "NOE" in step]
        if not steps:
            what = "the mesh has no nodes (a grid by its axes?)"
            raise MeshError.of("unreadable mesh", path.name, what, name, "an unstructured mesh")
        unit, mesh = _text(mesh.attrs.get("UNI", b"")[:16]), steps[0]
    else:
        unit = _text(mesh.attrs.get("UNI", b"")[:16])
    content = MeshContent(_points(mesh["NOE"]["COO"]), unit=unit)
    families = file.get(f"FAS/{name}") or {}
    nodes = dict(_families(families.get("NOEUD") or {}))
    cells = dict(_families(families.get("ELEME") or {}))
    for code, table in (mesh.get("MAI") or {}).items():
        _add_cells(content, path, code, table, cells)
    if "FAM" in mesh["NOE"]:
        of_node = np.asarray(mesh["NOE"]["FAM"][()], dtype=np.int64).ravel()
        for number, groups in nodes.items():
            for group in groups if (of_node == number).any() else ():
                content.add_nodes(group, np.flatnonzero(of_node == number))
    return content


def _points(data: Any) -> Array:
    """Coordinates (n, 3): a file has all x first."""
    count = int(data.attrs["NBR"])
    table = np.asarray(data[()], dtype=float).reshape(-1, count).T
    return np.ascontiguousarray(np.hstack([table, np.zeros((count, 3 - table.shape[1]))]))


def _families(folder: Any) -> Iterator[tuple[int, list[str]]]:
    """Number and groups of each family; those without groups have none."""
    for family in folder.values():
        names = []
        if "GRO" in family and "NOM" in family["GRO"]:
            names = family["GRO"]["NOM"][()]
        yield int(family.attrs["NUM"]), [_text(np.asarray(row, dtype=np.int8).tobytes()) for row in names]


def _text(data: Any) -> str:
    if isinstance(data, bytes):
        raw = data
    else:
        raw = str(data).encode()
    return raw.split(b"\0")[0].decode("utf-8", "replace").strip()


def _add_cells(content: MeshContent, path: Path, code: str, table: Any, families: dict[int, list[str]]) -> None:
    """Cells of one type, and what their families say."""
    nodes = table["NOD"]
    if code not in _TYPES:
        if code not in _SMALL and int(table.attrs.get("GEO", _SOLID)) >= _SOLID:
            what = "cells of a type that is not read"
            raise MeshError.of("unreadable mesh", path.name, what, code, ", ".join(_TYPES))
        return
    kind, width = _TYPES[code]
    rows: Index = np.ascontiguousarray(np.asarray(nodes[()], dtype=np.int64).reshape(width, -1).T) - 1
    rows = rows[:, _COLUMNS.get(kind, list(range(width)))]
    if kind in CORNERS:
        places = content.add_solids(kind, rows)
    else:
        places = np.arange(len(rows))
    if "FAM" in table:
        numbers = np.asarray(table["FAM"][()], dtype=np.int64).ravel()
    else:
        numbers = np.zeros(len(rows), np.int64)
    for number in sorted(np.unique(numbers).tolist(), key=abs):  # families of cells count down
        chosen = np.flatnonzero(numbers == number)
        for group in families.get(number, []):
            if kind in CORNERS:
                content.add_volume(group, kind, places[chosen])
            elif kind in FLAT:
                content.add_facets(group, kind, rows[chosen])
