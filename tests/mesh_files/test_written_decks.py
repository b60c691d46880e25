"""Curved meshes of every type of cell, written as decks: volume, first moment and area of the faces come back."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import meshio
import numpy as np
import pytest

from latin_fmu.fem.elements import Elements
from latin_fmu.fem.faces import face
from latin_fmu.fem.mesh import Mesh
from latin_fmu.fem.mesh_file import mesh_of
from latin_fmu.fem.reference_cells import FACET_CORNERS
from latin_fmu.mesh_files.content import CORNERS
from latin_fmu.mesh_files.middle_nodes import ORDERS, VTK
from latin_fmu.mesh_files.reading import read_content
from tests.fem.meshes import TYPES, skewed, typed_box

NASTRAN = {"tetra": "CTETRA", "pyramid": "CPYRAM", "wedge": "CPENTA", "hexahedron": "CHEXA"}


def curved(kind: str) -> Mesh:
    mesh = typed_box(kind, (2, 2, 1))
    return replace(mesh, nodes=skewed(mesh.nodes, 0.05))


def in_order(kind: str, cells: np.ndarray, program: str) -> np.ndarray:
    """Cells in the order of VTK in that of a program."""
    if kind not in VTK:
        return cells
    places = [frozenset(place) for place in VTK[kind]]
    columns = [CORNERS[kind] + places.index(frozenset(place)) for place in ORDERS[program][kind]]
    return cells[:, [*range(CORNERS[kind]), *columns]]


def abaqus(mesh: Mesh, program: str) -> str:
    """Cells as C3Dn, faces as shells of their corners."""
    text = "*NODE\n" + "".join(f"{i}, {x!r}, {y!r}, {z!r}\n" for i, (x, y, z) in enumerate(mesh.nodes.tolist(), 1))
    label = 0
    for block in mesh.blocks:
        cells = in_order(block.cell_type, block.cells, program) + 1
        # gmsh writes wedges of 18 nodes under this name
        name = 6 if block.cell_type == "wedge18" else cells.shape[1]
        text += f"*ELEMENT, TYPE=C3D{name}, ELSET=part\n"
        for cell in cells.tolist():
            label += 1
            fields = [str(n) for n in (label, *cell)]
            text += "".join(", ".join(fields[i : i + 15]) + ",\n" for i in range(0, len(fields), 15))[:-2] + "\n"
    for name_of_face, facets in mesh.faces.items():
        for block_of_face in facets.blocks:
            corners = FACET_CORNERS[block_of_face.kind]
            text += f"*ELEMENT, TYPE=S{corners}, ELSET={name_of_face}\n"
            for facet in (block_of_face.facets[:, :corners] + 1).tolist():
                label += 1
                text += f"{label}, {', '.join(map(str, facet))}\n"
    return text


def nastran(mesh: Mesh, program: str) -> str:
    """Cells with property 1, the faces as shells with properties from 10 on, named by comments."""
    text = "".join(f"GRID,{i},,{x!r},{y!r},{z!r}\n" for i, (x, y, z) in enumerate(mesh.nodes.tolist(), 1))
    label = 0
    for block in mesh.blocks:
        name = NASTRAN[block.cell_type.rstrip("0123456789")]
        for cell in (in_order(block.cell_type, block.cells, program) + 1).tolist():
            label += 1
            fields = [str(n) for n in (label, 1, *cell)]
            text += "".join(f"{'' if i else name},{','.join(fields[i : i + 8])}\n" for i in range(0, len(fields), 8))
    for owner, (name_of_face, facets) in enumerate(mesh.faces.items(), 10):
        text += f'$HMNAME PROP {owner}"{name_of_face}" 4\n'
        for block_of_face in facets.blocks:
            corners = FACET_CORNERS[block_of_face.kind]
            for facet in (block_of_face.facets[:, :corners] + 1).tolist():
                label += 1
                text += f"{'CTRIA3' if corners == 3 else 'CQUAD4'},{label},{owner},{','.join(map(str, facet))}\n"
    return text


def moments(mesh: Mesh) -> np.ndarray:
    """Volume and first moment, (4,)."""
    total = np.zeros(4)
    for _, points in Elements(mesh).points(of_products=True):
        places = points.values @ mesh.nodes[points.cells]
        total += np.einsum(
            "cp,cpi->i", points.volumes, np.concatenate([np.ones((*places.shape[:2], 1)), places], axis=2)
        )
    return total


@pytest.mark.parametrize("kind", TYPES)
@pytest.mark.parametrize(
    ("suffix", "program"), [("inp", "Abaqus"), ("inp", "gmsh"), ("bdf", "Nastran"), ("bdf", "gmsh")]
)
def test_integrals_come_back(tmp_path: Path, kind: str, suffix: str, program: str) -> None:
    mesh = curved(kind)
    path = tmp_path / f"mesh.{suffix}"
    path.write_text((abaqus if suffix == "inp" else nastran)(mesh, program))
    content = read_content(path)
    content.refuse()
    again = mesh_of(content, path.name, "part" if suffix == "inp" else "PSOLID_1")
    np.testing.assert_allclose(moments(again), moments(mesh), rtol=1e-12)
    for name in mesh.faces:
        ours, theirs = face(again, name), face(mesh, name)
        assert ours.areas.sum() == pytest.approx(theirs.areas.sum(), rel=1e-12)
        np.testing.assert_allclose(ours.vector_areas.sum(axis=0), theirs.vector_areas.sum(axis=0), atol=1e-13)


# it has no name for pyramids and quadratic wedges in .inp, for quadratic pyramids and wedges in .bdf
OF_MESHIO = ("tetra", "tetra10", "wedge", "hexahedron", "hexahedron20")


@pytest.mark.parametrize(("kind", "suffix"), [*((k, s) for k in OF_MESHIO for s in ("inp", "bdf")), ("pyramid", "bdf")])
def test_decks_of_meshio(tmp_path: Path, kind: str, suffix: str) -> None:
    """Against the same cells on the coordinates as the file holds them."""
    # meshio 5.3 stops at numbers that take more than 16 characters
    mesh = curved(kind)
    mesh = replace(mesh, nodes=np.round(mesh.nodes + 1.0, 6))
    path = tmp_path / f"mesh.{suffix}"
    meshio.Mesh(mesh.nodes, [(kind, mesh.blocks[0].cells)]).write(path)
    content = read_content(path)
    again, there = mesh_of(content, path.name), replace(mesh, nodes=content.points)
    np.testing.assert_allclose(moments(again), moments(there), rtol=1e-12)
    np.testing.assert_allclose(moments(again), moments(mesh), rtol=1e-6)
