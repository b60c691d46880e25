"""scikit-fem: meshes with named subdomains and boundaries, which it writes by meshio."""

from __future__ import annotations

from pathlib import Path
from typing import Any, Final

import numpy as np
import skfem

from .solid import Format, Solid

TITLE: Final = "scikit-fem"
REQUIRES: Final = ("scikit-fem==12.0.2", "meshio==5.3.5", "h5py")
PACKAGE: Final = "scikit-fem"
_CLASSES: Final = {"tetra": "MeshTet1", "tetra10": "MeshTet2", "hexahedron": "MeshHex1", "wedge": "MeshWedge1"}
# names of groups are bits at the cells, which no other program reads; meshio leaves them out of .msh
FORMATS: Final = {
    ".vtu": Format(".vtu"),
    ".vtk": Format(".vtk"),
    ".xdmf": Format(".xdmf"),
    ".msh": Format(".msh", bodies=False, faces=False, option={"file_format": "gmsh"}),
}


def write(solid: Solid, form: Format, path: Path) -> None:
    """The solid in a format."""
    kinds = {kind for kind, _, _ in solid.cells}
    if len(kinds) > 1 or not kinds <= set(_CLASSES):
        raise ValueError("it has no such mesh")
    (kind,) = kinds
    cells = np.concatenate([rows for _, rows, _ in solid.cells])
    bodies = np.concatenate([np.full(len(rows), solid.bodies.index(name)) for _, rows, name in solid.cells])
    order = [0, 1, 3, 4, 2, 5, 7, 6] if kind == "hexahedron" else list(range(cells.shape[1]))
    mesh: Any = getattr(skfem, _CLASSES[kind])(solid.points.T, cells[:, order].T)
    mesh = mesh.with_subdomains({name: np.flatnonzero(bodies == i) for i, name in enumerate(solid.bodies)})
    keys = {tuple(sorted(facet)): i for i, facet in enumerate(mesh.facets.T.tolist())}
    faces = {}
    for face in solid.faces:
        corners = [row[: 3 if k[0] == "t" else 4] for k, rows, n in solid.facets if n == face for row in rows.tolist()]
        faces[face] = np.array([keys[tuple(sorted(row))] for row in corners])
    mesh.with_boundaries(faces).save(str(path), **(form.option or {}))
