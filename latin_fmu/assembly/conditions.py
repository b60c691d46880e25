"""Boundary conditions of one body: held, driven and tied dofs, and absorbing dashpots.

A rigid substructure has at most six unknowns and no stiffness. A condition on a face is a condition on the six rigid
motions. The motions left free by all of them and one motion per prescribed history are the unknowns of the body:

    u(nodes) = modes (Z q + D d(t)),   Z: motions that no condition touches,   D: motions of the prescribed histories d
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, replace

import numpy as np
import scipy.linalg as la
import scipy.sparse as sp
from numpy.typing import NDArray

from ..errors import Problems
from ..fem.elements import RigidBody, rigid_modes
from ..fem.mesh import Array, Index, nearest
from ..propagator import LoadTerm, SubstructureModel
from ..scene.boundaries import AXES, Absorbing, Boundary, Driven, Fixed, Periodic, Symmetry
from ..scene.fields import split_face
from ..scene.ports import COMPONENTS, TRANSLATIONS, Port
from .body import Body
from .supports import (
    FLAT,
    HELD,
    NOTHING,
    Directions,
    PrescribedMotion,
    absorbing_dashpots,
    inclined_directions,
    port_dashpots,
    port_motions,
    port_shapes,
    with_directions,
)

_PAIRING = 1e-3  # periodic faces: lateral distance of a pair over the spacing of points
_ROUND_OFF = 1e-9


@dataclass(frozen=True)
class Conditions:
    """Kinematics and dashpots of a body.

    expansion : (n_full, n) selection matrix, but for rigid faces, whose nodes follow six columns. pattern : (n_full,
        n_motion). motions : what its columns follow.
    dashpots : (n_full, n_full) or None. lumped_dashpots : the same coupling the components of one node only.
    turned : conditions along directions that are no axes: directions (n_row, n_full), shares of the motions along them
        (n_row, n_motion), and the dofs of their nodes; None where there are none.
    """

    expansion: sp.csr_array
    pattern: Array
    motions: tuple[PrescribedMotion, ...]
    dashpots: sp.csr_array | None
    lumped_dashpots: sp.csr_array | None
    turned: tuple[sp.csr_array, Array, Index] | None = field(default=None, kw_only=True)

    @property
    def held(self) -> NDArray[np.bool_]:
        """(n_full,) dofs that never move."""
        never: NDArray[np.bool_] = (np.diff(self.expansion.indptr) == 0) & ~self.pattern.any(axis=1)
        return never

    @property
    def held_directions(self) -> Array:
        """Projectors (n_node, 3, 3) on the directions in which each node never moves, axes or not."""
        projectors: Array = self.held.reshape(-1, 3)[:, :, None] * np.eye(3)
        if self.turned is not None:
            for node in (self.turned[2][::3] // 3).tolist():
                rows = slice(3 * node, 3 * node + 3)
                block_rows = self.expansion[rows]
                # columns of other nodes are zero here
                block = np.hstack([block_rows[:, np.unique(block_rows.indices)].toarray(), self.pattern[rows]])
                if block.any():
                    free = la.orth(block, rcond=_ROUND_OFF)
                else:
                    free = np.zeros((3, 0))
                projectors[node] = np.eye(3) - free @ free.T
        return projectors

    def driving(
        self, time: Array, over_steps: bool = False, amplitudes: Mapping[str, Array] = NOTHING, end: float = np.inf
    ) -> Array:
        """What drives the prescribed motions, (n_time, n_motion), see ``PrescribedMotion.driving``."""
        columns = [m.driving(time, over_steps, amplitudes, end) for m in self.motions]
        if columns:
            return np.stack(columns, axis=1)
        return np.zeros((len(time), 0))

    def with_laws_of(self, boundaries: Mapping[str, Boundary]) -> Conditions:
        """The same with the laws of boundaries that differ in nothing else."""
        laws = {f"boundary.{name}": b.law for name, b in boundaries.items() if isinstance(b, Driven)}
        return replace(self, motions=tuple(replace(m, law=laws.get(m.source, m.law)) for m in self.motions))

    @property
    def motion_kinds(self) -> tuple[str, ...]:
        """Kind of each prescribed motion."""
        return tuple(m.kind for m in self.motions)

    def start(self) -> Array:
        """Displacements of the prescribed motions at t = 0, (n_motion,), m."""
        return np.array([m.start() for m in self.motions])

    def speeds(self) -> Array:
        """Velocities of the accelerated motions at t = 0, (n_motion,), m s-1, 0 of the others."""
        return np.array([m.speed for m in self.motions], dtype=float)


class _Dofs:
    """Held, driven and tied dofs while the conditions of a body are read."""

    def __init__(self, n_full: int) -> None:
        self.held = np.zeros(n_full, dtype=bool)
        self.driver = np.full(n_full, -1)
        self.motions: list[PrescribedMotion] = []
        self.tied: list[tuple[Index, Index]] = []
        self.turned = Directions()
        self.moved: list[tuple[Index, Array, int]] = []  # dofs of a face, shapes, first motion

    def roots(self) -> Index:
        """First of the dofs that each dof is tied to, itself where there are none, (n_full,)."""
        n = len(self.held)
        if not self.tied:
            return np.arange(n)
        from scipy.sparse.csgraph import connected_components  # few scenes have periodic faces

        ends = tuple(np.concatenate(side) for side in zip(*self.tied, strict=True))
        graph = sp.coo_array((np.ones(len(ends[0])), ends), shape=(n, n))
        _, label = connected_components(graph, directed=False)
        # label numbers components, and the first dof of each stands for it
        first: Index = np.unique(label, return_index=True)[1][label]
        return first

    def with_tied(self, some: Index) -> Index:
        """The dofs and all that are tied to them."""
        roots = self.roots()
        return np.flatnonzero(np.isin(roots, roots[some]))


def _nodal_conditions(
    body: Body, boundaries: dict[str, Boundary], problems: Problems, ports: Mapping[str, Port], explicit: bool
) -> Conditions:
    """Conditions on ``body`` from the boundaries and ports that name one of its faces."""
    dofs = _Dofs(body.full_size())
    dashpots: list[tuple[sp.csr_array, sp.csr_array]] = []
    # motions last: what they drive must be neither held nor driven already, whatever the order in the scene
    for name, boundary in sorted(boundaries.items(), key=lambda item: isinstance(item[1], Driven)):
        if isinstance(boundary, Periodic):
            _tie(body, name, boundary, dofs, problems)
            continue
        face = split_face(boundary.face)[1]
        # a support holds edges and points, too; everything else needs facets
        if isinstance(boundary, Fixed):
            nodes = body.nodes_of(face)
        else:
            nodes = body.face(face).nodes
        inclined = None
        if not _along_axes(boundary, body):
            inclined = inclined_directions(body, boundary)
        if inclined is not None:
            _incline(name, boundary, nodes, inclined, body.description.initial_velocity, dofs)
        elif isinstance(boundary, Fixed):
            for component in boundary.components:
                dofs.held[3 * nodes + AXES.index(component)] = True
        elif isinstance(boundary, Symmetry):
            axis = _normal_axis(body, name, boundary, problems)
            if axis is not None:
                dofs.held[3 * nodes + axis] = True
        elif isinstance(boundary, Absorbing):
            dashpots.append(absorbing_dashpots(body, split_face(boundary.face)[1]))
        else:
            _drive(body, name, boundary, nodes, dofs, problems)
    for name, port in ports.items():
        if port.causality == "wave":
            # one matrix for both: that of explicit schemes is diagonal
            dashpots.append((port_dashpots(body, name, port, explicit, problems),) * 2)
        elif port.causality == "motion_in":
            _move(body, name, port, dofs, problems)
    return _turned(_finish(dofs, dashpots), dofs, problems)


def _along_axes(boundary: Boundary, body: Body) -> bool:
    """Whether a condition on a face has the directions of the global axes."""
    if isinstance(boundary, Symmetry):
        face = body.face(split_face(boundary.face)[1])
        along = np.abs(face.normals[:, int(np.argmax(np.abs(face.normals[0])))])
        return bool(np.abs(along - 1).max() <= FLAT)
    return not isinstance(boundary, Fixed | Driven) or boundary.axes is None


def _speed(boundary: Driven, velocity: float) -> float:
    """Velocity with which a face driven by an acceleration starts: that of its body along the motion, m s-1."""
    if boundary.type == "acceleration":
        return velocity
    return 0.0


def _incline(
    name: str, boundary: Boundary, nodes: Index, directions: Array, velocity: Sequence[float], dofs: _Dofs
) -> None:
    numbers = [HELD] * len(directions)
    if isinstance(boundary, Driven):
        first = len(dofs.motions)
        numbers = list(range(first, first + len(directions)))
        source, speeds = f"boundary.{name}", directions @ velocity
        dofs.motions += [
            PrescribedMotion(boundary.law, v, boundary.type, source, speed=_speed(boundary, s))
            for v, s in zip(boundary.value, speeds.tolist(), strict=True)
        ]
    dofs.turned.add(nodes, directions, numbers, name)


def _turned(plain: Conditions, dofs: _Dofs, problems: Problems) -> Conditions:
    """Conditions along axes, with those along other directions and whatever holds or drives the same nodes."""
    if not dofs.turned.rows:
        return plain
    tied = np.concatenate([np.zeros(0, dtype=np.int64), *(side for pair in dofs.tied for side in pair)])
    dofs.turned.add_axes(dofs.held, dofs.driver)
    solved = dofs.turned.solved(len(dofs.motions), tied // 3, problems)
    if not solved:
        return plain
    expansion, pattern = with_directions(plain.expansion, plain.pattern, solved)
    rows, values = dofs.turned.matrices(len(dofs.held), len(dofs.motions))
    where = (3 * np.fromiter(solved, dtype=np.int64)[:, None] + np.arange(3)).ravel()
    return replace(plain, expansion=expansion, pattern=pattern, turned=(rows, values, where))


def _normal_axis(body: Body, name: str, boundary: Symmetry, problems: Problems) -> int | None:
    normals = body.face(split_face(boundary.face)[1]).normals
    axis = int(np.argmax(np.abs(normals[0])))
    if np.abs(np.abs(normals[:, axis]) - 1).max() > FLAT:
        problems.add(
            f"boundary.{name}.face",
            "a symmetry face must be plane",
            boundary.face,
            "a face whose normals are all the same",
            'use type = "fixed" with components, and axes where they are not the global ones',
        )
        return None
    return axis


def _drive(body: Body, name: str, boundary: Driven, nodes: Index, dofs: _Dofs, problems: Problems) -> None:
    for component, value in zip(boundary.components, boundary.value, strict=True):
        moved = dofs.with_tied(3 * nodes + AXES.index(component))
        coasts = boundary.type == "acceleration" and body.initial_velocity().any()
        if value == 0.0 and not coasts:  # at rest, as held nodes are and those driven by zero: a common edge agrees
            still = np.array([*(motion.value == 0.0 for motion in dofs.motions), False])  # driver -1 reads the last one
            moved = moved[~dofs.held[moved] & ~still[dofs.driver[moved]]]
        if (dofs.driver[moved] >= 0).any() or dofs.held[moved].any():
            problems.add(
                f"boundary.{name}",
                "drives nodes that another condition already fixes or drives",
                boundary.face,
                remedy="shared edges belong to one condition: omit the component in one of them",
            )
            continue
        dofs.driver[moved] = len(dofs.motions)
        source = f"boundary.{name}"
        speed = _speed(boundary, body.description.initial_velocity[AXES.index(component)])
        dofs.motions.append(PrescribedMotion(boundary.law, value, boundary.type, source, speed=speed))


def _move(body: Body, name: str, port: Port, dofs: _Dofs, problems: Problems) -> None:
    """Drive a face as a rigid body by the velocities of a port."""
    driven, shapes = port_shapes(body, name, port, problems)
    # a rigid motion of the face cannot be combined with other conditions on its nodes
    tied = len(dofs.with_tied(driven)) > len(driven) or not dofs.turned.rows.keys().isdisjoint((driven // 3).tolist())
    if tied or (dofs.driver[driven] >= 0).any() or dofs.held[driven].any():
        problems.add(
            f"port.{name}",
            "moves nodes already held, driven, tied or turned by a boundary or another port",
            port.face,
            remedy="let the face share no node with those of other conditions along the same component",
        )
        return
    first = len(dofs.motions)
    dofs.driver[driven] = first
    dofs.moved.append((driven, shapes, first))
    dofs.motions += port_motions(body, name, port)


def _tie(body: Body, name: str, boundary: Periodic, dofs: _Dofs, problems: Problems) -> None:
    first, second = (body.face(split_face(f)[1]) for f in boundary.faces)
    shift = body.mesh.nodes[second.nodes].mean(axis=0) - body.mesh.nodes[first.nodes].mean(axis=0)
    spacing = np.sqrt(np.median(first.areas))  # length of a facet
    if len(first.nodes) == len(second.nodes):
        distance, partner = nearest(body.mesh.nodes[first.nodes] + shift, body.mesh.nodes[second.nodes])
        # one to one: each node has a partner, and no two the same
        if distance.max() <= _PAIRING * spacing and len(np.unique(partner)) == len(partner):
            for component in range(3):
                dofs.tied.append((3 * first.nodes + component, 3 * second.nodes[partner] + component))
            return
    problems.add(
        f"boundary.{name}.faces",
        "the nodes of periodic faces must match one to one",
        f"{len(first.nodes)} and {len(second.nodes)} nodes",
        remedy="mesh opposite faces alike",
    )


def _finish(dofs: _Dofs, dashpots: list[tuple[sp.csr_array, sp.csr_array]]) -> Conditions:
    n_full = len(dofs.held)
    root = dofs.roots()
    fixed = np.zeros(n_full, dtype=bool)
    # what holds or drives one dof does so for all that are tied to it
    np.logical_or.at(fixed, root, dofs.held)
    driver = np.full(n_full, -1)
    np.maximum.at(driver, root, dofs.driver)
    fixed, driver = fixed[root], driver[root]
    free = ~fixed & (driver < 0)
    roots, columns = np.unique(root[free], return_inverse=True)
    rows = np.flatnonzero(free)
    expansion = sp.coo_array((np.ones(len(rows)), (rows, columns)), shape=(n_full, len(roots))).tocsr()
    pattern = np.zeros((n_full, len(dofs.motions)))
    driven = np.flatnonzero((driver >= 0) & ~fixed)
    pattern[driven, driver[driven]] = 1.0
    for moved, shapes, first in dofs.moved:
        # the column of the first motion has the ones of ``driver``: shapes take their place
        pattern[moved] = 0.0
        pattern[moved, first : first + shapes.shape[1]] = shapes
    consistent, lumped = (total(*(pair[i] for pair in dashpots)) for i in (0, 1))
    return Conditions(expansion, pattern, tuple(dofs.motions), consistent, lumped)


def total(*matrices: sp.csr_array | None) -> sp.csr_array | None:
    """Sum of the matrices that are given, None where there are none."""
    terms = [m for m in matrices if m is not None]
    if terms:
        return sp.csr_array(sum(terms[1:], terms[0]))
    return None


@dataclass(frozen=True)
class RigidConditions(Conditions):
    """Conditions of a rigid body on its own unknowns: the free motions, then the prescribed ones.

    body : its motions and mass. basis : (6, n_full) the unknowns as rigid motions; ``expansion``, ``pattern`` and
    ``dashpots`` are those of ``Conditions`` on these n_full unknowns.
    """

    body: RigidBody
    basis: Array

    @property
    def nodal(self) -> Array:
        """Displacements of the nodes (3 n_node, n_full) for unit values of the unknowns."""
        return np.asarray(self.body.modes @ self.basis)

    def values(self, translation: Array, rotation: Array, driven: Array) -> Array:
        """Unknowns (n_full,) closest, in kinetic energy, to a motion of the centre; ``driven`` (n_motion,) is known."""
        n_free = self.basis.shape[1] - len(self.motions)
        free, rest = self.basis[:, :n_free], self.basis[:, n_free:]
        motion, mass = self.body.coordinates(translation, rotation) - rest @ driven, self.body.mass
        if not n_free:
            return np.concatenate([np.zeros(0), driven])
        # closest in the mass of the body
        free_values = la.solve(free.T @ mass @ free, free.T @ mass @ motion, assume_a="pos")
        return np.concatenate([free_values, driven])


def conditions_on(
    body: Body, boundaries: dict[str, Boundary], problems: Problems, ports: Mapping[str, Port], explicit: bool = False
) -> Conditions:
    """Conditions of a body, elastic or rigid, from the boundaries and ports on its faces; ``explicit``: for central
    differences."""
    nodal = _nodal_conditions(body, boundaries, problems, ports, explicit)
    if body.rigid:
        return _rigid_conditions(body, nodal, boundaries, problems)
    if body.rigid_faces:
        return _with_rigid_faces(body, nodal, problems)
    return nodal


def _with_rigid_faces(body: Body, nodal: Conditions, problems: Problems) -> Conditions:
    """The conditions with the nodes of each rigid face on the rigid motions that their held directions leave, along the
    axes of its components."""
    expansion = nodal.expansion
    # dofs that stand for several ones: periodic faces
    copies = np.bincount(expansion.indices, minlength=expansion.shape[1])
    taken = np.zeros(body.full_size(), dtype=bool)
    blocks = []
    for rigid in body.rigid_faces:
        nodes = body.nodes_of(rigid.face)
        axes = [i for i, axis in enumerate(TRANSLATIONS) if axis in rigid.components]
        dofs = (3 * nodes[:, None] + np.array(axes)).ravel()
        rows = sp.csr_array(expansion[dofs])
        inclined = nodal.turned is not None and bool(np.isin(dofs, nodal.turned[2]).any())
        if taken[dofs].any() or nodal.pattern[dofs].any() or (copies[rows.indices] > 1).any() or inclined:
            what = "a rigid face shares nodes with another rigid face, a driven face, an inclined or a periodic one"
            remedy = "omit rigid for this face: a distributing coupling may share nodes"
            problems.add("coupling", what, f"{body.name}.{rigid.face}", remedy=remedy)
            continue
        taken[dofs] = True
        places = body.mesh.nodes[nodes]
        centre = places.mean(axis=0)
        # translations and rotations, these divided by the size: entries of order one; a point alone has none
        size = float(np.abs(places - centre).max()) or 1.0
        chosen = [i for i, component in enumerate(COMPONENTS) if component in rigid.components]
        modes = rigid_modes(places, centre, size).reshape(len(nodes), 3, 6)[:, axes][:, :, chosen]
        modes = modes.reshape(len(dofs), len(chosen))
        columns = _independent(modes @ _null_space(modes[np.diff(rows.indptr) == 0]))  # rows without entry: held
        columns[np.abs(columns) < _ROUND_OFF] = 0.0
        wide = sp.coo_array(columns)
        shape = (body.full_size(), columns.shape[1])
        blocks.append(sp.coo_array((wide.data, (dofs[wide.coords[0]], wide.coords[1])), shape=shape))
    free = np.ones(expansion.shape[1], dtype=bool)
    free[expansion[taken].indices] = False
    whole = sp.csr_array(sp.hstack([expansion[:, np.flatnonzero(free)], *blocks]))
    return replace(nodal, expansion=whole)


def _rigid_conditions(body: Body, nodal: Conditions, boundaries: dict[str, Boundary], problems: Problems) -> Conditions:
    """Conditions of the nodes, ``nodal``, on the rigid motions of ``body``."""
    for name, boundary in boundaries.items():
        if isinstance(boundary, Periodic):
            problems.add(
                f"boundary.{name}",
                "a rigid body cannot be periodic",
                body.name,
                "an elastic substructure",
                f"remove the boundary, or substructure.{body.name}.rigid",
            )
            return nodal
    rigid = body.rigid_motions
    fixed, driven = nodal.held, np.asarray(nodal.pattern.any(axis=1))
    if nodal.turned is not None:
        # turned nodes have rows of their own below, their axes among them
        for flags in (fixed, driven):
            flags[nodal.turned[2]] = False
    rows = np.concatenate([rigid.modes[fixed], rigid.modes[driven]])
    values = np.concatenate([np.zeros((int(fixed.sum()), len(nodal.motions))), nodal.pattern[driven]])
    if nodal.turned is not None:
        rows = np.concatenate([rows, nodal.turned[0] @ rigid.modes])
        values = np.concatenate([values, nodal.turned[1]])
    # least squares, as faces hold more dofs than a body has; what is left over is what a rigid body cannot do
    if values.size:
        motions = la.lstsq(rows, values)[0]
    else:
        motions = np.zeros((6, len(nodal.motions)))
    if values.size and np.abs(rows @ motions - values).max() > _ROUND_OFF:
        problems.add(
            f"substructure.{body.name}.rigid",
            "the boundary conditions are incompatible with a rigid body",
            ", ".join(boundaries),
            "rigid body motions",
            "fix or drive it through faces that move together, or make it elastic",
        )
    free = _null_space(rows)
    basis = np.concatenate([free, motions], axis=1)
    n_free, n_full = free.shape[1], basis.shape[1]
    # free motions first, then the driven ones
    expansion = sp.csr_array(np.eye(n_full)[:, :n_free])
    shapes = rigid.modes @ basis
    dashpots = None
    if nodal.dashpots is not None:
        dashpots = sp.csr_array(shapes.T @ (nodal.dashpots @ shapes))
    return RigidConditions(expansion, np.eye(n_full)[:, n_free:], nodal.motions, dashpots, dashpots, rigid, basis)


def _independent(columns: Array) -> Array:
    """The columns without those that the others make up: rotations about the line that all nodes of an edge lie on, or
    that move nothing along the axes that count."""
    if not columns.size:
        return columns
    factor, pivots = la.qr(columns, mode="r", pivoting=True)
    sizes = np.abs(np.diag(factor))
    rank = int((sizes > _ROUND_OFF * max(float(sizes.max()), 1e-300)).sum())
    return np.asarray(columns[:, np.sort(pivots[:rank])])


def _null_space(rows: Array) -> Array:
    """Null space (m, n) of the rows (k, m) by reduced row echelon form: each motion has one unit entry."""
    count = rows.shape[1]
    if not len(rows):
        return np.eye(count)
    reduced = la.qr(rows, mode="r")[0][:count].copy()  # as many rows at most, of the same null space
    pivots: list[int] = []
    row = 0
    for column in range(count):
        if row == len(reduced):
            break
        best = row + int(np.argmax(np.abs(reduced[row:, column])))
        if abs(reduced[best, column]) <= _ROUND_OFF:
            reduced[row:, column] = 0.0
            continue
        reduced[[row, best]] = reduced[[best, row]]
        reduced[row] /= reduced[row, column]
        # above and below: reduced, so that each free motion has one unit entry
        others = np.arange(len(reduced)) != row
        reduced[others] -= np.outer(reduced[others, column], reduced[row])
        pivots.append(column)
        row += 1
    free = [c for c in range(count) if c not in pivots]
    space = np.eye(count)[:, free]
    space[pivots] = -reduced[: len(pivots), free]
    return np.where(np.abs(space) < _ROUND_OFF, 0.0, space)


def rigid_model(
    body: Body, conditions: RigidConditions, trace: sp.csr_array, area: Array, loads: list[LoadTerm]
) -> SubstructureModel:
    """Model of a rigid body from its trace and loads on the nodes; neither matrix of the mesh is assembled."""
    nodal, description = conditions.nodal, body.description
    mass = sp.csr_array(conditions.basis.T @ conditions.body.mass @ conditions.basis)
    n_full = mass.shape[0]
    # of Rayleigh damping the part of the mass alone: nothing is strained
    share = body.shape.material.drag
    still, start = np.zeros(3), conditions.start()
    drag = None
    if share:
        drag = sp.csr_array(share * mass)
    return SubstructureModel(
        name=body.name,
        mass=mass,
        damping=total(drag, conditions.dashpots),
        # no strain in a rigid motion
        stiffness=sp.csr_array((n_full, n_full)),
        expansion=conditions.expansion,
        trace=sp.csr_array(trace @ nodal),
        channel_area=area,
        loads=[replace(load, pattern=nodal.T @ load.pattern) for load in loads],
        displacement=conditions.values(np.asarray(description.initial_displacement), still, start),
        velocity=conditions.values(
            np.asarray(description.initial_velocity), np.asarray(description.initial_spin), np.zeros(len(start))
        ),
        imposed_pattern=conditions.pattern,
        imposed_start=start,
        imposed_speed=conditions.speeds(),
        nodal=nodal,
    )
