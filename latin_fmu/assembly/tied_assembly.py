"""An assembly tied at all its interfaces: motions of the bodies by free dofs q and relative motions r of the contacts.

A perfect interface keeps the sides together; one that may open moves its sides by r = T_E u_E - T_E' u_E' relative to
each other (displacement of E over that of E', local frames). Both are rows J u = W r of the reduced dofs x of all
bodies, each of which determines one dof by the others. Springs and dashpots between sides are part of the matrices. So

    u = E (Q q + R r) + D d,        J E Q = 0,   J E R = W,   J D = 0

with the expansion E and the driven shapes D d of the bodies. Rows of closed loops depend on each other: those that the
others imply are left out.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Final, NamedTuple

import numpy as np
import scipy.linalg as la
import scipy.sparse as sp
from scipy.sparse.csgraph import connected_components

from ..fem.dissection import dissected
from ..interface.laws import bonds
from ..latin.assembly import Array, Index, InterfaceUnit, Layout
from ..laws.maxwell_joint import MaxwellJoint
from ..propagator import SubstructureModel
from .body import consecutive
from .models import ModelClass

_NOTHING: Final = 1e-9  # entries below this share of 1 are round-off
_LARGEST: Final = 1e3  # an entry of an inverse above it: rows that are nearly dependent


class TieError(ValueError):
    """Interfaces that cannot be written by free dofs and relative motions; says which."""


class Joints(NamedTuple):
    """Interfaces by what they are in a tied assembly: numbers of those that join their sides, of springs and dashpots
    between them, and of those with relative motions."""

    bonded: tuple[int, ...]
    linear: tuple[int, ...]
    relative: tuple[int, ...]

    @staticmethod
    def of(units: Sequence[InterfaceUnit]) -> Joints:
        """Of the interfaces of an assembly.

        Raises
        ------
        TieError : springs that relax.
        """
        bonded, linear, relative = list[int](), list[int](), list[int]()
        for i, unit in enumerate(units):
            if isinstance(unit.behaviour, MaxwellJoint):
                raise TieError(f"interface {unit.name} has springs that relax")
            kind = bonded if bonds(unit.behaviour) else relative if unit.behaviour.opens else linear
            kind.append(i)
        return Joints(tuple(bonded), tuple(linear), tuple(relative))


class Elimination(NamedTuple):
    """x = q_part q + r_part r + driven d, and the numbers of the dofs x that the q are."""

    q_part: sp.csr_array
    r_part: sp.csr_array
    driven: Array
    free: Index


def eliminated(rows: sp.csr_array, moved: Array, weights: sp.csr_array) -> Elimination:
    """Solve rows x + moved d = weights r for one dof per row.

    Parameters
    ----------
    rows : (k, n). moved : (k, n_motion). weights : (k, n_r).

    Raises
    ------
    TieError : rows that depend on each other and leave relative motions or driven ones no choice.
    """
    n = rows.shape[1]
    q_part, r_part = sp.csr_array(sp.eye_array(n)), sp.csr_array((n, weights.shape[1]))
    driven, free = np.zeros((n, moved.shape[1])), np.arange(n, dtype=np.int64)
    left = _without_round_off(rows)
    while left.shape[0]:
        filled = np.diff(left.indptr) > 0
        _check_implied(moved[~filled], sp.csr_array(weights[np.flatnonzero(~filled)]))
        kept = np.flatnonzero(filled)
        left, moved, weights = sp.csr_array(left[kept]), moved[kept], sp.csr_array(weights[kept])
        if not len(kept):
            break
        own, chosen = _pivots(left)
        first = sp.csr_array(left[own])
        inverse = _block_inverse(sp.csr_array(first[:, chosen]))
        others = np.setdiff1d(np.arange(left.shape[1]), chosen)
        # dofs of this round by those that are left, r and d
        by_q = _without_round_off(-inverse @ first[:, others])
        by_r, by_d = sp.csr_array(inverse @ weights[own]), -(inverse @ moved[own])
        of_chosen = sp.csr_array(q_part[:, chosen])
        q_part = sp.csr_array(q_part[:, others] + of_chosen @ by_q)
        r_part, driven = sp.csr_array(r_part + of_chosen @ by_r), driven + of_chosen @ by_d
        free = free[others]
        # rows that found no dof of their own, in terms of what is left
        rest = np.setdiff1d(np.arange(left.shape[0]), own)
        of_rest = sp.csr_array(left[rest])
        on_chosen = sp.csr_array(of_rest[:, chosen])
        moved = moved[rest] + on_chosen @ by_d
        weights = _without_round_off(weights[rest] - on_chosen @ by_r)
        left = _without_round_off(of_rest[:, others] + on_chosen @ by_q)
    return Elimination(q_part, r_part, driven, free)


def _check_implied(moved: Array, weights: sp.csr_array) -> None:
    """Rows that the others imply must leave nothing to r and d."""
    if np.abs(moved).max(initial=0.0) > _NOTHING or np.abs(weights.data).max(initial=0.0) > _NOTHING:
        raise TieError("interfaces that hold the same nodes twice, or faces that are held or driven on both sides")


def _without_round_off(matrix: sp.csr_array) -> sp.csr_array:
    """The matrix without entries that are round-off of 1."""
    matrix = sp.csr_array(matrix)
    matrix.data[np.abs(matrix.data) < _NOTHING] = 0.0
    matrix.eliminate_zeros()
    matrix.sort_indices()
    return matrix


def _pivots(rows: sp.csr_array) -> tuple[Index, Index]:
    """Rows that find a dof of their own, and these dofs: of each row its largest entry that no row before has taken,
    positive ones (the owner's side) before others. Rows with one entry choose first."""
    taken = np.zeros(rows.shape[1], dtype=bool)
    own, chosen = list[int](), list[int]()
    for i in np.argsort(np.minimum(np.diff(rows.indptr), 3), kind="stable").tolist():
        part = slice(rows.indptr[i], rows.indptr[i + 1])
        columns, data = rows.indices[part], rows.data[part]
        usable = ~taken[columns]
        if not usable.any():
            continue
        size = np.where(usable, np.abs(data), 0.0)
        # of entries of nearly the same size the positive one
        best = int(np.argmax(size * (1.0 + _NOTHING * (data > 0.0))))
        if size[best] < 0.1 * np.abs(data).max():
            continue
        taken[columns[best]] = True
        own.append(i)
        chosen.append(int(columns[best]))
    if not own:
        raise TieError("interfaces that hold the same nodes twice")
    return np.array(own, dtype=np.int64), np.array(chosen, dtype=np.int64)


def _block_inverse(matrix: sp.csr_array) -> sp.csr_array:
    """Inverse of a matrix that is a permutation of small blocks.

    Raises
    ------
    TieError : a block that is next to singular.
    """
    n = matrix.shape[0]
    coo = matrix.tocoo()
    graph = sp.coo_array((np.ones(coo.nnz), (coo.coords[0], n + coo.coords[1])), shape=(2 * n, 2 * n))
    count, label = connected_components(graph, directed=False)
    order = np.argsort(label[:n], kind="stable")
    columns = np.argsort(label[n:], kind="stable")
    ends = np.cumsum(np.bincount(label[:n], minlength=count))
    rows_at, columns_at, values = list[Index](), list[Index](), list[Array]()
    first = 0
    for end in ends.tolist():
        r, c = order[first:end], columns[first:end]
        first = end
        block = matrix[r][:, c].toarray()
        try:
            inverse = la.inv(block, check_finite=False)
        except la.LinAlgError:
            raise TieError("interfaces that hold the same nodes twice") from None
        if not np.abs(inverse).max(initial=0.0) < _LARGEST:
            raise TieError("interfaces that hold the same nodes twice")
        rows_at.append(np.repeat(c, len(r)))
        columns_at.append(np.tile(r, len(c)))
        values.append(inverse.ravel())
    data = np.concatenate([np.zeros(0), *values])
    none = np.zeros(0, dtype=np.int64)
    places = np.concatenate([none, *rows_at]), np.concatenate([none, *columns_at])
    return sp.csr_array(sp.coo_array((data, places), shape=(n, n)))


@dataclass(frozen=True)
class TiedAssembly:
    """Matrices of an assembly tied at all interfaces (module docstring).

    Attributes
    ----------
    models : of the bodies. where : slices of their full dofs. joints : the interfaces. trace : (n_flat, n_full) from
    the full dofs of all bodies to the channels. expansion : [E Q, E R] (n_full, n). n_free : number of q. driven : D
    (n_full, n_motion). full : stiffness, mass and damping (n_full, n_full) with the springs and dashpots of interfaces.
    stiffness, mass, damping : (n, n) on [q, r], N m-1, kg, N s m-1. channels : (n_r,) channel of side E of each r.
    free : (n_free,) numbers of q among the reduced dofs of all bodies. rank : (n,) elimination order of [q, r], nested
    dissection; None where a body has no places.
    """

    models: list[SubstructureModel]
    where: Mapping[str, slice]
    joints: Joints
    trace: sp.csr_array
    expansion: sp.csr_array
    n_free: int
    driven: Array
    full: tuple[sp.csr_array, sp.csr_array, sp.csr_array]
    stiffness: sp.csr_array
    mass: sp.csr_array
    damping: sp.csr_array
    channels: Index
    free: Index
    rank: Array | None
    jump: sp.csr_array
    """(n_r, n_full) relative motions from the full dofs of all bodies."""

    @staticmethod
    def of(classes: Sequence[ModelClass], units: Sequence[InterfaceUnit], layout: Layout) -> TiedAssembly:
        """The assembly of classes of bodies and interfaces.

        Raises
        ------
        TieError : interfaces that leave relative motions no choice.
        """
        models, joints = [m for c in classes for m in c.members], Joints.of(units)
        where, n_full = consecutive({m.name: m.n_full for m in models})
        trace = _trace(classes, layout, where, n_full)
        expansion = sp.csr_array(sp.block_diag([m.expansion for m in models], format="csr"))
        driven: Array = sp.block_diag([sp.coo_array(m.imposed_pattern) for m in models]).toarray()
        rows, weights, channels = _rows(units, layout, trace, joints)
        made = eliminated(_without_round_off(rows @ expansion), np.asarray(rows @ driven), weights)
        both = sp.csr_array(expansion @ sp.hstack([made.q_part, made.r_part]))
        springs, dashpots = _joint_matrices(units, layout, trace, joints)
        full = (
            sp.csr_array(sp.block_diag([m.stiffness for m in models], format="csr") + springs),
            sp.csr_array(sp.block_diag([m.inertia for m in models], format="csr")),
            sp.csr_array(sp.block_diag([_viscosity(m) for m in models], format="csr") + dashpots),
        )
        stiffness, mass, damping = (_product(both, matrix) for matrix in full)
        shapes = driven + expansion @ made.driven
        rank = _rank(models, expansion, made, stiffness)
        n_free = made.q_part.shape[1]
        matrices = full, stiffness, mass, damping
        jumps = [sp.csr_array((0, n_full)), *(jump_rows(layout, trace, i) for i in joints.relative)]
        jump = sp.csr_array(sp.vstack(jumps))
        return TiedAssembly(
            models, where, joints, trace, both, n_free, shapes, *matrices, channels, made.free, rank, jump
        )

    @property
    def n_relative(self) -> int:
        """Number of r."""
        return len(self.channels)


def _trace(classes: Sequence[ModelClass], layout: Layout, where: Mapping[str, slice], n: int) -> sp.csr_array:
    """Trace (n_flat, n_full) from the full dofs of all bodies to the channels."""
    rows, columns, values = [np.zeros(0, np.int64)], [np.zeros(0, np.int64)], [np.zeros(0)]
    for c in classes:
        for j, model in enumerate(c.members):
            trace = model.trace.tocoo()
            rows.append(c.channels[trace.coords[0], j])
            columns.append(trace.coords[1] + where[model.name].start)
            values.append(trace.data)
    entries = np.concatenate(values), (np.concatenate(rows), np.concatenate(columns))
    return sp.csr_array(sp.coo_array(entries, shape=(layout.n_flat, n)))


def _rows(
    units: Sequence[InterfaceUnit], layout: Layout, trace: sp.csr_array, joints: Joints
) -> tuple[sp.csr_array, sp.csr_array, Index]:
    """Rows J (k, n_full) in global axes where a point has three components, their weights (k, n_r), and the channels
    (n_r,) of the relative motions: those of side E."""
    rows, weights, channels = [sp.csr_array((0, trace.shape[1]))], list[sp.csr_array](), list[Index]()
    for i in (*joints.bonded, *joints.relative):
        unit, first = units[i], layout.channels(i, 0)
        sign = 1.0 if unit.geometry.owner == 0 else -1.0  # entries of the owner are the pivots
        turn = sign * _global(unit, first.shape[1])
        rows.append(sp.csr_array(turn @ jump_rows(layout, trace, i)))
        if i in joints.relative:
            weights.append(turn)
            channels.append(first.ravel())
    n_bonded = sum(layout.channels(i, 0).size for i in joints.bonded)
    of_relative = sp.block_diag(weights, format="csr") if weights else sp.csr_array((0, 0))
    placed = sp.csr_array(sp.vstack([sp.csr_array((n_bonded, of_relative.shape[1])), of_relative]))
    return sp.csr_array(sp.vstack(rows)), placed, np.concatenate([np.zeros(0, dtype=np.int64), *channels])


def jump_rows(layout: Layout, trace: sp.csr_array, i: int) -> sp.csr_array:
    """Motion of side E over that of E' of an interface in local frames, (k, n_full)."""
    first, second = (layout.channels(i, side).ravel() for side in (0, 1))
    return sp.csr_array(trace[first] - trace[second])


def _joint_matrices(
    units: Sequence[InterfaceUnit], layout: Layout, trace: sp.csr_array, joints: Joints
) -> tuple[sp.csr_array, sp.csr_array]:
    """Springs and dashpots (n_full, n_full) of the interfaces that have them."""
    n = trace.shape[1]
    springs, dashpots = sp.csr_array((n, n)), sp.csr_array((n, n))
    for i in joints.linear:
        unit, rows = units[i], jump_rows(layout, trace, i)
        size = rows.shape[0] // unit.geometry.n_point
        per_area = unit.behaviour.point_parameters(unit.geometry.n_point)[:, [0, *[1] * (size - 1)]]
        weights = (unit.geometry.areas[:, None] * per_area).ravel()
        made = sp.csr_array(rows.T @ sp.diags_array(weights) @ rows)
        if unit.behaviour.elastic:
            springs = sp.csr_array(springs + made)
        else:
            dashpots = sp.csr_array(dashpots + made)
    return springs, dashpots


def _global(unit: InterfaceUnit, n_component: int) -> sp.csr_array:
    """Rotation of vectors at the points from local frames to global axes; none of single components."""
    n = unit.geometry.n_point * n_component
    if n_component != 3:
        return sp.csr_array(sp.eye_array(n))
    frames = np.ascontiguousarray(unit.geometry.frames.transpose(0, 2, 1))
    return _without_round_off(sp.csr_array(sp.block_diag(list(frames), format="csr")))


def _viscosity(model: SubstructureModel) -> sp.csr_array:
    """Damping (n_full, n_full) of a body without the viscosity of its contact layer, which belongs to faces that land,
    and without its modal damping."""
    if model.damping is None:
        return sp.csr_array((model.n_full, model.n_full))
    return model.damping if model.landing is None else sp.csr_array(model.damping - model.landing)


def _product(both: sp.csr_array, matrix: sp.csr_array) -> sp.csr_array:
    """B^T A B (n, n)."""
    product = sp.csr_array(both.T @ matrix @ both)
    product.sort_indices()
    return product


def _rank(
    models: Sequence[SubstructureModel], expansion: sp.csr_array, made: Elimination, stiffness: sp.csr_array
) -> Array | None:
    """Elimination order (n,) of [q, r]: nested dissection of their places; None where a body has none."""
    if any(m.positions is None for m in models):
        return None
    places = np.repeat(np.concatenate([m.positions for m in models if m.positions is not None]), 3, axis=0)
    # a reduced dof has the place of the first full dof that it moves
    columns = sp.csc_array(expansion)
    of_dof = places[columns.indices[columns.indptr[:-1]]]
    relative = sp.csc_array(made.r_part)
    positions = np.concatenate([of_dof[made.free], of_dof[relative.indices[relative.indptr[:-1]]]])
    # dofs of one place are one node of the graph
    places = np.round(positions / np.ptp(positions, axis=0).max(), 9)
    _, first, node = np.unique(places, axis=0, return_index=True, return_inverse=True)
    node = node.ravel()
    n = len(first)
    pairs = np.repeat(node, np.diff(stiffness.indptr)), node[stiffness.indices]
    graph = sp.coo_array((np.ones(stiffness.nnz, dtype=np.int8), pairs), shape=(n, n)).tocsr()
    return dissected(positions[first], graph)[0][node]
