"""Checks of a scene against its meshes, and remarks on its loads, the size of its bodies and locking.

A linear element cannot curve. Bent over a wall of thickness t it holds parasitic shear, which makes the wall stiffer by
about

    c (l / t)^2,    l: edge of the element along the wall

c was measured on a cantilever of 20 x 2 x 1 elements and on finer ones: 0.55 for hexahedra (and wedges whose triangles
lie on the wall), 2.5 for tetrahedra (and wedges that stand on it). Thickness and edges are found facet by facet.
"""

from __future__ import annotations

import difflib
from collections import Counter
from collections.abc import Iterable, Iterator, Mapping
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from ..assembly.body import Body, body_sides
from ..errors import Problems
from ..fem.elements import BENDING_CELLS
from ..fem.mesh import Array, FacetSet, Mesh
from ..latin.assembly import InterfaceUnit
from ..remarks import Remark
from ..results.model import BodySize
from ..scene.attachments import places_of
from ..scene.boundaries import (
    AXES,
    Boundary,
    Driven,
    Fixed,
    Periodic,
    PrescribedAcceleration,
    PrescribedVelocity,
    Symmetry,
)
from ..scene.fields import ALL_OF_IT, GROUND, split_face
from ..scene.laws import HalfSineLaw, sampled_impulse_error
from ..scene.nodal_loads import NodalLoad
from ..scene.schema import Scene, faces_of

_SAMPLING = 1e-3  # relative error of a sampled impulse that is worth a remark
LARGEST, SMALLEST = 10.0, 1e-6
"""Sizes of the largest body, m, beyond which the unit of length is doubtful: a mesh in mm read as metres."""
LOCKING_POISSON = 0.45
HEXAHEDRON, TETRAHEDRON = 0.55, 2.5  # c of the module docstring
_SHARE = 0.05  # of the surface: less of it is no wall worth a remark
_LINEAR = ("hexahedron", "tetra", "wedge", "pyramid")
_MOST = 400  # facets that are examined: of a larger surface, evenly spaced ones
_OPPOSED = -0.5  # cosine between the normals of two sides of a wall
_ASIDE = 0.6  # largest distance of two opposite facets along the wall over the sum of their longest edges


def _faces_named(scene: Scene) -> Iterator[tuple[str, str]]:
    for name, interface in scene.interface.items():
        for i, side in enumerate(interface.sides):
            if side != GROUND:
                yield f"interface.{name}.sides[{i}]", side
    for name, boundary in scene.boundary.items():
        if isinstance(boundary, Periodic):
            yield from ((f"boundary.{name}.faces[{i}]", face) for i, face in enumerate(boundary.faces))
        else:
            yield f"boundary.{name}.face", boundary.face
    for name, load in scene.load.items():
        yield f"load.{name}.face", load.face
    for name, sensor in scene.sensor.items():
        if sensor.face is not None:
            yield f"sensor.{name}.face", sensor.face
    for name, port in scene.port.items():
        yield f"port.{name}.face", port.face
    for where, place in places_of(scene):
        if place.face is not None:
            yield f"{where}.face", place.face


def check_faces(scene: Scene, bodies: dict[str, Body], problems: Problems) -> None:
    """Every face named in the scene must exist on its mesh."""
    for where, side in _faces_named(scene):
        substructure, face = split_face(side)
        # a side without its body is a problem of the scene, and named there
        if substructure not in bodies:
            continue
        mesh = bodies[substructure].mesh
        faces = sorted(mesh.faces)
        if face in mesh.points and face not in faces:
            # they have no area for anything else
            if not _takes_points(scene, where):
                problems.add(
                    where,
                    "this node set is an edge or a point and has no area",
                    f"{side}, {len(mesh.points[face])} nodes",
                    ", ".join(faces) or None,
                    'an edge or point can be fixed, [boundary.NAME] type = "fixed", or take a nodal_force',
                )
            continue
        if face not in faces and face != ALL_OF_IT:
            close = difflib.get_close_matches(face, faces, 1)
            remedy = None
            if close:
                remedy = f"did you mean {substructure}.{close[0]!s}?"
            problems.add(
                where, "unknown face", side, ", ".join(faces) or "no named surface group touches this volume", remedy
            )


def _takes_points(scene: Scene, where: str) -> bool:
    """Whether what names a face takes an edge or a point: a support, a load on nodes, nodes that move as one."""
    table, name = where.split(".")[:2]
    if table == "boundary":
        return isinstance(scene.boundary[name], Fixed)
    if table == "coupling":
        return len(scene.coupling[name].ends) == 1
    return table == "load" and scene.load[name].kind is NodalLoad


def redundancy_remarks(scene: Scene) -> list[str]:
    """Interfaces that join the same two faces: their total force is unique, its distribution is not."""
    joined: dict[frozenset[str], str] = {}
    remarks = []
    for name, interface in scene.interface.items():
        first = joined.setdefault(frozenset(interface.sides), name)
        if first != name:
            remarks.append(
                f"interfaces {first} and {name} join the same faces: their total force is unique, "
                "but its distribution between them is not"
            )
    return remarks


def modal_damping_remarks(bodies: Mapping[str, Body], units: Iterable[InterfaceUnit]) -> list[str]:
    """Bodies with damping of their own modes that an interface joins to others or to the ground from the start.

    Their modes are those with free interfaces. A mode of the assembly moves them in part as a whole, which is not
    damped: of 2 % in both halves of a bar 0.8 % are left, of 3 % in three pressed blocks 0.2 %.
    """
    damped = {name for name, body in bodies.items() if body.description.modal_damping is not None}
    closed = [unit for unit in units if not unit.behaviour.opens or unit.geometry.gap.min(initial=np.inf) <= 0.0]
    joined = sorted(damped & {name for _, _, name in body_sides(closed)})
    if not joined:
        return []
    return [
        f"substructure {', '.join(joined)}: modal_damping applies to the modes of a body with free interfaces; a mode "
        "of the assembly has another, often smaller ratio, which latin-fmu modes prints; to set the ratio of the "
        "assembly, give damping_ratios of the material, or [damping] ratio"
    ]


def lumping_remarks(bodies: dict[str, Body]) -> list[str]:
    """Cells whose lumped masses do not suit the loads on their faces, in an explicit march.

    A smooth pulse that has run into an absorbing end leaves 7 % of its energy with 20 nodes, 9 % in wedges of 15, about
    1 % with linear cells and 10-node tetrahedra, 0.01 % with 27 nodes.
    """
    return [
        f"substructure {name}: {words} with explicit time integration: because of their lumped masses a force on a "
        f"face excites oscillations of single nodes; use {better} nodes, or an implicit scheme"
        for name, body in bodies.items()
        for kind, words, better in (
            ("hexahedron20", "20-node hexahedra", "8 or 27"),
            ("wedge15", "15-node wedges", "wedges of 6"),
        )
        if kind in body.mesh.cell_types and not body.rigid
    ]


def sampling_remarks(scene: Scene, time: Array) -> list[str]:
    """Laws whose impulse, sampled at the instants, differs from the exact one."""
    laws = [(f"load {n}" if n in scene.load else n, law) for n, law in scene.force_laws.items()]
    for name, boundary in scene.boundary.items():
        if isinstance(boundary, PrescribedVelocity | PrescribedAcceleration):
            laws.append((f"boundary {name}", boundary.law))
    for name, interface in scene.interface.items():
        if interface.ground_velocity is not None:
            laws.append((f"ground of interface {name}", interface.ground_velocity.law))
    remarks = []
    for where, law in laws:
        error = abs(sampled_impulse_error(law, time))
        if error > _SAMPLING:
            remedy = "(jumps within a step): place the jumps at ends of steps, or use smaller steps"
            if isinstance(law, HalfSineLaw):
                remedy = f"(a step of {float(time[1] - time[0]):.3g} s is too long for this law): use smaller steps"
            what = f"its time integral, sampled at the time steps, has an error of {100 * error:.2g} %"
            remarks.append(f"{where}: {what} {remedy}")
    return remarks


def _mass(body: Body) -> float:
    return float(body.rigid_motions.mass[0, 0])


def body_sizes(bodies: Mapping[str, Body]) -> dict[str, BodySize]:
    """Size, volume, mass, nodes and cells of each body."""
    sizes = {}
    for name, body in bodies.items():
        kinds: Counter[str] = Counter()
        for block in body.mesh.blocks:
            kinds[block.cell_type] += len(block.cells)
        extent = tuple(float(length) for length in body.mesh.extent())
        volume = float(body.shape.elements.volume.sum())
        sizes[name] = BodySize(extent, volume, _mass(body), body.mesh.n_node, dict(kinds))
    return sizes


def body_lines(bodies: Mapping[str, Body]) -> list[str]:
    """One line for each body: size of its bounding box, volume, mass, nodes and cells."""
    lines, found = [], body_sizes(bodies)
    for name, body in bodies.items():
        of, units = found[name], body.units
        size = " x ".join(f"{length:.4g}" for length in of.extent)
        # one component: all mass
        if body.added is None:
            added = 0.0
        else:
            added = float(body.added.matrix[::3, ::3].sum())
        if added:
            masses = f" ({added:.4g} {units['kg']} in point masses)"
        else:
            masses = ""
        sizes = f"{size} {units['m']}, {of.volume:.6g} {units['m3']}, {of.mass:.6g} {units['kg']}{masses}"
        lines.append(f"  body {name}: {sizes}, {of.nodes} nodes, {of.cell_types}")
    return lines


def size_remarks(bodies: Mapping[str, Body]) -> list[Remark]:
    """A remark where the largest body is larger than ``LARGEST`` or smaller than ``SMALLEST``."""
    name, body = max(bodies.items(), key=lambda item: item[1].mesh.size)
    size, units = body.mesh.size, body.units
    if SMALLEST <= size * units.size("m") <= LARGEST:
        return []
    message = f"the largest body, {name}, is {size:.4g} {units['m']} long and has a mass of {_mass(body):.4g} "
    message += units["kg"]
    if body.description.mesh is None:
        return [Remark("size", f"{message}: is its size in {units['m']}?")]
    scale = body.description.mesh.scale
    question = f"is scale = {scale:g} the length unit of its mesh file in {units['m']} (1e-3 for mm in a scene "
    question += "in m)?"
    return [Remark("size", f"{message}: {question}")]


def locking_remarks(scene: Scene, bodies: dict[str, Body]) -> list[str]:
    """Warnings where linear elements are known to be too stiff."""
    remarks = []
    for name, body in bodies.items():
        stiff = _stiff_types(body)
        if body.rigid or not stiff:
            continue
        nu = body.shape.elasticity.poisson_ratio
        if nu > LOCKING_POISSON:
            remarks.append(
                f"substructure {name}: Poisson's ratio {nu:g} > {LOCKING_POISSON}: linear elements lock (too stiff)"
            )
        boundaries = scene.boundaries_of(name).values()
        # walls of a periodic body end nowhere
        if any(isinstance(b, Periodic) for b in boundaries):
            continue
        if body.description.box is None:
            behind = _mesh_walls(body, boundaries)
        else:
            behind = _box_walls(body, boundaries)
        if (message := _bending_message(behind, stiff, body)) is not None:
            if "hexahedron" in stiff:
                remedy = f"set substructure.{name}.bending_modes"
            else:
                remedy = "use quadratic elements"
            remarks.append(f"substructure {name}: {message}; {remedy} (waves along the body are not affected)")
    return remarks


def _stiff_types(body: Body) -> set[str]:
    """Types of cells of the body that are too stiff in bending."""
    types = set(body.mesh.cell_types) & set(_LINEAR)
    if body.shape.bending_modes:
        return types - set(BENDING_CELLS)
    return types


def _bending_message(walls: Walls, stiff: set[str], body: Body) -> str | None:
    """Message on the walls of a body that are too stiff in bending, None where there are none: slender walls bend, and
    short ones where they are very coarse."""
    factors = _factors(stiff, set(body.mesh.cell_types))
    excess = np.array([factors.get(kind, 0.0) for kind in walls.kind.tolist()]) * (walls.length / walls.thickness) ** 2
    slender = body.mesh.size / walls.thickness
    coarse = (excess > np.where(slender > 10.0, 0.2, 0.6)) & (slender > 5.0)
    if walls.area[coarse].sum() <= _SHARE * walls.area.sum():
        return None
    thickness, times = walls.thickness[coarse], walls.length[coarse] / walls.thickness[coarse]
    return (
        f"linear elements {np.median(times):.2g} times as long as the wall thickness of "
        f"{np.median(thickness):.3g} {body.units['m']}: "
        f"the body is about {100 * float(np.median(excess[coarse])):.0f} % too stiff in bending"
    )


def _factors(stiff: set[str], types: set[str]) -> dict[str, float]:
    """c of the module docstring by kind of facet on the wall, in a mesh of these types of cells."""
    if "hexahedron" not in types:
        quad = TETRAHEDRON
    else:
        if "hexahedron" in stiff:
            quad = HEXAHEDRON
        else:
            quad = 0.0
    return {"quad": quad, "triangle": TETRAHEDRON if "tetra" in stiff else HEXAHEDRON}


def _mesh_walls(body: Body, boundaries: Iterable[Boundary]) -> Walls:
    # an edge or point is no wall
    named = [(split_face(faces_of(b)[0])[1], b) for b in boundaries]
    mirrors = [(body.facets(n), _held_axes(b)) for n, b in named if n == ALL_OF_IT or n in body.mesh.faces]
    return _walls(body.mesh, body.outside, mirrors)


def _box_walls(body: Body, boundaries: Iterable[Boundary]) -> Walls:
    """The thinnest direction in which the box may bend, without a search."""
    box = body.description.box
    assert box is not None
    size, elements = np.asarray(box.size), np.asarray(box.elements)
    free = np.ones(3, dtype=bool)
    for boundary in boundaries:
        face = split_face(faces_of(boundary)[0])[1]
        for axis in range(3) if face == ALL_OF_IT else ("xyz".index(face[0]),):
            free[axis] &= not _held_axes(boundary)[axis]
    if not free.any():
        return Walls(np.zeros(0), np.zeros(0), np.zeros(0), np.zeros(0, dtype=np.str_))
    thin = int(np.argmin(np.where(free, size, np.inf)))
    along = int(np.argmax(size))
    length = size[along] / elements[along]
    return Walls(np.ones(1), size[[thin]], np.array([length]), np.array(["quad"]))


def _held_axes(boundary: Boundary) -> NDArray[np.bool_]:
    """Axes along which the face moves as a whole, or not at all, (3,)."""
    if isinstance(boundary, Symmetry):
        return np.ones(3, dtype=bool)  # along the normal of the face, whichever axis that is
    if isinstance(boundary, Fixed | Driven):
        if boundary.axes is not None:
            return np.full(3, len(boundary.components) == len(AXES))
        return np.isin(AXES, boundary.components)
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


def _walls(mesh: Mesh, surface: FacetSet, mirrors: list[tuple[FacetSet, NDArray[np.bool_]]]) -> Walls:
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
        on_surface = np.concatenate([np.isin(b.corners, nodes).all(axis=1) for b in surface.blocks])
        # facets whose normal is along a held axis
        keep &= ~on_surface | ((facets.normal[:, axes] ** 2).sum(axis=1) < 0.9)
    free = facets.picked(np.flatnonzero(keep))
    n = len(free.area)
    some = free.picked(np.arange(0, n, max(1, -(-n // _MOST))))
    thickness = np.full(len(some.area), np.inf)
    for i in range(len(thickness)):
        apart = some.centre[i] - free.centre
        depth = apart @ some.normal[i]
        aside = np.sqrt(np.maximum((apart**2).sum(axis=1) - depth**2, 0.0))
        behind = (free.normal @ some.normal[i] < _OPPOSED) & (depth > 0)
        behind &= aside <= _ASIDE * (some.longest[i] + free.longest)
        thickness[i] = depth[behind].min(initial=np.inf)
    length = np.where(np.char.startswith(some.kind, "tri"), some.mean, some.longest)
    return Walls(some.area, thickness, length, some.kind)


def _facets(mesh: Mesh, surface: FacetSet) -> _Facets:
    parts = []
    for block in surface.blocks:
        x = mesh.nodes[block.corners]
        n = x.shape[1]
        edges = np.linalg.norm(x[:, [*range(1, n), 0]] - x, axis=2)
        # diagonals of a quadrilateral; of a triangle, n - 1 being 2, two edges
        vector = 0.5 * np.cross(x[:, 2] - x[:, 0], x[:, n - 1] - x[:, 1])
        area = np.linalg.norm(vector, axis=1)
        normal = vector / np.where(area > 0, area, 1.0)[:, None]
        kinds = np.full(len(x), block.kind)
        parts.append((x.mean(axis=1), normal, area, edges.max(axis=1), edges.mean(axis=1), kinds))
    return _Facets(*(np.concatenate(column) for column in zip(*parts, strict=True)))
