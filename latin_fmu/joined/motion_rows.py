"""Rows of the motion of all bodies, and what they read of a reduced assembly.

A row A of the motion u = E Q (P a + X r) + E R r + B d (``recovered_fields``) reads A u = (A E Q P) a + (...) r + (A B)
d: exact, one solution a row, whatever the motion does in time. Rows of outputs are means over faces, forces of springs
between sides, and the forces g on the bodies that give the resultants of bonds (``bond_forces``).
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import scipy.sparse as sp

from ..latin.assembly import Array
from ..latin.probes import Support
from .bond_forces import BondForces
from .reduced_run import ReducedMarch
from .tied_assembly import jump_rows, placed, spring_weights


def basis_of(march: ReducedMarch) -> Array:
    """P (n_free, m + n_load): rigid motions, modes as they are marched, static responses to loads."""
    reduced = march.reduced
    return np.hstack([reduced.rigid, reduced.elastic * reduced.marched.p, reduced.static_loads])


@dataclass(frozen=True)
class RowShares:
    """What rows A of the motion of all bodies read: A u = basis a + relative r + driven d.

    Attributes
    ----------
    basis : (k, m + n_load) of the amplitudes a of rigid motions, of modes beyond what loads make of them at rest, and
    of loads. relative : (k, n_r). driven : (k, n_motion).
    """

    basis: Array
    relative: Array
    driven: Array


def row_shares(march: ReducedMarch, rows: sp.csr_array) -> RowShares:
    """Of rows A (k, n_full). A K+ K_qr takes one solution per row, with the transpose of K+ K_qr."""
    reduced, tied = march.reduced, march.tied
    on_free = sp.csr_array(rows @ tied.expansion[:, : tied.n_free])
    static = reduced.solver.transposed(on_free) @ reduced.coupling
    basis = np.asarray(on_free @ basis_of(march))
    rest = basis[:, : reduced.n_mode] @ np.vstack([reduced.rigid_share, reduced.marched_gamma])
    relative = (rows @ tied.expansion[:, tied.n_free :]).toarray() - static - rest
    return RowShares(basis, relative, np.asarray(rows @ march.drives.shapes))


def mean_rows(march: ReducedMarch, i: int, side: int) -> sp.csr_array:
    """Mean motion (3, n_full) of a side of an interface that is no ground, weighted by area, global axes."""
    unit, tied = march.bodies.interfaces[i], march.tied
    trace, name = unit.geometry.traces[side], unit.sides[side].split(".")[0]
    assert trace is not None, "the ground has no motion that is a row"
    model = next(m for m in tied.models if m.name == name)
    motion = trace if model.nodal is None else sp.csr_array(trace @ model.nodal)
    share = unit.geometry.areas / unit.geometry.areas.sum()
    means = sp.csr_array(sp.kron(share[None], sp.eye_array(3)) @ motion)
    return placed(tied.where[name], tied.trace.shape[1], means)


def spring_rows(march: ReducedMarch, i: int) -> sp.csr_array:
    """Force (3, n_full) on side E of the springs of an interface, global axes, and its normal resultant in compression,
    (4, n_full), by the motion."""
    unit, tied = march.bodies.interfaces[i], march.tied
    forces = -sp.diags_array(spring_weights(unit)) @ jump_rows(march.bodies.layout, tied.trace, i)
    return sp.csr_array(_resultants(march, i) @ forces)


def _resultants(march: ReducedMarch, i: int) -> sp.csr_array:
    """Resultant force and, positive in compression, normal resultant (4, k) of forces on the channels of side E."""
    unit, layout = march.bodies.interfaces[i], march.bodies.layout
    size = layout.channels(i, 0).shape[1]
    frames = unit.geometry.frames[:, :size].reshape(-1, 3).T
    normal = np.zeros((len(unit.geometry.areas), size))
    normal[:, 0] = -1.0
    return sp.csr_array(np.vstack([frames, normal.ravel()]))


def bond_forces(march: ReducedMarch) -> BondForces:
    """What gives the tractions of the bonds, of which there are some."""
    tied = march.tied
    expansion = sp.csr_array(sp.block_diag([m.expansion for m in tied.models], format="csr"))
    return BondForces(tied.joints.bonded, march.bodies.layout, tied.trace, expansion)


def bond_rows(march: ReducedMarch) -> dict[int, sp.csr_array]:
    """Of each bond the rows (4, n_full) that give its resultant force on side E, global axes, and its normal resultant,
    positive in compression, by the forces g on the bodies."""
    bonded, layout = march.tied.joints.bonded, march.bodies.layout
    if not bonded:
        return {}
    weights = {}
    for k, i in enumerate(bonded):
        channels = layout.channels(i, 0).ravel()
        weights[i] = np.zeros((4 * len(bonded), channels.size))
        weights[i][4 * k : 4 * k + 4] = (_resultants(march, i) @ sp.diags_array(layout.area[channels])).toarray()
    rows = bond_forces(march).sums(weights)
    return {i: sp.csr_array(rows[4 * k : 4 * k + 4]) for k, i in enumerate(bonded)}


def carried_rows(march: ReducedMarch, support: Support) -> tuple[sp.csr_array, sp.csr_array]:
    """What bonds, and springs between sides, exert on the dofs that a support holds, where they share some: rows (3,
    n_full) by the forces g on the bodies, and rows (3, n_full) of the motion."""
    tied, layout, bodies = march.tied, march.bodies.layout, march.bodies
    number = next(c for c, p in enumerate(bodies.propagators) if support.substructure in p.names)
    member = bodies.propagators[number].names.index(support.substructure)
    weights = np.zeros((3, layout.n_flat))
    weights[:, bodies.channels[number][:, member]] = support.spread.T
    both = {
        i: weights[:, layout.channels(i, 0).ravel()] - weights[:, layout.channels(i, 1).ravel()]
        for i in (*tied.joints.bonded, *tied.joints.linear)
    }
    of_bonds = of_springs = sp.csr_array((3, tied.trace.shape[1]))
    if any(both[i].any() for i in tied.joints.bonded):
        of_bonds = bond_forces(march).sums({i: both[i] for i in tied.joints.bonded})
    for i in tied.joints.linear:
        per_area = spring_weights(march.bodies.interfaces[i]) / layout.area[layout.channels(i, 0).ravel()]
        rows = sp.csr_array(both[i] * per_area) @ jump_rows(layout, tied.trace, i)
        of_springs = sp.csr_array(of_springs - rows)
    return of_bonds, of_springs
