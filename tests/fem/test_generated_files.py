"""Meshes of every type of cells, curved where they are quadratic, as gmsh and meshio write them in every format:
volume, first moment and areas of named faces are the integrals by scikit-fem over the same coordinates.

The integrals are over the surface (``surface_integrals``). What a writer is known to write wrongly is listed, and
refused.
"""

from __future__ import annotations

import contextlib
import io
from collections.abc import Iterator
from dataclasses import replace
from functools import cache
from importlib.util import find_spec
from pathlib import Path

import meshio
import numpy as np
import pytest

from latin_fmu.errors import MeshError
from latin_fmu.fem.elements import Elements
from latin_fmu.fem.mesh import FacetSet, Mesh, boundary
from latin_fmu.fem.mesh_file import mesh_of
from latin_fmu.mesh_files.child import NO_LIMIT
from latin_fmu.mesh_files.content import MeshContent
from latin_fmu.mesh_files.reading import read_content

from .conftest import GMSH_ORDER, GMSH_TYPE
from .meshes import TYPES, typed_box
from .surface_integrals import integrals

gmsh = pytest.importorskip("gmsh")

NAMES = {"foot": "zmin", "roof": "zmax", "side": "xmax"}
MSH = {f"gmsh {v} {'binary' if b else 'text'}": (".msh", v, b) for v in (2.2, 4.1) for b in (0, 1)}
GMSH = {
    **MSH,
    "gmsh 4.0": (".msh", 4.0, 0),
    "gmsh med": (".med", 4.1, 0),
    "gmsh vtk": (".vtk", 4.1, 0),
    "gmsh vtk binary": (".vtk", 4.1, 1),
    "gmsh medit": (".mesh", 4.1, 0),
    "gmsh su2": (".su2", 4.1, 0),
    "gmsh cgns": (".cgns", 4.1, 0),
    "gmsh unv": (".unv", 4.1, 0),
    "gmsh key": (".key", 4.1, 0),
}
MESHIO = {
    "meshio vtu": (".vtu", None),
    "meshio vtk": (".vtk", "vtk"),
    "meshio vtk 4.2": (".vtk", "vtk42"),
    "meshio xdmf": (".xdmf", None),
    "meshio med": (".med", None),
    "meshio medit": (".mesh", None),
    "meshio exodus": (".e", None),
}
REFUSED = {
    # gmsh 4.15.2 writes the cells with their corners and further numbers, or leaves them out
    **{("gmsh medit", kind): "save" for kind in ("hexahedron20", "hexahedron27")},
    **{("gmsh medit", kind): "no volume cells" for kind in ("wedge", "pyramid")},
    ("gmsh medit", "wedge15"): "not a whole file of the format .mesh",
    ("gmsh medit", "mixed"): "vertices of surface cells belong to no solid cell",
    ("gmsh key", "pyramid"): "leaves pyramids out",
    # meshio 5.3.5 writes the middle nodes in the order of VTK, where Exodus has another
    ("meshio exodus", "hexahedron20"): "middle nodes are not on their edges",
    # gmsh 4.15.2 writes pyramids of 13 nodes in its own order and under the number of those of 5
    **{(f"gmsh {name}", "pyramid13"): "number 14 of VTK with 13|type pyramid" for name in ("vtk", "vtk binary")},
    ("gmsh su2", "pyramid13"): "a cell with too many or too few nodes",
    ("gmsh medit", "pyramid13"): "no volume cells|not a whole",
    ("gmsh medit", "wedge18"): "no volume cells|not a whole",
    ("gmsh key", "pyramid13"): "leaves pyramids out",
    ("gmsh key", "wedge18"): "nodes of a solid that are not read",
    ("gmsh unv", "wedge18"): "wrong number of nodes.*SecondOrderIncomplete",
    ("gmsh unv", "pyramid13"): "not read|no volume cells",
    # gmsh 4.15.2 writes wedges in an order that LS-DYNA does not have; second order has other keywords
    ("gmsh key", "wedge"): "in an order that LS-DYNA does not have",
    ("gmsh key", "mixed"): "in an order that LS-DYNA does not have",
    ("gmsh key", "wedge15"): "solid elements that are not read",
    ("gmsh key", "hexahedron20"): "solid elements that are not read",
    ("gmsh key", "hexahedron27"): "solid elements that are not read",
    # universal files have no such cells
    ("gmsh unv", "hexahedron27"): "wrong number of nodes|not read",
    ("gmsh unv", "pyramid"): "not read|no volume cells",
}
"""Files that are not read, and a word of the reason: what these versions write is not what the format says."""

NOT_WRITTEN = {
    # meshio 5.3.5 ends with an error of its own
    *((name, kind) for name in MESHIO for kind in ("wedge15", "pyramid13")),
    *(("meshio medit", kind) for kind in ("tetra10", "hexahedron20", "hexahedron27", "pyramid")),
    ("meshio exodus", "hexahedron27"),
    ("meshio med", "hexahedron27"),
    ("meshio med", "wedge18"),
    ("meshio medit", "wedge18"),
    ("meshio exodus", "wedge18"),
    ("gmsh cgns", "pyramid13"),  # gmsh stops
}
LOST_PRECISION = {"gmsh medit": 1e-12, "gmsh key": 1e-10}  # of the coordinates as the file holds them


@cache
def curved(kind: str) -> Mesh:
    """A box of cells of a type, bent by a map of second degree where they are quadratic."""
    mesh = typed_box(kind, (2, 2, 2))
    nodes = mesh.nodes.copy()
    if any(len(b.cells[0]) > 8 for b in mesh.blocks):
        x, y, z = mesh.nodes.T
        nodes[:, 0] += 0.1 * y * y - 0.05 * y * x
        nodes[:, 1] += 0.08 * x * x + 0.06 * z * z
    faces = {name: mesh.faces[old] for name, old in NAMES.items()}
    return replace(mesh, nodes=nodes, faces=faces)


def write_by_gmsh(path: Path, mesh: Mesh, version: float, binary: int) -> None:
    """The mesh as a discrete model of gmsh: a physical volume, physical surfaces."""
    gmsh.initialize(interruptible=False)
    try:
        gmsh.option.setNumber("General.Terminal", 0)
        gmsh.model.add("box")
        for tag in range(1, len(mesh.faces) + 1):
            gmsh.model.addDiscreteEntity(2, tag)
        gmsh.model.addDiscreteEntity(3, 1)
        gmsh.model.mesh.addNodes(3, 1, np.arange(1, mesh.n_node + 1), mesh.nodes.ravel())
        pieces = [(3, 1, b.cell_type, b.cells) for b in mesh.blocks]
        for tag, (name, face) in enumerate(mesh.faces.items(), 1):
            pieces += [(2, tag, b.kind, b.facets) for b in face.blocks]
            gmsh.model.addPhysicalGroup(2, [tag], tag, name)
        gmsh.model.addPhysicalGroup(3, [1], 1, "body")
        for _, tag, kind, cells in pieces:
            rows = cells[:, GMSH_ORDER.get(kind, list(range(cells.shape[1])))] + 1
            gmsh.model.mesh.addElementsByType(tag, GMSH_TYPE[kind], [], rows.ravel())
        gmsh.option.setNumber("Mesh.MshFileVersion", version)
        gmsh.option.setNumber("Mesh.Binary", binary)
        gmsh.write(str(path))
    finally:
        gmsh.finalize()


def write_by_meshio(path: Path, mesh: Mesh, version: str | None) -> None:
    """The mesh with a number of its part at each cell."""
    cells: list[tuple[str, np.ndarray]] = [(b.cell_type, b.cells) for b in mesh.blocks]
    marks = [np.ones(len(b.cells), dtype=int) for b in mesh.blocks]
    for i, face in enumerate(mesh.faces.values(), 2):
        cells += [(b.kind, b.facets) for b in face.blocks]
        marks += [np.full(len(b.facets), i) for b in face.blocks]
    data = {"medit:ref" if path.suffix == ".mesh" else "PartId": marks}
    if path.suffix in (".e", ".med"):  # blocks alone, one of each type
        data = {}
        kinds = dict.fromkeys(kind for kind, _ in cells)
        cells = [(kind, np.concatenate([rows for k, rows in cells if k == kind])) for kind in kinds]
    with contextlib.redirect_stdout(io.StringIO()), contextlib.redirect_stderr(io.StringIO()):
        meshio.write(path, meshio.Mesh(mesh.nodes, cells, cell_data=data), version)


def cases() -> Iterator[tuple[str, str]]:
    yield from ((name, kind) for name in (*GMSH, *MESHIO) for kind in TYPES if (name, kind) not in NOT_WRITTEN)


def written(folder: Path, name: str, kind: str) -> MeshContent:
    path = folder / f"box{(GMSH | MESHIO)[name][0]}"
    if name in GMSH:
        write_by_gmsh(path, curved(kind), *GMSH[name][1:])
    else:
        write_by_meshio(path, curved(kind), MESHIO[name][1])
    return read_content(path)


Faces = dict[str, FacetSet]


@pytest.mark.parametrize(("name", "kind"), list(cases()))
def test_integrals(tmp_path: Path, name: str, kind: str, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv(NO_LIMIT, "0")
    if not find_spec("vtkmodules") and (name == "gmsh vtk binary" or (name, kind) == ("gmsh vtk", "wedge15")):
        pytest.skip("needs vtk")
    reason = REFUSED.get((name, kind))
    if reason is not None:
        with pytest.raises(MeshError, match=reason):
            mesh_of(written(tmp_path, name, kind), "box")
        return
    wanted, mesh = curved(kind), mesh_of(written(tmp_path, name, kind), "box")
    near = LOST_PRECISION.get(name, 1e-12)
    expected = integrals(wanted.nodes, boundary(wanted))
    np.testing.assert_allclose(integrals(mesh.nodes, boundary(mesh)), expected, atol=near * expected[0])
    assert Elements(mesh).volume.sum() == pytest.approx(expected[0], rel=near)
    faces = {} if name in ("meshio exodus", "meshio med") else named(mesh)
    for face in faces and NAMES:
        areas = [integrals(m.nodes, f)[4:] for m, f in ((wanted, wanted.faces[face]), (mesh, faces[face]))]
        np.testing.assert_allclose(areas[1], areas[0], atol=near * float(np.linalg.norm(areas[0])))


def named(mesh: Mesh) -> Faces:
    """Faces by the names of the test: formats without names number them."""
    if set(NAMES) <= set(mesh.faces):
        return mesh.faces
    numbers = sorted(mesh.faces, key=lambda text: int(text.rpartition("_")[2]))
    return {name: mesh.faces[number] for name, number in zip(NAMES, numbers, strict=True)}
