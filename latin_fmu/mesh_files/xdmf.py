"""XDMF files (.xdmf, .xmf) with numbers as text, in HDF5 or in binary files beside them; cells of several types too.

Data of the cells name the parts (``cell_groups``), sets of cells and of nodes have names of their own. Of a series in
time the first mesh counts. Read here: meshio 5.3 and meshlane 5.5 stop at mixed cells of second order.
"""

from __future__ import annotations

import xml.etree.ElementTree as ET
from pathlib import Path
from typing import Any, Final

import numpy as np

from ..errors import MeshError
from .cell_groups import groups_of_data
from .content import CORNERS, FLAT, Index, MeshContent

_TYPES: Final = {
    1: ("polyvertex", "vertex", 1),
    2: ("polyline", "line", 2),
    4: ("triangle", "triangle", 3),
    5: ("quadrilateral", "quad", 4),
    6: ("tetrahedron", "tetra", 4),
    7: ("pyramid", "pyramid", 5),
    8: ("wedge", "wedge", 6),
    9: ("hexahedron", "hexahedron", 8),
    34: ("edge_3", "line3", 3),
    35: ("quadrilateral_9", "quad9", 9),
    36: ("triangle_6", "triangle6", 6),
    37: ("quadrilateral_8", "quad8", 8),
    38: ("tetrahedron_10", "tetra10", 10),
    39: ("pyramid_13", "pyramid13", 13),
    40: ("wedge_15", "wedge15", 15),
    41: ("wedge_18", "wedge18", 18),
    48: ("hexahedron_20", "hexahedron20", 20),
    49: ("hexahedron_24", "hexahedron24", 24),
    50: ("hexahedron_27", "hexahedron27", 27),
}
"""Types of cells by number: name in the file, type of cell, nodes (XDMF model and format)."""

_SHORT: Final = {
    "tet": "tetrahedron",
    "hex": "hexahedron",
    "quad": "quadrilateral",
    "tri": "triangle",
    "edge": "polyline",
}
_COUNTED: Final = (1, 2)  # of mixed cells these have the number of their nodes behind their type
_LETTERS: Final = {"float": "f", "int": "i", "uint": "u", "char": "i", "uchar": "u"}
Block = tuple[str, Index, Index]
"""Type, nodes, and rows of the cells in the order of the file."""


def read_xdmf(path: Path) -> MeshContent:
    """The mesh of a file.

    Raises
    ------
    MeshError : what is wrong with it, or that h5py is needed.
    """
    try:
        return _content(path)
    except MeshError:
        raise
    except ModuleNotFoundError as error:
        what = f"this file needs the library {error.name}"
        raise MeshError.of("unreadable mesh", path.name, what, remedy=f"pip install {error.name}") from None
    except Exception as error:  # of XML, HDF5 and numbers that are damaged
        what = f"not a usable XDMF file: {' '.join(str(error).split())[:200]}"
        raise MeshError.of("unreadable mesh", path.name, what, remedy="save it again") from None


def _content(path: Path) -> MeshContent:
    grids = [g for g in ET.parse(path).getroot().iter("Grid") if g.find("Topology") is not None]
    spatial = [g for g in ET.parse(path).getroot().iter("Grid") if g.get("CollectionType", "").lower() == "spatial"]
    if not grids or spatial:
        if spatial:
            what = "pieces of a mesh in several grids are not read"
        else:
            what = "the file has no grid of cells"
        raise MeshError.of("unreadable mesh", path.name, what, None, "one grid", "save the mesh as one grid")
    grid = grids[0]
    content = MeshContent(_points(path, grid))
    blocks = _blocks(path, grid)
    solids: list[Index] = []
    for kind, nodes, _ in blocks:
        solids.append(content.add_cells(kind, nodes))
    data: dict[str, list[Any]] = {}
    for attribute in grid.findall("Attribute"):
        if attribute.get("Center", "").lower() == "cell":
            values = _item(path, attribute)
        else:
            values = np.zeros(0)
        if values.size == sum(len(rows) for _, _, rows in blocks):
            flat = values.ravel()
            data[attribute.get("Name", "cells")] = [flat[rows] for _, _, rows in blocks]
    groups = groups_of_data(data, [len(rows) for _, _, rows in blocks])
    for item in grid.findall("Set"):
        chosen, name = _item(path, item).ravel().astype(np.int64), item.get("Name", "set")
        if item.get("SetType", "").lower() == "node":
            content.add_nodes(name, chosen)
        elif item.get("SetType", "").lower() == "cell":
            groups[name] = [np.flatnonzero(np.isin(rows, chosen)) for _, _, rows in blocks]
    for name, selects in groups.items():
        for (kind, nodes, _), rows, select in zip(blocks, solids, selects, strict=True):
            if len(select) and kind in CORNERS:
                content.add_volume(name, kind, rows[select])
            elif len(select) and kind in FLAT:
                content.add_facets(name, kind, nodes[select])
    return content


def _points(path: Path, grid: ET.Element) -> Any:
    geometry = grid.find("Geometry")
    if geometry is None:
        raise ValueError("a grid without Geometry")
    form = (geometry.get("GeometryType") or geometry.get("Type") or "XYZ").upper()
    items = [_array(path, item) for item in geometry.findall("DataItem")]
    if form in ("XYZ", "XY"):
        table = items[0].reshape(-1, len(form))
    elif form == "X_Y_Z":
        table = np.stack([item.ravel() for item in items], axis=1)
    else:
        raise MeshError.of("unreadable mesh", path.name, "a structured grid is not read", form, "XYZ, XY, X_Y_Z")
    return np.ascontiguousarray(np.hstack([table.astype(float), np.zeros((len(table), 3 - table.shape[1]))]))


def _blocks(path: Path, grid: ET.Element) -> list[Block]:
    """Cells by type."""
    topology = grid.find("Topology")
    assert topology is not None
    name = (topology.get("TopologyType") or topology.get("Type") or "").lower()
    flat = _item(path, topology).ravel().astype(np.int64)
    if name == "mixed":
        return _mixed(path, flat)
    stem, _, rest = name.partition("_")
    long = "_".join([_SHORT.get(stem, stem), rest]).rstrip("_")
    for form, kind, width in _TYPES.values():
        if long == form and (kind not in ("vertex", "line") or flat.size):
            table = flat.reshape(-1, int(topology.get("NodesPerElement", width)))
            return [(kind, table, np.arange(len(table)))]
    raise MeshError.of("unreadable mesh", path.name, "cells of a type that is not read", name, "first or second order")


def _mixed(path: Path, flat: Index) -> list[Block]:
    """Cells that have their type before their nodes each."""
    nodes: dict[str, list[Index]] = {}
    rows: dict[str, list[int]] = {}
    at = count = 0
    while at < len(flat):
        code = int(flat[at])
        if code not in _TYPES:
            raise MeshError.of("unreadable mesh", path.name, "cells of a type that is not read", f"number {code}")
        _, kind, width = _TYPES[code]
        if code in _COUNTED:
            at += 1
            width = int(flat[at])
        if width < 1 or at + width >= len(flat):
            raise ValueError("the cells end early")
        if code not in _COUNTED:
            nodes.setdefault(kind, []).append(flat[at + 1 : at + 1 + width])
            rows.setdefault(kind, []).append(count)
        at, count = at + 1 + width, count + 1
    return [(kind, np.array(nodes[kind]), np.array(rows[kind], dtype=np.int64)) for kind in nodes]


def _item(path: Path, owner: ET.Element) -> Any:
    item = owner.find("DataItem")
    if item is None:
        raise ValueError(f"a {owner.tag} without DataItem")
    return _array(path, item)


def _array(path: Path, item: ET.Element) -> Any:
    """Numbers of a DataItem."""
    shape = [int(n) for n in item.get("Dimensions", "").split()]
    letter = _LETTERS[(item.get("NumberType") or item.get("DataType") or "Float").lower()]
    kind = np.dtype(f"{letter}{int(item.get('Precision', 4))}")
    form, text = (item.get("Format") or "XML").upper(), (item.text or "").strip()
    if form == "XML":
        values = np.array(list(map(float if letter == "f" else int, text.split())), dtype=kind)
    elif form == "HDF":
        import h5py

        name, _, inside = text.rpartition(":")
        with h5py.File(path.parent / name) as file:
            values = np.asarray(file[inside][()])
    elif form == "BINARY":
        if (item.get("Endian") or "").lower() == "big":
            kind = kind.newbyteorder(">")
        data = (path.parent / text).read_bytes()[int(item.get("Seek", 0)) :]
        values = np.frombuffer(data, kind, int(np.prod(shape)))
    else:
        raise ValueError(f"numbers in the form {form}")
    return values.reshape(shape)
