"""Footprints of contacts and supports on the surface of a mesh: their rims, and the nodes of the cells there.

A footprint is the part of the surface of a body that something presses on or holds. Its rim is where facets of the
footprint border on facets outside of it. The stress of linear elasticity has no limit there under refinement, as below
the edge of a rigid punch (Johnson, Contact Mechanics, 1985, section 2.8).
"""

from __future__ import annotations

from collections.abc import Iterable

import numpy as np

from .mesh import Index, Mask, Mesh, boundary


def rim(mesh: Mesh, footprint: Index) -> Index:
    """Corner nodes (n,) of the rim of a footprint, ascending; of facets with all corners among the nodes of the
    ``footprint``, which border on others.

    >>> from latin_fmu.fem.mesh import box_mesh
    >>> mesh = box_mesh(np.zeros(3), np.ones(3), (3, 1, 1))
    >>> mesh.nodes[rim(mesh, mesh.faces["xmin"].nodes)][:, 0].tolist()
    [0.0, 0.0, 0.0, 0.0]
    """
    pressed = np.zeros(mesh.n_node, dtype=bool)
    pressed[footprint] = True
    inside, outside = np.zeros(mesh.n_node, dtype=bool), np.zeros(mesh.n_node, dtype=bool)
    for block in boundary(mesh).blocks:
        whole = pressed[block.corners].all(axis=1)
        inside[block.corners[whole]] = True
        outside[block.corners[~whole]] = True
    return np.flatnonzero(inside & outside)


def near_rims(mesh: Mesh, footprints: Iterable[Index]) -> Mask:
    """Nodes (n_node,) of the cells that touch the rim of one of the ``footprints``."""
    on_rim = np.zeros(mesh.n_node, dtype=bool)
    for footprint in footprints:
        on_rim[rim(mesh, footprint)] = True
    near = np.zeros(mesh.n_node, dtype=bool)
    for block in mesh.blocks:
        near[block.cells[on_rim[block.cells].any(axis=1)]] = True
    return near
