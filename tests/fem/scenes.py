"""Mesh files and scenes of boxes of every type of cell."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np

from latin_fmu.fem.mesh import Mesh, box_mesh

from .conftest import write_msh
from .meshes import cut


def as_groups(mesh: Mesh) -> dict[str, Any]:
    """Volume "part" and the named faces, also where they are made of several types (see ``write_msh``)."""
    groups: dict[str, Any] = {}
    blocks = [("part", b.cell_type, b.cells) for b in mesh.blocks]
    blocks += [(name, b.kind, b.facets) for name, face in mesh.faces.items() for b in face.blocks]
    for name, kind, table in blocks:
        groups[f"{name}#{kind}" if name in groups else name] = (kind, table)
    return groups


def box_file(
    path: Path, cell_type: str, size: tuple[float, ...], elements: tuple[int, int, int], bottom: float = 0.0
) -> dict[str, Any]:
    """Write a box with its lowest corner at (0, 0, bottom); the table of a substructure made of it."""
    mesh = cut(box_mesh(np.array([0.0, 0.0, bottom]), np.array(size), elements), cell_type)
    write_msh(path, mesh.nodes, as_groups(mesh))
    return {"material": "steel", "mesh": {"file": str(path), "group": "part"}}


def steel(poisson_ratio: float = 0.0, **keys: float) -> dict[str, Any]:
    """Table of materials."""
    return {"steel": {"young_modulus": 210e9, "poisson_ratio": poisson_ratio, "density": 7800.0, **keys}}
