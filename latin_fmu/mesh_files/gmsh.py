"""Meshes of gmsh (.msh of versions 2, 4.0 and 4.1, as text and binary); physical groups are volumes and faces.

Read here and not by a library: they are what most scenes use, the libraries know no pyramids of 13 nodes and count node
tags below 1 from the end. A group without a name is ``physical_3``; without groups the volumes of the geometry are
``geometrical_3``.
"""

from __future__ import annotations

import re
import warnings
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any, Final

import numpy as np

from ..errors import MeshError
from .content import CORNERS, FLAT, NO_ROWS, Array, Index, MeshContent, rows_of
from .node_orders import to_vtk

_TYPES: Final = {
    1: ("line", 2),
    2: ("triangle", 3),
    3: ("quad", 4),
    4: ("tetra", 4),
    5: ("hexahedron", 8),
    6: ("wedge", 6),
    7: ("pyramid", 5),
    8: ("line3", 3),
    9: ("triangle6", 6),
    10: ("quad9", 9),
    11: ("tetra10", 10),
    12: ("hexahedron27", 27),
    13: ("wedge18", 18),
    14: ("pyramid14", 14),
    15: ("vertex", 1),
    16: ("quad8", 8),
    17: ("hexahedron20", 20),
    18: ("wedge15", 15),
    19: ("pyramid13", 13),
    21: ("triangle10", 10),
    26: ("line4", 4),
    29: ("tetra20", 20),
    36: ("quad16", 16),
    90: ("wedge40", 40),
    92: ("hexahedron64", 64),
    118: ("pyramid30", 30),
}
"""Cell types by the number of gmsh: name and nodes (gmsh manual, MSH file format)."""

_HEX_EDGES: Final = (*((0, 1), (0, 3), (0, 4), (1, 2), (1, 5), (2, 3), (2, 6), (3, 7), (4, 5), (4, 7), (5, 6), (6, 7)),)
_HEX_FACES: Final = ((0, 1, 2, 3), (0, 1, 5, 4), (0, 3, 7, 4), (1, 2, 6, 5), (2, 3, 7, 6), (4, 5, 6, 7))
_PYRAMID_EDGES: Final = ((0, 1), (0, 3), (0, 4), (1, 2), (1, 4), (2, 3), (2, 4), (3, 4))
_WEDGE_EDGES: Final = ((0, 1), (0, 2), (0, 3), (1, 2), (1, 4), (2, 5), (3, 4), (3, 5), (4, 5))
_COLUMNS: Final = {
    "tetra10": to_vtk("tetra10", ((0, 1), (1, 2), (2, 0), (0, 3), (2, 3), (1, 3))),
    "hexahedron20": to_vtk("hexahedron20", _HEX_EDGES),
    "hexahedron27": to_vtk("hexahedron27", _HEX_EDGES, _HEX_FACES),
    "wedge15": to_vtk("wedge15", _WEDGE_EDGES),
    "wedge18": to_vtk("wedge18", _WEDGE_EDGES, ((0, 1, 4, 3), (0, 2, 5, 3), (1, 2, 5, 4))),
    "pyramid13": to_vtk("pyramid13", _PYRAMID_EDGES),
}
"""Columns in the order of VTK (gmsh manual, node ordering)."""

_NO_CELLS: Final = ("vertex", "line", "line3", "line4")  # of no body, and of no face
_SECTIONS: Final = ("Entities", "PartitionedEntities", "Nodes", "Elements")  # those of numbers that are read
_DAMAGED: Final = "not a whole .msh file"


@dataclass
class _Elements:
    """Elements of one type: node tags, the tags of their physical groups and of their entity of the geometry."""

    number: int
    nodes: Index
    physical: tuple[int, ...]
    geometrical: int


@dataclass
class _Parsed:
    """What the sections of a file hold; names of groups by (dimension, tag)."""

    tags: list[Index] = field(default_factory=list)
    points: list[Array] = field(default_factory=list)
    names: dict[tuple[int, int], str] = field(default_factory=dict)
    physical: dict[tuple[int, int], tuple[int, ...]] = field(default_factory=dict)
    blocks: list[_Elements] = field(default_factory=list)

    def add_nodes(self, tags: Index, points: Array) -> None:
        """Nodes with tags (n,) at points (n, 3)."""
        self.tags.append(tags)
        self.points.append(points)


class _Numbers:
    """Numbers of a section one after the other, as text or binary."""

    def __init__(self, data: bytes, binary: bool) -> None:
        self.data = data
        self.binary = binary
        self.at = 0
        if binary:
            self.values = np.zeros(0)
        else:
            self.values = _numbers_of(data)

    def take(self, count: int, kind: str) -> Any:
        """The next numbers of a NumPy type, (count,). Raises ValueError where the section ends before."""
        if self.binary:
            return np.frombuffer(self._bytes(count * np.dtype(kind).itemsize), kind)
        if kind.endswith("f8"):
            return self._next(count)
        return _whole(self._next(count))

    def one(self, kind: str) -> int:
        """The next whole number."""
        return int(self.take(1, kind)[0])

    def tagged_points(self, count: int, order: str) -> tuple[Index, Array]:
        """The next nodes, each with its tag before its coordinates: (count,) and (count, 3)."""
        if self.binary:
            table = np.frombuffer(self._bytes(28 * count), [("tag", f"{order}i4"), ("x", f"{order}f8", 3)])
            return table["tag"].astype(np.int64), table["x"].astype(float)
        rows = self._next(4 * count).reshape(count, 4)
        return _whole(rows[:, 0]), rows[:, 1:]

    def equal_rows(self, most: int, width: int, kind: int, n_tag: int) -> int:
        """How many rows of a text from here on have this type and this number of tags."""
        most = min(most, (len(self.values) - self.at) // width)
        rows = 0
        size = 64
        while rows < most:
            size = min(2 * size, most - rows)
            start = self.at + rows * width
            table = self.values[start : start + size * width].reshape(size, width)
            same = (table[:, 1] == kind) & (table[:, 2] == n_tag)
            if not same.all():
                return rows + int(same.argmin())
            rows += size
        return rows

    def _next(self, count: int) -> Array:
        values = self.values[self.at : self.at + max(count, 0)]
        if len(values) != count:
            raise ValueError("a section ends early")
        self.at += count
        return values

    def _bytes(self, size: int) -> bytes:
        piece = self.data[self.at : self.at + max(size, 0)]
        if len(piece) != size:
            raise ValueError("a section ends early")
        self.at += size
        return piece


def _numbers_of(text: bytes) -> Array:
    """All numbers of a text. Raises ValueError for anything else."""
    with warnings.catch_warnings():
        warnings.simplefilter("error", DeprecationWarning)  # NumPy warns of text that is no number
        try:
            return np.fromstring(text, sep=" ")
        except DeprecationWarning:
            raise ValueError("a section of numbers holds something else") from None


def _whole(values: Array) -> Index:
    """Numbers of a text that have to be whole. Raises ValueError for others."""
    if not (np.abs(values) < 2**53).all() or (values != np.rint(values)).any():  # NaN, too
        raise ValueError("a number that is not whole")
    return values.astype(np.int64)


def is_gmsh(start: bytes) -> bool:
    """Whether the first bytes of a file are those of a .msh file of gmsh."""
    return start.lstrip().startswith((b"$MeshFormat", b"$NOD", b"$Comments"))


def read_gmsh(path: Path) -> MeshContent:
    """The mesh of a file.

    Raises
    ------
    MeshError : what is wrong with it.
    """
    data = path.read_bytes()
    match = re.search(rb"\$MeshFormat\s+(\d+)(?:\.(\d+))?\s+([01])\s+(\d+)", data[:4000])
    if match is None:
        if data.lstrip().startswith(b"$NOD"):
            old = "version 1 of the format, which gmsh wrote until 2004"
        else:
            old = _DAMAGED
        raise MeshError.of("unreadable mesh", path.name, old, remedy="save it with gmsh, version 2 or 4")
    version = (int(match[1]), int((match[2] or b"0")[:1]))
    binary = match[3] == b"1"
    readers = {(2, 0): _read_2, (4, 0): _read_40, (4, 1): _read_41}
    reader = readers.get((2, 0) if version[0] == 2 else version)
    if reader is None:
        value = f"{version[0]}.{version[1]}"
        raise MeshError.of("unreadable mesh", path.name, "unknown version of .msh", value, "2, 4.0, 4.1")
    parsed = _Parsed()
    try:
        if binary and match[4] != b"8":
            raise ValueError(f"numbers of {match[4].decode()} bytes")
        if binary:
            order = _byte_order(data, match.end())
        else:
            order = "<"
        for name, section in _sections(data):
            reader(name, section, binary, order, parsed)
        return _content(parsed, path)
    except (ValueError, IndexError, OverflowError, KeyError, UnicodeDecodeError) as error:
        raise MeshError.of("unreadable mesh", path.name, f"{_DAMAGED}: {error}", remedy="save it again") from None


def _byte_order(data: bytes, at: int) -> str:
    """Byte order of a binary file, by the number 1 behind the line of its format."""
    start = data.index(b"\n", at) + 1
    one = data[start : start + 4]
    if one not in (b"\1\0\0\0", b"\0\0\0\1"):
        raise ValueError("no mark of the byte order")
    if one[0] == 1:
        return "<"
    return ">"


def _sections(data: bytes) -> Iterator[tuple[str, bytes]]:
    """Name and content of every section; of the last one of a name too."""
    at = 0
    while (match := re.compile(rb"\$(\w+)[ \t]*\r?\n").search(data, at)) is not None:
        name = match[1].decode("ascii", "replace")
        end = data.find(b"$End" + match[1], match.end())
        if end < 0:
            raise ValueError(f"the section {name} does not end")
        yield name, data[match.end() : end]
        at = end + len(name) + 4


def _names(section: bytes, parsed: _Parsed) -> None:
    """$PhysicalNames: dimension, tag and name in quotes."""
    for match in re.finditer(rb'^\s*(\d+)\s+(-?\d+)\s+"([^"\n]*)"', section, re.MULTILINE):
        parsed.names[int(match[1]), int(match[2])] = match[3].decode("utf-8", "replace")


def _read_2(name: str, section: bytes, binary: bool, order: str, parsed: _Parsed) -> None:
    """A section of version 2."""
    if name == "PhysicalNames":
        _names(section, parsed)
    elif name == "Nodes":
        count, numbers = _counted(section, binary)
        parsed.add_nodes(*numbers.tagged_points(count, order))
    elif name == "Elements":
        count, numbers = _counted(section, binary)
        while count > 0:
            count -= _elements_2(numbers, count, order, parsed)


def _counted(section: bytes, binary: bool) -> tuple[int, _Numbers]:
    """Count in the first line of a section, and its numbers behind it."""
    first, _, rest = section.partition(b"\n")
    return int(first), _Numbers(rest, binary)


def _elements_2(numbers: _Numbers, most: int, order: str, parsed: _Parsed) -> int:
    """The next elements of one type with equal numbers of tags; how many they are.

    Text: number, type, count of tags, tags, nodes in each row. Binary: type, rows, count of tags before the rows.
    """
    if numbers.binary:
        kind, rows, n_tag = (int(number) for number in numbers.take(3, f"{order}i4"))
        lead = 1
    else:
        kind, n_tag = _whole(numbers.values[numbers.at + 1 : numbers.at + 3]).tolist()
        lead, rows = 3, most
    if kind not in _TYPES:
        raise ValueError(f"an element of the unknown type {kind}")
    width = lead + n_tag + _TYPES[kind][1]
    if n_tag < 0 or rows < 0:
        raise ValueError(f"{rows} elements with {n_tag} tags")
    if not numbers.binary:
        rows = numbers.equal_rows(most, width, kind, n_tag)
        if not rows:
            raise ValueError("a section ends early")
    table = numbers.take(rows * width, f"{order}i4" if numbers.binary else "i8").astype(np.int64).reshape(rows, width)
    marks = table[:, lead : lead + min(n_tag, 2)]
    for mark in np.unique(marks, axis=0):
        chosen = table[(marks == mark).all(axis=1)]
        physical, geometrical = (*mark.tolist(), 0, 0)[:2]
        groups = (abs(physical),) if physical else ()
        parsed.blocks.append(_Elements(kind, chosen[:, lead + n_tag :], groups, geometrical))
    return rows


def _kinds(binary: bool, order: str) -> tuple[str, str, str]:
    """NumPy types of sizes, whole and real numbers in version 4."""
    if binary:
        return (f"{order}u8", f"{order}i4", f"{order}f8")
    return ("i8", "i8", "f8")


def _entities(numbers: _Numbers, version: int, order: str, partitioned: bool, parsed: _Parsed) -> None:
    """Physical groups of the entities of the geometry, or of its partitions."""
    size, whole, real = _kinds(numbers.binary, order)
    if partitioned:
        numbers.one(size)
        numbers.take(2 * numbers.one(size), whole)  # ghosts
    counts = [numbers.one(size) for _ in range(4)]
    for dimension, count in enumerate(counts):
        for _ in range(count):
            tag = numbers.one(whole)
            if partitioned:
                numbers.take(2, whole)
                numbers.take(numbers.one(size), whole)
            # a point has one place from 4.1 on, all else the corners of a box
            numbers.take(3 if version and dimension == 0 else 6, real)
            groups = numbers.take(numbers.one(size), whole)
            parsed.physical[dimension, tag] = tuple(abs(g) for g in groups.tolist())
            if dimension:
                numbers.take(numbers.one(size), whole)


def _read_40(name: str, section: bytes, binary: bool, order: str, parsed: _Parsed) -> None:
    """A section of version 4.0: node tags beside their coordinates, tag and dimension of an entity in this order."""
    size, whole, _ = _kinds(binary, order)
    if name == "PhysicalNames":
        _names(section, parsed)
        return
    if name not in _SECTIONS:
        return
    numbers = _Numbers(section, binary)
    if name == "PartitionedEntities":
        raise ValueError("partitions in version 4.0 (save it in version 4.1)")
    if name == "Entities":
        _entities(numbers, 0, order, False, parsed)
    elif name == "Nodes":
        blocks, _ = numbers.take(2, size).tolist()
        for _ in range(blocks):
            _, _, parametric = numbers.take(3, whole).tolist()
            count = numbers.one(size)
            if parametric:
                raise ValueError("nodes with parametric coordinates (save with Mesh.SaveParametric = 0)")
            parsed.add_nodes(*numbers.tagged_points(count, order))
    elif name == "Elements":
        blocks, _ = numbers.take(2, size).tolist()
        for _ in range(blocks):
            entity, dimension, kind = numbers.take(3, whole).tolist()
            _add_block(numbers, (dimension, entity), kind, numbers.one(size), whole, parsed)


def _read_41(name: str, section: bytes, binary: bool, order: str, parsed: _Parsed) -> None:
    """A section of version 4.1: all node tags of a block before the coordinates."""
    size, whole, real = _kinds(binary, order)
    if name == "PhysicalNames":
        _names(section, parsed)
        return
    if name not in _SECTIONS:
        return
    numbers = _Numbers(section, binary)
    if name in ("Entities", "PartitionedEntities"):
        _entities(numbers, 1, order, name.startswith("P"), parsed)
    elif name == "Nodes":
        blocks = int(numbers.take(4, size)[0])
        for _ in range(blocks):
            dimension, _, parametric = numbers.take(3, whole).tolist()
            count = numbers.one(size)
            tags = numbers.take(count, size).astype(np.int64)
            width = 3 + (dimension if parametric else 0)
            parsed.add_nodes(tags, numbers.take(count * width, real).reshape(-1, width)[:, :3].astype(float))
    elif name == "Elements":
        blocks = int(numbers.take(4, size)[0])
        for _ in range(blocks):
            dimension, entity, kind = numbers.take(3, whole).tolist()
            _add_block(numbers, (dimension, entity), kind, numbers.one(size), size, parsed)


def _add_block(numbers: _Numbers, entity: tuple[int, int], kind: int, count: int, number: str, parsed: _Parsed) -> None:
    """Elements of one entity: number and nodes in each row."""
    if kind not in _TYPES:
        raise ValueError(f"an element of the unknown type {kind}")
    width = 1 + _TYPES[kind][1]
    rows = numbers.take(count * width, number).astype(np.int64).reshape(-1, width)
    parsed.blocks.append(_Elements(kind, rows[:, 1:], parsed.physical.get(entity, ()), entity[1]))


def _content(parsed: _Parsed, path: Path) -> MeshContent:
    """Everything by rows and names."""
    tags = np.concatenate([NO_ROWS, *parsed.tags])
    points = np.concatenate([np.zeros((0, 3)), *parsed.points])
    # a node on several partitions is written with each of them
    labels, first = np.unique(tags, return_index=True)
    content = MeshContent(np.ascontiguousarray(points[first]))
    places = _places(labels)
    grouped = any(block.physical for block in parsed.blocks)
    for block in _merged(parsed.blocks):
        kind = _TYPES[block.number][0]
        cells = _rows(path, labels, places, block.nodes)
        cells = cells[:, _COLUMNS.get(kind, list(range(cells.shape[1])))]
        if kind in CORNERS:
            rows = content.add_solids(kind, cells)
            for name in _group_names(parsed, block, 3, grouped):
                content.add_volume(name, kind, rows)
        elif kind in FLAT:
            for name in _group_names(parsed, block, 2, grouped):
                content.add_facets(name, kind, cells)
        elif kind not in _NO_CELLS:
            content.skipped[kind] = content.skipped.get(kind, 0) + len(cells)
    return content


def _places(labels: Index) -> Index | None:
    """Row of each node by its tag, -1 where there is none; None where tags are too far apart for a table."""
    if not len(labels) or labels[0] < 0 or labels[-1] > 10 * len(labels) + 1000:
        return None
    table = np.full(int(labels[-1]) + 2, -1, dtype=np.int64)
    table[labels] = np.arange(len(labels))
    return table


def _rows(path: Path, labels: Index, places: Index | None, nodes: Index) -> Index:
    """Rows of the nodes of cells. Raises MeshError where a node is not there."""
    if nodes.size and nodes.min() < 1:
        what = "an element names a node tag below 1"
        raise MeshError.of("unreadable mesh", path.name, what, str(int(nodes.min())), ">= 1")
    if places is None:
        rows, there = rows_of(labels, nodes.ravel())
    else:
        rows = places[np.minimum(nodes.ravel(), len(places) - 1)]  # the last place is that of no node
        there = rows >= 0
    if not there.all():
        what, value = "cells name nodes that are not there", str(int(nodes.ravel()[there.argmin()]))
        raise MeshError.of("unreadable mesh", path.name, what, value, f"{len(labels)} nodes")
    return rows.reshape(nodes.shape)


def _merged(blocks: list[_Elements]) -> list[_Elements]:
    """Blocks in which a solid that version 2 writes once for each of its physical groups is one cell."""
    result = [block for block in blocks if _TYPES[block.number][0] not in CORNERS]
    for number in dict.fromkeys(block.number for block in blocks):
        same = [block for block in blocks if block.number == number and _TYPES[number][0] in CORNERS]
        if len({block.physical for block in same}) < 2:
            result += same
            continue
        nodes = np.concatenate([block.nodes for block in same])
        owners = np.repeat(np.arange(len(same)), [len(block.nodes) for block in same])
        unique, cell = np.unique(nodes, axis=0, return_inverse=True)
        pairs = np.unique(np.stack([cell.ravel(), owners], axis=1), axis=0)
        # a cell twice in one group is a fault of the file, refused later
        if len(unique) == len(nodes) or len(pairs) < len(nodes):
            result += same
            continue
        groups: dict[tuple[int, ...], list[int]] = {}
        starts = np.searchsorted(pairs[:, 0], np.arange(len(unique) + 1))
        for i in range(len(unique)):
            groups.setdefault(tuple(pairs[starts[i] : starts[i + 1], 1].tolist()), []).append(i)
        for members, rows in groups.items():
            physical = tuple(dict.fromkeys(tag for m in members for tag in same[m].physical))
            result.append(_Elements(number, unique[rows], physical, same[members[0]].geometrical))
    return result


def _group_names(parsed: _Parsed, block: _Elements, dimension: int, grouped: bool) -> list[str]:
    """Names of the groups of a block; of a file without physical groups its entity of the geometry."""
    if grouped:
        return [parsed.names.get((dimension, tag), f"physical_{tag}") for tag in block.physical]
    if block.geometrical:
        return [f"geometrical_{block.geometrical}"]
    return []


def write_gmsh(path: Path, nodes: Array, groups: Mapping[str, tuple[int, Sequence[tuple[str, Index]]]]) -> None:
    """Write a .msh file of version 2.2, binary.

    Parameters
    ----------
    nodes : (n_node, 3). groups : dimension (3: a volume, 2: a face) and blocks of cells (type, (n_cell, n_node) in
        the order of VTK) of each physical group.

    Raises
    ------
    OSError : the file cannot be written. KeyError : a type of cells that the format does not have.
    """
    numbers = {name: (number, count) for number, (name, count) in _TYPES.items()}
    parts = [b"$MeshFormat\n2.2 1 8\n" + np.array([1], "<i4").tobytes() + b"\n$EndMeshFormat\n"]
    names = [f'{dimension} {tag} "{name}"' for tag, (name, (dimension, _)) in enumerate(groups.items(), 1)]
    parts.append("\n".join(["$PhysicalNames", str(len(names)), *names, "$EndPhysicalNames", ""]).encode())
    table = np.zeros(len(nodes), [("tag", "<i4"), ("x", "<f8", 3)])
    table["tag"], table["x"] = np.arange(1, len(nodes) + 1), nodes
    parts.append(b"$Nodes\n%d\n" % len(nodes) + table.tobytes() + b"\n$EndNodes\n")
    rows, count = [], 0
    for tag, (_, blocks) in enumerate(groups.values(), 1):
        for kind, cells in (block for block in blocks if len(block[1])):
            number, width = numbers[kind]
            elements = np.empty((len(cells), 3 + width), "<i4")
            elements[:, 0] = count + np.arange(1, len(cells) + 1)
            elements[:, 1:3] = tag
            # the column of VTK that each column of gmsh is
            order = np.argsort(_COLUMNS.get(kind, list(range(width))))
            elements[:, 3:] = cells[:, order] + 1
            rows.append(np.array([number, len(cells), 2], "<i4").tobytes() + elements.tobytes())
            count += len(cells)
    parts.append(b"$Elements\n%d\n" % count + b"".join(rows) + b"\n$EndElements\n")
    path.write_bytes(b"".join(parts))
