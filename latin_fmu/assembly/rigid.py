"""Rigid substructures: at most six unknowns, no stiffness; held and driven directions are taken out of the six.

A condition on a face is a condition on the six rigid motions. The motions left free by all of them and one motion
per prescribed history are the unknowns of the body:

    u(nodes) = modes (Z q + D d(t)),   Z: what no condition sees,   D: what follows the prescribed histories d
"""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np
import scipy.linalg as la
import scipy.sparse as sp

from ..errors import Problem
from ..fem.elements import RigidBody, rigid_body
from ..fem.mesh import Array
from ..propagator import LoadTerm, SubstructureModel
from ..scene.boundaries import Boundary, Periodic
from .body import Body
from .conditions import Conditions, build_conditions

_ROUND_OFF = 1e-9


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
        shapes: Array = self.body.modes @ self.basis
        return shapes

    def values(self, translation: Array, rotation: Array, driven: Array) -> Array:
        """Unknowns (n_full,) closest, in kinetic energy, to a motion of the centre; ``driven`` (n_motion,) is known."""
        n_free = self.expansion.shape[1]
        free, rest = self.basis[:, :n_free], self.basis[:, n_free:]
        wanted = self.body.coordinates(translation, rotation) - rest @ driven
        mass = self.body.mass
        found = la.solve(free.T @ mass @ free, free.T @ mass @ wanted, assume_a="pos") if n_free else np.zeros(0)
        return np.concatenate([found, driven])


def conditions_on(body: Body, boundaries: dict[str, Boundary], problems: list[Problem]) -> Conditions:
    """Conditions of a body, elastic or rigid, from the boundaries on its faces."""
    held = build_conditions(body, boundaries, problems)
    return rigid_conditions(body, held, boundaries, problems) if body.rigid else held


def rigid_conditions(
    body: Body, held: Conditions, boundaries: dict[str, Boundary], problems: list[Problem]
) -> Conditions:
    """``held`` (conditions of the nodes) on the rigid motions of ``body``."""
    for name, boundary in boundaries.items():
        if isinstance(boundary, Periodic):
            problems.append(
                Problem(
                    f"boundary.{name}",
                    "a rigid body cannot be periodic",
                    body.name,
                    "an elastic substructure",
                    f"remove the boundary, or substructure.{body.name}.rigid",
                )
            )
            return held
    rigid = rigid_body(body.mesh, body.shape.material.density)
    driven = held.pattern.any(axis=1)
    blocked = (np.diff(held.expansion.indptr) == 0) & ~driven
    rows = np.concatenate([rigid.modes[blocked], rigid.modes[driven]])
    wanted = np.concatenate([np.zeros((int(blocked.sum()), len(held.motions))), held.pattern[driven]])
    motions = la.lstsq(rows, wanted)[0] if wanted.size else np.zeros((6, len(held.motions)))
    if wanted.size and np.abs(rows @ motions - wanted).max() > _ROUND_OFF:
        problems.append(
            Problem(
                f"substructure.{body.name}.rigid",
                "a rigid body cannot follow its boundary conditions",
                ", ".join(boundaries),
                "motions that a rigid body can make",
                "hold or drive it through faces that move together, or leave it elastic",
            )
        )
    free = _null_space(rows)
    basis = np.concatenate([free, motions], axis=1)
    n_free, n_full = free.shape[1], basis.shape[1]
    expansion = sp.csr_array(np.eye(n_full)[:, :n_free])
    nodal = rigid.modes @ basis
    dashpots = None if held.dashpots is None else sp.csr_array(nodal.T @ (held.dashpots @ nodal))
    return RigidConditions(expansion, np.eye(n_full)[:, n_free:], held.motions, dashpots, dashpots, rigid, basis)


def _null_space(rows: Array) -> Array:
    """Motions (6, n) that no row sees, as simple as they come: one unit entry each (reduced row echelon form)."""
    if not len(rows):
        return np.eye(6)
    reduced = la.qr(rows, mode="r")[0][:6].copy()
    pivots: list[int] = []
    row = 0
    for column in range(6):
        if row == len(reduced):
            break
        best = row + int(np.argmax(np.abs(reduced[row:, column])))
        if abs(reduced[best, column]) <= _ROUND_OFF:
            reduced[row:, column] = 0.0
            continue
        reduced[[row, best]] = reduced[[best, row]]
        reduced[row] /= reduced[row, column]
        others = np.arange(len(reduced)) != row
        reduced[others] -= np.outer(reduced[others, column], reduced[row])
        pivots.append(column)
        row += 1
    left = [c for c in range(6) if c not in pivots]
    space = np.eye(6)[:, left]
    space[pivots] = -reduced[: len(pivots), left]
    return np.where(np.abs(space) < _ROUND_OFF, 0.0, space)


def rigid_model(
    body: Body, held: RigidConditions, trace: sp.csr_array, area: Array, loads: list[LoadTerm]
) -> SubstructureModel:
    """Model of a rigid body from its trace and loads on the nodes; neither matrix of the mesh is assembled."""
    nodal, description = held.nodal, body.description
    mass = sp.csr_array(held.basis.T @ held.body.mass @ held.basis)
    n_full = mass.shape[0]
    share = body.shape.material.rayleigh_mass
    damping = sp.csr_array(share * mass) if share else None
    if held.dashpots is not None:
        damping = held.dashpots if damping is None else sp.csr_array(damping + held.dashpots)
    still, start = np.zeros(3), held.start()
    return SubstructureModel(
        name=body.name,
        mass=mass,
        damping=damping,
        stiffness=sp.csr_array((n_full, n_full)),
        expansion=held.expansion,
        trace=sp.csr_array(trace @ nodal),
        channel_area=area,
        loads=[replace(load, pattern=nodal.T @ load.pattern) for load in loads],
        displacement=held.values(np.asarray(description.initial_displacement), still, start),
        velocity=held.values(
            np.asarray(description.initial_velocity), np.asarray(description.initial_spin), np.zeros(len(start))
        ),
        imposed_pattern=held.pattern,
        imposed_start=start,
        nodal=nodal,
    )
