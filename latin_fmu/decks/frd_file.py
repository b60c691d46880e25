"""The field results of CalculiX in ASCII, ``.frd``: nodes, elements, blocks of values at nodes by instant.

Layout as ``ccx`` 2.20 writes it (measured; CGX manual, result format): a key in the first columns, numbers of nodes and
elements of ten columns, values of twelve with six digits. Middle nodes of bricks and wedges stand on the upright edges
before those of the upper face.
"""

from __future__ import annotations

import math
from collections.abc import Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass
from types import MappingProxyType
from typing import Final

import numpy as np

from ..mesh_files.content import Array, Index


@dataclass(frozen=True)
class FrdKind:
    """A kind of block: its name in the file and those of its components."""

    title: str
    components: tuple[str, ...]


_TENSOR: Final = ("XX", "YY", "ZZ", "XY", "YZ", "ZX")
KINDS: Final[Mapping[str, FrdKind]] = MappingProxyType(
    {
        "U": FrdKind("DISP", ("D1", "D2", "D3")),
        "V": FrdKind("VELO", ("V1", "V2", "V3")),
        "S": FrdKind("STRESS", tuple(f"S{axes}" for axes in _TENSOR)),
        "E": FrdKind("TOSTRAIN", tuple(f"E{axes}" for axes in _TENSOR)),
        "ME": FrdKind("MESTRAIN", tuple(f"ME{axes}" for axes in _TENSOR)),
        "RF": FrdKind("FORC", ("F1", "F2", "F3")),
    }
)
"""Kinds by the word of a deck, in the order in which they are written at an instant."""
ELEMENTS: Final[Mapping[str, tuple[int, tuple[int, ...]]]] = MappingProxyType(
    {
        "hexahedron": (1, tuple(range(8))),
        "wedge": (2, tuple(range(6))),
        "tetra": (3, tuple(range(4))),
        "hexahedron20": (4, (*range(12), *range(16, 20), *range(12, 16))),
        "wedge15": (5, (*range(9), *range(12, 15), *range(9, 12))),
        "tetra10": (6, tuple(range(10))),
    }
)
"""Number of the type, and places of its nodes in VTK order, by type of cell."""
_NODES: Final = 10  # of an element in a line
_TENSORS: Final = ((1, 1), (2, 2), (3, 3), (1, 2), (2, 3), (3, 1))


@dataclass(frozen=True)
class FrdBlock:
    """Values at nodes at one instant.

    Attributes
    ----------
    kind : key of ``KINDS``. time : of the deck. labels : (n,) ascending numbers of nodes. values : (n, 3 | 6). step,
    increment : numbers, from 1. moving : whether the step has inertia.
    """

    kind: str
    time: float
    labels: Index
    values: Array
    step: int = 1
    increment: int = 1
    moving: bool = False


@dataclass(frozen=True)
class FrdMesh:
    """Nodes and elements of a file.

    Attributes
    ----------
    labels : (n,) ascending numbers of nodes. points : (n, 3). elements : number, type of cell, numbers of its nodes in
    VTK order, and number of its material from 1; ascending. materials : names.
    """

    labels: Index
    points: Array
    elements: Sequence[tuple[int, str, Sequence[int], int]]
    materials: Sequence[str]


def frd_text(mesh: FrdMesh, blocks: Iterable[FrdBlock]) -> Iterator[str]:
    """Pieces of a file, in order: its head with the mesh, then each block."""
    yield "\n".join(_head(mesh)) + "\n"
    count, instant, before = 0, 0, None
    for block in blocks:
        now = (block.step, block.increment)
        count, instant = count + 1, instant + (now != before)
        before = now
        yield "\n".join(_block(block, count, instant)) + "\n"
    yield " 9999\n"


def _head(mesh: FrdMesh) -> Iterator[str]:
    yield "    1C"
    yield f"    1U{'latin-fmu':<66}"
    for number, name in enumerate(mesh.materials, 1):
        yield f"    1UMAT{number:5d}{name:<66}"
    yield f"    2C{len(mesh.labels):30d}{1:38d}"
    for label, point in zip(mesh.labels.tolist(), mesh.points, strict=True):
        yield f" -1{label:10d}{_numbers(point)}"
    yield " -3"
    yield f"    3C{len(mesh.elements):30d}{1:38d}"
    for label, kind, nodes, material in mesh.elements:
        number, order = ELEMENTS[kind]
        yield f" -1{label:10d}{number:5d}{0:5d}{material:5d}"
        row = [nodes[place] for place in order]
        for first in range(0, len(row), _NODES):
            yield " -2" + "".join(f"{node:10d}" for node in row[first : first + _NODES])
    yield " -3"


def _block(block: FrdBlock, count: int, instant: int) -> Iterator[str]:
    kind = KINDS[block.kind]
    wide = len(kind.components)
    yield f"    1PSTEP{count:26d}{block.increment:12d}{block.step:12d}{'':10}"
    head = f"  100CL{100 + instant:5d}{_time(block.time)}{len(block.labels):12d}"
    yield f"{head}{int(block.moving):22d}{instant:5d}{1:12d}"
    length = wide + (wide == 3)
    yield f" -4  {kind.title:<8}{length:5d}{1:5d}"
    for i, name in enumerate(kind.components, 1):
        place = f"{2:5d}{i:5d}{0:5d}" if wide == 3 else "{:5d}{:5d}{:5d}".format(4, *_TENSORS[i - 1])
        yield f" -5  {name:<8}{1:5d}{place}"
    if wide == 3:
        yield f" -5  {'ALL':<8}{1:5d}{2:5d}{0:5d}{0:5d}{1:5d}ALL"
    for label, values in zip(block.labels.tolist(), block.values, strict=True):
        yield f" -1{label:10d}{_numbers(values)}"
    yield " -3"


def _numbers(values: Array) -> str:
    return "".join(f"{float(x) + 0.0:12.5E}" for x in values)


def _time(time: float) -> str:
    """An instant in twelve columns: ten digits from 1 on, six below."""
    if 1.0 <= time < 1e9:
        return f"{time:12.{9 - int(math.log10(time))}f}"
    return f"{time:12.5E}"


def read_frd(text: str) -> list[FrdBlock]:
    """Blocks of the kinds in ``KINDS`` of an ASCII file, those of other kinds left out.

    >>> mesh = FrdMesh(np.array([7]), np.zeros((1, 3)), [], [])
    >>> block = FrdBlock("U", 0.5, np.array([7]), np.array([[1.0, -2.0, 0.25]]))
    >>> [(one.kind, one.time, one.values.tolist()) for one in read_frd("".join(frd_text(mesh, [block])))]
    [('U', 0.5, [[1.0, -2.0, 0.25]])]
    """
    words = {kind.title: word for word, kind in KINDS.items()}
    found: list[FrdBlock] = []
    time, step, increment, moving, kind = 0.0, 1, 1, False, ""
    rows: list[tuple[int, list[float]]] = []
    for line in text.splitlines():
        if line.startswith("    1PSTEP"):
            increment, step = int(line[36:48]), int(line[48:60])
        elif line.startswith("  100C"):
            time, moving = float(line[12:24]), line[36:58].strip() == "1"
        elif line.startswith(" -4"):
            kind, rows = words.get(line[5:13].strip(), ""), []
        elif line.startswith(" -1") and kind:
            count = len(KINDS[kind].components)
            rows.append((int(line[3:13]), [float(line[13 + 12 * i : 25 + 12 * i]) for i in range(count)]))
        elif line.startswith(" -3") and kind:
            labels = np.array([label for label, _ in rows], dtype=np.int64)
            values = np.array([values for _, values in rows]).reshape(len(rows), -1)
            found.append(FrdBlock(kind, time, labels, values, step, increment, moving))
            kind = ""
    return found
