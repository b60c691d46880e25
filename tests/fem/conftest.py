"""Small meshes, straight and distorted, and writers of mesh files that do not depend on any library."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from numpy.typing import NDArray

from latin_fmu.fem.mesh import Array, Index, Mesh, box_mesh

from .meshes import ORIGIN, SIZE, cut

Groups = Mapping[str, tuple[str, Index]]  # name -> type of cell, connectivity
Writer = Callable[[Path, Array, Groups], None]


def distorted(mesh: Mesh, amplitude: float, boundary: bool) -> Mesh:
    """Nodes moved at random by a fraction of the element size; the boundary only on request."""
    rng = np.random.default_rng(11)
    step = SIZE / 3 * amplitude
    shift = rng.uniform(-1.0, 1.0, mesh.nodes.shape) * step
    if not boundary:
        inside = np.all((mesh.nodes > ORIGIN + 1e-9) & (mesh.nodes < ORIGIN + SIZE - 1e-9), axis=1)
        shift[~inside] = 0.0
    return replace(mesh, nodes=mesh.nodes + shift)


@pytest.fixture
def box() -> Mesh:
    """3 x 3 x 3 hexahedra."""
    return box_mesh(ORIGIN, SIZE, (3, 3, 3))


@pytest.fixture(params=["hexahedron", "tetra"])
def straight(request: pytest.FixtureRequest, box: Mesh) -> Mesh:
    """The box, interior nodes distorted, with either type of cell."""
    return distorted(cut(box, request.param), 0.25, boundary=False)


@pytest.fixture(params=["hexahedron", "tetra"])
def warped(request: pytest.FixtureRequest, box: Mesh) -> Mesh:
    """The box with all nodes distorted: faces of hexahedra are no longer plane."""
    return distorted(cut(box, request.param), 0.2, boundary=True)


GMSH_TYPE = {
    "triangle": 2,
    "quad": 3,
    "tetra": 4,
    "hexahedron": 5,
    "wedge": 6,
    "pyramid": 7,
    "triangle6": 9,
    "quad9": 10,
    "tetra10": 11,
    "hexahedron27": 12,
    "wedge18": 13,
    "quad8": 16,
    "hexahedron20": 17,
    "hexahedron64": 92,
    "wedge15": 18,
    "pyramid13": 19,
}
# Place in the order of VTK of each node in the order of gmsh, where the two differ.
GMSH_ORDER = {
    "wedge15": [*range(7), 8, 12, 7, 13, 14, 9, 11, 10],
    "wedge18": [*range(7), 8, 12, 7, 13, 14, 9, 11, 10, 15, 17, 16],
    "pyramid13": [*range(6), 8, 9, 6, 10, 7, 11, 12],
    "tetra10": [0, 1, 2, 3, 4, 5, 6, 7, 9, 8],
    "hexahedron20": [*range(8), 8, 11, 16, 9, 17, 10, 18, 19, 12, 15, 13, 14],
    "hexahedron27": [*range(8), 8, 11, 16, 9, 17, 10, 18, 19, 12, 15, 13, 14, 24, 22, 20, 21, 23, 25, 26],
}
ABAQUS_TYPE = {
    "triangle": "S3",
    "quad": "S4",
    "tetra": "C3D4",
    "pyramid": "C3D5",
    "hexahedron": "C3D8",
    "wedge": "C3D6",
    "hexahedron20": "C3D20",
    "tetra10": "C3D10",
    "triangle6": "STRI65",
    "quad8": "S8R",
    "wedge15": "C3D15",
    "pyramid13": "C3D13",
    "hexahedron27": "C3D27",
}


def write_msh(path: Path, nodes: Array, groups: Groups) -> None:
    """Gmsh 4.1 ASCII, one entity per group; "top#2" is another entity of the group "top"."""
    dims = {name: 2 if kind.startswith(("triangle", "quad")) else 3 for name, (kind, _) in groups.items()}
    tags = {name: 10 + i for i, name in enumerate(groups)}
    whole = {name: tags[name.split("#")[0]] for name in groups}
    names = [f'{dims[n]} {tags[n]} "{n}"' for n in groups if "#" not in n]
    span = "0 0 0 1 1 1"
    surfaces = [f"{tags[n]} {span} 1 {whole[n]} 0" for n in groups if dims[n] == 2]
    volumes = [f"{tags[n]} {span} 1 {whole[n]} 0" for n in groups if dims[n] == 3]
    n = len(nodes)
    lines = [
        "$MeshFormat",
        "4.1 0 8",
        "$EndMeshFormat",
        "$PhysicalNames",
        str(len(names)),
        *names,
        "$EndPhysicalNames",
        "$Entities",
        f"0 0 {len(surfaces)} {len(volumes)}",
        *surfaces,
        *volumes,
        "$EndEntities",
        "$Nodes",
        f"1 {n} 1 {n}",
        f"3 {max(tags.values())} 0 {n}",
        *(str(i + 1) for i in range(n)),
        *(" ".join(map(repr, map(float, x))) for x in nodes),
        "$EndNodes",
    ]
    total = sum(len(cells) for _, cells in groups.values())
    lines += ["$Elements", f"{len(groups)} {total} 1 {total}"]
    tag = 0
    for name, (kind, cells) in groups.items():
        lines.append(f"{dims[name]} {tags[name]} {GMSH_TYPE[kind]} {len(cells)}")
        for cell in cells[:, GMSH_ORDER.get(kind, list(range(cells.shape[1])))]:
            tag += 1
            lines.append(f"{tag} " + " ".join(str(c + 1) for c in cell))
    path.write_text("\n".join([*lines, "$EndElements", ""]))


def write_inp(path: Path, nodes: Array, groups: Groups) -> None:
    """Abaqus input, one ELSET per group."""
    lines = ["*NODE", *(f"{i + 1}, " + ", ".join(map(repr, map(float, x))) for i, x in enumerate(nodes))]
    tag = 0
    for name, (kind, cells) in groups.items():
        lines.append(f"*ELEMENT, TYPE={ABAQUS_TYPE[kind]}, ELSET={name}")
        for cell in cells:
            tag += 1
            words = [str(tag), *(str(c + 1) for c in cell)]
            lines += [
                ", ".join(words[i : i + 15]) + ("," if i + 15 < len(words) else "") for i in range(0, len(words), 15)
            ]
    path.write_text("\n".join([*lines, ""]))


@pytest.fixture(params=[("msh", write_msh), ("inp", write_inp)], ids=["msh", "inp"])
def written(request: pytest.FixtureRequest, tmp_path: Path) -> Callable[[Array, Groups], Path]:
    """Writes nodes and groups to a file of each format and returns its path."""
    suffix, writer = request.param

    def write(nodes: Array, groups: Groups) -> Path:
        path = tmp_path / f"part.{suffix}"
        writer(path, nodes, groups)
        return path

    return write


@pytest.fixture
def msh(tmp_path: Path) -> Callable[[NDArray[np.float64], Groups], Path]:
    """Writes a .msh file."""

    def write(nodes: Array, groups: Groups) -> Path:
        path = tmp_path / "part.msh"
        write_msh(path, nodes, groups)
        return path

    return write
