"""Remarks on bodies whose linear elements are too stiff: nearly incompressible material, coarse meshes that bend.

A linear element cannot curve. Bent over a wall of thickness t it holds parasitic shear, which makes the wall stiffer by
about

    c (l / t)^2,    l: edge of the element along the wall

c was measured on a cantilever of 20 x 2 x 1 elements and on finer ones: 0.55 for hexahedra (and wedges whose triangles
lie on the wall), 2.5 for tetrahedra (and wedges that stand on it).
"""

from __future__ import annotations

from collections.abc import Iterable

import numpy as np
from numpy.typing import NDArray

from ..fem.elasticity import BENDING_CELLS
from ..fem.mesh import FacetSet
from ..fem.walls import Walls, walls
from ..scene.boundaries import AXES, Boundary, Fixed, Periodic, PrescribedDisplacement, PrescribedVelocity, Symmetry
from ..scene.fields import split_face
from ..scene.schema import Scene
from .body import Body

LOCKING_POISSON = 0.45
HEXAHEDRON, TETRAHEDRON = 0.55, 2.5  # c of the module docstring
_SHARE = 0.05  # of the surface: less of it is no wall worth a remark
_LINEAR = ("hexahedron", "tetra", "wedge")


def locking_remarks(scene: Scene, bodies: dict[str, Body]) -> list[str]:
    """Warnings where linear elements are known to be too stiff."""
    remarks = []
    for name, body in bodies.items():
        stiff = _stiff_types(body)
        if body.rigid or not stiff:
            continue
        nu = body.shape.material.poisson_ratio
        if nu > LOCKING_POISSON:
            remarks.append(
                f"substructure {name}: Poisson's ratio {nu:g} > {LOCKING_POISSON}: linear elements lock (too stiff)"
            )
        boundaries = [b for b in scene.boundary.values() if split_face(_face(b))[0] == name]
        if any(isinstance(b, Periodic) for b in boundaries):
            continue
        box = body.description.box
        found = _box_walls(body, boundaries) if box is not None else _mesh_walls(body, boundaries)
        extent = float(body.mesh.extent().max())
        if (told := _told(found, stiff, set(body.mesh.cell_types), extent)) is not None:
            remedy = f"set substructure.{name}.bending_modes" if "hexahedron" in stiff else "use quadratic elements"
            remarks.append(f"substructure {name}: {told}; {remedy} (waves along it are not concerned)")
    return remarks


def _stiff_types(body: Body) -> set[str]:
    """Types of cells of the body that are too stiff in bending."""
    types = set(body.mesh.cell_types) & set(_LINEAR)
    return types - set(BENDING_CELLS) if body.shape.bending_modes else types


def _told(found: Walls, stiff: set[str], types: set[str], extent: float) -> str | None:
    """What is wrong with the walls of a body of this size, if anything: slender ones bend, and short ones if they are
    very coarse."""
    factors = _factors(stiff, types)
    excess = np.array([factors.get(kind, 0.0) for kind in found.kind.tolist()]) * (found.length / found.thickness) ** 2
    slender = extent / found.thickness
    coarse = (excess > np.where(slender > 10.0, 0.2, 0.6)) & (slender > 5.0)
    if found.area[coarse].sum() <= _SHARE * found.area.sum():
        return None
    thickness, times = found.thickness[coarse], found.length[coarse] / found.thickness[coarse]
    return (
        f"linear elements {np.median(times):.2g} times as long as the wall of {np.median(thickness):.3g} m is thick: "
        f"in bending it would be about {100 * float(np.median(excess[coarse])):.0f} % too stiff"
    )


def _factors(stiff: set[str], types: set[str]) -> dict[str, float]:
    """c of the module docstring by kind of facet on the wall, in a mesh of these types of cells."""
    quad = TETRAHEDRON if "hexahedron" not in types else HEXAHEDRON if "hexahedron" in stiff else 0.0
    return {"quad": quad, "triangle": TETRAHEDRON if "tetra" in stiff else HEXAHEDRON}


def _mesh_walls(body: Body, boundaries: Iterable[Boundary]) -> Walls:
    mirrors: list[tuple[FacetSet, NDArray[np.bool_]]] = []
    for boundary_condition in boundaries:
        facets = body.facets(split_face(_face(boundary_condition))[1])
        mirrors.append((facets, _held_axes(boundary_condition)))
    return walls(body.mesh, body.outside, mirrors)


def _box_walls(body: Body, boundaries: Iterable[Boundary]) -> Walls:
    """The thinnest direction in which the box may bend, without a search."""
    box = body.description.box
    assert box is not None
    size, elements = np.asarray(box.size), np.asarray(box.elements)
    free = np.ones(3, dtype=bool)
    for boundary_condition in boundaries:
        axis = "xyz".index(split_face(_face(boundary_condition))[1][0])
        free[axis] &= not _held_axes(boundary_condition)[axis]
    if not free.any():
        return Walls(np.zeros(0), np.zeros(0), np.zeros(0), np.zeros(0, dtype=np.str_))
    thin = int(np.argmin(np.where(free, size, np.inf)))
    along = int(np.argmax(size))
    length = size[along] / elements[along]
    return Walls(np.ones(1), size[[thin]], np.array([length]), np.array(["quad"]))


def _face(boundary_condition: Boundary) -> str:
    return boundary_condition.faces[0] if isinstance(boundary_condition, Periodic) else boundary_condition.face


def _held_axes(boundary_condition: Boundary) -> NDArray[np.bool_]:
    """Axes along which the face moves as a whole, or not at all, (3,)."""
    if isinstance(boundary_condition, Symmetry):
        return np.ones(3, dtype=bool)  # along the normal of the face, whichever axis that is
    if isinstance(boundary_condition, Fixed | PrescribedVelocity | PrescribedDisplacement):
        return np.isin(AXES, boundary_condition.components)
    return np.zeros(3, dtype=bool)
