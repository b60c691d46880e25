"""Remarks on bodies whose linear elements are too stiff: nearly incompressible material, coarse meshes that bend.

A linear element cannot curve. Bent over a wall of thickness t it holds parasitic shear, which makes the wall stiffer by
about

    c (l / t)^2,    l: edge of the element along the wall

c was measured on a cantilever of 20 x 2 x 1 elements and on finer ones: 0.55 for hexahedra (and wedges whose triangles
lie on the wall), 2.5 for tetrahedra (and wedges that stand on it). Thickness and edges are found facet by facet.
"""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from ..fem.elasticity import BENDING_CELLS
from ..fem.mesh import Array, FacetSet, Mesh
from ..scene.boundaries import AXES, Boundary, Fixed, Periodic, PrescribedDisplacement, PrescribedVelocity, Symmetry
from ..scene.fields import split_face
from ..scene.schema import Scene
from .body import Body

LOCKING_POISSON = 0.45
HEXAHEDRON, TETRAHEDRON = 0.55, 2.5  # c of the module docstring
_SHARE = 0.05  # of the surface: less of it is no wall worth a remark
_LINEAR = ("hexahedron", "tetra", "wedge")
_MOST = 400  # facets looked at: every so many of a larger surface
_OPPOSED = -0.5  # cosine between the normals of two sides of a wall
_REACH = 0.6  # of both facets' longest edges: how far apart, across the wall, two opposite facets may stand


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


@dataclass(frozen=True)
class Walls:
    """Facets of a surface and the wall behind each.

    Attributes
    ----------
    area : (n,), m2. thickness : (n,) distance to the opposite side, m, infinite where there is none.
    length : (n,) edge of the facet that counts in bending, m: the longest of quadrilaterals, the mean of triangles.
    kind : (n,) of the facet, as in ``FacetBlock``.
    """

    area: Array
    thickness: Array
    length: Array
    kind: NDArray[np.str_]


@dataclass(frozen=True)
class _Facets:
    centre: Array
    normal: Array
    area: Array
    longest: Array
    mean: Array
    kind: NDArray[np.str_]

    def picked(self, rows: NDArray[np.intp]) -> _Facets:
        return _Facets(*(getattr(self, name)[rows] for name in self.__dataclass_fields__))


def walls(mesh: Mesh, surface: FacetSet, mirrors: list[tuple[FacetSet, NDArray[np.bool_]]]) -> Walls:
    """Walls behind a surface of the mesh.

    Parameters
    ----------
    surface : all boundary facets. mirrors : faces that cannot move along some axes (flags (3,)): facets that face
        along these are no side of a wall, because the wall cannot bend towards them.
    """
    facets = _facets(mesh, surface)
    keep = np.ones(len(facets.area), dtype=bool)
    for face, axes in mirrors:
        nodes = face.nodes
        held = np.concatenate([np.isin(b.corners, nodes).all(axis=1) for b in surface.blocks])
        keep &= ~held | ((facets.normal[:, axes] ** 2).sum(axis=1) < 0.9)
    free = facets.picked(np.flatnonzero(keep))
    n = len(free.area)
    some = free.picked(np.arange(0, n, max(1, -(-n // _MOST))))
    thickness = np.full(len(some.area), np.inf)
    for i in range(len(thickness)):
        apart = some.centre[i] - free.centre
        depth = apart @ some.normal[i]
        aside = np.sqrt(np.maximum((apart**2).sum(axis=1) - depth**2, 0.0))
        behind = (free.normal @ some.normal[i] < _OPPOSED) & (depth > 0)
        behind &= aside <= _REACH * (some.longest[i] + free.longest)
        thickness[i] = depth[behind].min(initial=np.inf)
    length = np.where(np.char.startswith(some.kind, "tri"), some.mean, some.longest)
    return Walls(some.area, thickness, length, some.kind)


def _facets(mesh: Mesh, surface: FacetSet) -> _Facets:
    parts = []
    for block in surface.blocks:
        x = mesh.nodes[block.corners]
        n = x.shape[1]
        edges = np.linalg.norm(x[:, [*range(1, n), 0]] - x, axis=2)
        vector = 0.5 * np.cross(x[:, 2] - x[:, 0], x[:, n - 1] - x[:, 1])
        area = np.linalg.norm(vector, axis=1)
        normal = vector / np.where(area > 0, area, 1.0)[:, None]
        kinds = np.full(len(x), block.kind)
        parts.append((x.mean(axis=1), normal, area, edges.max(axis=1), edges.mean(axis=1), kinds))
    return _Facets(*(np.concatenate(column) for column in zip(*parts, strict=True)))
