"""Middle nodes of quadratic cells lie on the edges they belong to, whatever the order in which a format counts them."""

from __future__ import annotations

from pathlib import Path

import netCDF4
import numpy as np
import pytest

from latin_fmu.fem.reference_cells import HEX_EDGES, TET_EDGES, WEDGE_EDGES
from latin_fmu.mesh_files.content import MeshContent
from latin_fmu.mesh_files.reading import read_content

CORNERS = {
    "tetra10": [[0, 0, 0], [1, 0, 0], [0, 1, 0], [0, 0, 1]],
    "wedge15": [[0, 0, 0], [1, 0, 0], [0, 1, 0], [0, 0, 2], [1, 0, 2], [0, 1, 2]],
    "hexahedron20": [[0, 0, 0], [1, 0, 0], [1, 3, 0], [0, 3, 0], [0, 0, 2], [1, 0, 2], [1, 3, 2], [0, 3, 2]],
}
EDGES = {"tetra10": TET_EDGES, "wedge15": WEDGE_EDGES, "hexahedron20": HEX_EDGES}
# edges (corners from 1) in the order of their nodes: manuals of Nastran (CPENTA, CHEXA) and Exodus II (WEDGE15, HEX20)
VERTICAL_BEFORE_TOP = {
    "tetra10": ["12", "23", "31", "14", "24", "34"],
    "wedge15": ["12", "23", "31", "14", "25", "36", "45", "56", "64"],
    "hexahedron20": ["12", "23", "34", "41", "15", "26", "37", "48", "56", "67", "78", "85"],
}
# Abaqus counts the nodes of the upper edges first (C3D10, C3D15, C3D20)
TOP_BEFORE_VERTICAL = {
    "tetra10": VERTICAL_BEFORE_TOP["tetra10"],
    "wedge15": ["12", "23", "31", "45", "56", "64", "14", "25", "36"],
    "hexahedron20": ["12", "23", "34", "41", "56", "67", "78", "85", "15", "26", "37", "48"],
}


def nodes_in(kind: str, order: dict[str, list[str]]) -> np.ndarray:
    corners = np.array(CORNERS[kind], dtype=float)
    middles = [0.5 * (corners[int(a) - 1] + corners[int(b) - 1]) for a, b in order[kind]]
    return np.concatenate([corners, middles])


def assert_in_place(content: MeshContent, kind: str) -> None:
    cell = content.points[content.solids[kind][0]]
    for i, (a, b) in enumerate(EDGES[kind]):
        np.testing.assert_allclose(cell[len(CORNERS[kind]) + i], 0.5 * (cell[a] + cell[b]), err_msg=f"{kind} {i}")


@pytest.mark.parametrize("kind", CORNERS)
def test_abaqus(tmp_path: Path, kind: str) -> None:
    nodes = nodes_in(kind, TOP_BEFORE_VERTICAL)
    labels = range(1, len(nodes) + 1)
    text = "*NODE\n" + "".join(f"{i}, {x}, {y}, {z}\n" for i, (x, y, z) in zip(labels, nodes.tolist(), strict=True))
    listed = ["1", *map(str, labels)]
    text += f"*ELEMENT, TYPE=C3D{len(nodes)}\n" + ", ".join(listed[:16]) + ",\n" + ", ".join(listed[16:]) + "\n"
    path = tmp_path / "cell.inp"
    path.write_text(text)
    assert_in_place(read_content(path), kind)


@pytest.mark.parametrize("kind", CORNERS)
def test_nastran(tmp_path: Path, kind: str) -> None:
    nodes = nodes_in(kind, VERTICAL_BEFORE_TOP)
    text = "".join(f"GRID,{i},,{x},{y},{z}\n" for i, (x, y, z) in enumerate(nodes.tolist(), 1))
    fields = [str(i) for i in range(1, len(nodes) + 1)]
    name = {"tetra10": "CTETRA", "wedge15": "CPENTA", "hexahedron20": "CHEXA"}[kind]
    text += f"{name},1,1,{','.join(fields[:6])},+\n+,{','.join(fields[6:14])},+\n"
    if fields[14:]:
        text += f"+,{','.join(fields[14:])}\n"
    path = tmp_path / "cell.bdf"
    path.write_text(text)
    assert_in_place(read_content(path), kind)


@pytest.mark.parametrize("kind", CORNERS)
def test_exodus(tmp_path: Path, kind: str) -> None:
    nodes = nodes_in(kind, VERTICAL_BEFORE_TOP)
    path = tmp_path / "cell.e"
    with netCDF4.Dataset(path, "w") as data:
        for name, size in {"num_nodes": len(nodes), "num_el_blk": 1, "one": 1}.items():
            data.createDimension(name, size)
        for i, axis in enumerate("xyz"):
            data.createVariable(f"coord{axis}", "f8", ("num_nodes",))[:] = nodes[:, i]
        block = data.createVariable("connect1", "i4", ("one", "num_nodes"))
        block.elem_type = {"tetra10": "TETRA", "wedge15": "WEDGE", "hexahedron20": "HEX"}[kind]
        block[:] = np.arange(1, len(nodes) + 1)[None]
    assert_in_place(read_content(path), kind)
