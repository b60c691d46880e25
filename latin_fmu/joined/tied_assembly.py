"""An assembly tied at all its interfaces: motions of the bodies by free dofs q and relative motions r of the contacts.

A perfect interface keeps the sides together; one that may open moves its sides by r = T_E u_E - T_E' u_E' relative to
each other (displacement of E over that of E', local frames). Both are rows J u = W r of the reduced dofs x of all
bodies, each of which determines one dof by the others. Springs between sides are part of the stiffness. So

    u = E (Q q + R r) + D d,        J E Q = 0,   J E R = W,   J D = 0

with the expansion E and the driven shapes D d of the bodies. Rows of closed loops depend on each other: those that the
others imply are left out.
"""

from __future__ import annotations

from collections.abc import Collection, Mapping, Sequence
from dataclasses import dataclass
from typing import Final, NamedTuple

import numpy as np
import scipy.linalg as la
import scipy.sparse as sp
from numpy.typing import NDArray
from scipy.sparse.csgraph import connected_components

from ..assembly.body import consecutive
from ..assembly.models import ModelClass
from ..fem.dissection import dissected
from ..interface.laws import bonds
from ..latin.assembly import Array, Index, InterfaceUnit, Layout
from ..laws.maxwell_joint import MaxwellJoint
from ..propagator import SubstructureModel
from ..propagator.model import relaxing_part
from .hierarchical_dofs import HierarchicalDofs

STIFFNESS: Final = 0
MASS: Final = 1
DAMPING: Final = 2
STRAINED: Final = 3
"""Stiffness of the strains alone, without that of their stress."""
_NOTHING: Final = 1e-9  # entries below this share of 1 are round-off
_SMALL: Final = 1e-8  # of the largest, of rows that depend on each other
_ROUNDS: Final = 5  # of choices of the dofs that follow
_LARGEST: Final = 1e3  # an entry of an inverse above it: rows that are nearly dependent


class TieError(ValueError):
    """Interfaces that cannot be written by free dofs and relative motions; says which."""


class Joints(NamedTuple):
    """Interfaces by what they are in a tied assembly: numbers of those that join their sides, of springs between
    them, and of those with relative motions."""

    bonded: tuple[int, ...]
    linear: tuple[int, ...]
    relative: tuple[int, ...]

    @staticmethod
    def of(units: Sequence[InterfaceUnit]) -> Joints:
        """Of the interfaces of an assembly.

        Raises
        ------
        TieError : springs that relax, or are stressed by a gap or a preload; dashpots.
        """
        bonded = list[int]()
        linear = list[int]()
        relative = list[int]()
        for i, unit in enumerate(units):
            if isinstance(unit.behaviour, MaxwellJoint):
                raise TieError(f"interface {unit.name} has springs that relax")
            if unit.behaviour.compliant and not unit.behaviour.elastic:
                raise TieError(f"interface {unit.name} has dashpots between its sides, which modes do not follow")
            if unit.behaviour.elastic and not unit.behaviour.opens and (unit.preload or unit.geometry.gap.any()):
                raise TieError(f"interface {unit.name} is a layer with a gap or a preload, which stresses it")
            if bonds(unit.behaviour):
                kind = bonded
            else:
                if unit.behaviour.opens:
                    kind = relative
                else:
                    kind = linear
            kind.append(i)
        return Joints(tuple(bonded), tuple(linear), tuple(relative))


class Elimination(NamedTuple):
    """x = q_part q + r_part r + driven d, the numbers of the dofs x that the q are, and whether each r exists: points
    that are held on both sides have none."""

    q_part: sp.csr_array
    r_part: sp.csr_array
    driven: Array
    free: Index
    exists: NDArray[np.bool_]


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
    exists = np.ones(weights.shape[1], dtype=bool)
    matrix = _without_round_off(rows)
    while matrix.shape[0]:
        filled = np.diff(matrix.indptr) > 0
        exists[_without_motion(moved[~filled], sp.csr_array(weights[np.flatnonzero(~filled)]))] = False
        full = np.flatnonzero(filled)
        matrix = sp.csr_array(matrix[full])
        moved = moved[full]
        weights = sp.csr_array(weights[full])
        if not len(full):
            break
        pivots, chosen, inverse = _pivots(matrix)
        first = sp.csr_array(matrix[pivots])
        others = np.setdiff1d(np.arange(matrix.shape[1]), chosen)
        # dofs of this round by those that are left, r and d
        by_q = _without_round_off(-inverse @ first[:, others])
        by_r, by_d = sp.csr_array(inverse @ weights[pivots]), -(inverse @ moved[pivots])
        of_chosen = sp.csr_array(q_part[:, chosen])
        q_part = sp.csr_array(q_part[:, others] + of_chosen @ by_q)
        r_part, driven = sp.csr_array(r_part + of_chosen @ by_r), driven + of_chosen @ by_d
        free = free[others]
        # rows that found no dof of their own, in terms of what is left
        rest = np.setdiff1d(np.arange(matrix.shape[0]), pivots)
        of_rest = sp.csr_array(matrix[rest])
        on_chosen = sp.csr_array(of_rest[:, chosen])
        moved = moved[rest] + on_chosen @ by_d
        weights = _without_round_off(weights[rest] - on_chosen @ by_r)
        matrix = _without_round_off(of_rest[:, others] + on_chosen @ by_q)
    return Elimination(q_part, r_part, driven, free, exists)


def _without_motion(moved: Array, weights: sp.csr_array) -> Index:
    """Relative motions that do not exist by rows 0 = weights r - moved d that the others imply."""
    if np.abs(moved).max(initial=0.0) > _NOTHING:
        raise TieError("faces of an interface are driven on both sides, or driven apart")
    weights = _without_round_off(weights)
    if np.diff(weights.indptr).max(initial=0) > 1:
        raise TieError("contacts hold the same nodes twice, so that their relative motions depend on each other")
    return np.unique(weights.indices).astype(np.int64)


def _without_round_off(matrix: sp.csr_array) -> sp.csr_array:
    """The matrix without entries that are round-off of 1."""
    matrix = sp.csr_array(matrix)
    matrix.data[np.abs(matrix.data) < _NOTHING] = 0.0
    matrix.eliminate_zeros()
    matrix.sort_indices()
    return matrix


def _pivots(rows: sp.csr_array) -> tuple[Index, Index, sp.csr_array]:
    """Rows that find a dof of their own, these dofs, and the inverse of their matrix.

    Each row takes its largest entry that no row before has taken, positive ones (the owner's side) before others; rows
    with one entry choose first. Rows that do not go together choose anew, by elimination with pivoting, and those that
    depend on others find none.
    """
    pivots, chosen = _greedy(rows)
    for _ in range(_ROUNDS):
        inverse, apart = _block_inverse(sp.csr_array(rows[pivots][:, chosen]))
        if not len(apart):
            return pivots, chosen, inverse
        regular = np.ones(len(pivots), dtype=bool)
        for places in apart:
            regular[places] = False
        pivot_parts, chosen_parts = [pivots[regular]], [chosen[regular]]
        taken = np.zeros(rows.shape[1], dtype=bool)
        taken[chosen[regular]] = True
        for places in apart:
            some = rows[pivots[places]]
            columns = np.setdiff1d(some.indices, np.flatnonzero(taken))
            independent, picked = _independent(some[:, columns].toarray())
            taken[columns[picked]] = True
            pivot_parts.append(pivots[places][independent])
            chosen_parts.append(columns[picked].astype(np.int64))
        pivots, chosen = np.concatenate(pivot_parts), np.concatenate(chosen_parts)
    raise TieError("interfaces that hold the same nodes many times over")


def _independent(rows: Array) -> tuple[Index, Index]:
    """Rows that do not depend on each other, and as many columns that determine them, one for each."""
    _, r, order = la.qr(rows.T, mode="economic", pivoting=True)
    size = np.abs(np.diagonal(r))
    rank = int((size > _SMALL * size[0]).sum())
    independent = order[:rank]
    _, _, columns = la.qr(rows[independent], mode="economic", pivoting=True)
    return independent.astype(np.int64), columns[:rank].astype(np.int64)


def _greedy(rows: sp.csr_array) -> tuple[Index, Index]:
    """Rows and the columns that they take, first come first served."""
    taken = np.zeros(rows.shape[1], dtype=bool)
    pivots, chosen = list[int](), list[int]()
    for i in np.argsort(np.minimum(np.diff(rows.indptr), 3), kind="stable").tolist():
        part = slice(rows.indptr[i], rows.indptr[i + 1])
        columns, data = rows.indices[part], rows.data[part]
        size = np.where(taken[columns], 0.0, np.abs(data))
        # of entries of nearly the same size the positive one
        best = int(np.argmax(size * (1.0 + _NOTHING * (data > 0.0))))
        if size[best] > 0.1 * np.abs(data).max():
            taken[columns[best]] = True
            pivots.append(i)
            chosen.append(int(columns[best]))
    if not pivots:
        raise TieError("interfaces that hold the same nodes many times over")
    return np.array(pivots, dtype=np.int64), np.array(chosen, dtype=np.int64)


def _block_inverse(matrix: sp.csr_array) -> tuple[sp.csr_array, list[Index]]:
    """Inverse of a matrix that is a permutation of small blocks, and the rows of each block that has none, or is next
    to singular."""
    n = matrix.shape[0]
    coo = matrix.tocoo()
    graph = sp.coo_array((np.ones(coo.nnz), (coo.coords[0], n + coo.coords[1])), shape=(2 * n, 2 * n))
    count, label = connected_components(graph, directed=False)
    order, columns = (np.argsort(part, kind="stable") for part in (label[:n], label[n:]))
    of_rows, of_columns = (np.bincount(part, minlength=count) for part in (label[:n], label[n:]))
    none = np.zeros(0, dtype=np.int64)
    rows_at = [none]
    columns_at = [none]
    values = [np.zeros(0)]
    apart = list[Index]()
    # places of rows, columns and entries in their blocks
    firsts, seconds = (np.cumsum(counts) - counts for counts in (of_rows, of_columns))
    row_in, column_in = np.empty((2, n), dtype=np.int64)
    row_in[order], column_in[columns] = np.arange(n) - firsts[label[order]], np.arange(n) - seconds[label[n + columns]]
    of_entries = label[coo.coords[0]]
    entries, ends = np.argsort(of_entries, kind="stable"), np.cumsum(np.bincount(of_entries, minlength=count))
    first = second = begin = 0
    for height, width, end in zip(of_rows.tolist(), of_columns.tolist(), ends.tolist(), strict=True):
        r, c, inside = order[first : first + height], columns[second : second + width], entries[begin:end]
        first, second, begin = first + height, second + width, end
        block = np.zeros((height, width))
        block[row_in[coo.coords[0][inside]], column_in[coo.coords[1][inside]]] = coo.data[inside]
        if height == width and len(block):
            inverse: Array = np.asarray(la.pinv(block), dtype=np.float64)
        else:
            inverse = np.zeros((0, 0))
        if height != width or not np.abs(inverse @ block - np.eye(height)).max(initial=0.0) < _NOTHING:
            apart.append(r)
            continue
        if np.abs(inverse).max(initial=0.0) > _LARGEST:
            apart.append(r)
            continue
        rows_at.append(np.repeat(c, height))
        columns_at.append(np.tile(r, height))
        values.append(inverse.ravel())
    places = np.concatenate(rows_at), np.concatenate(columns_at)
    return sp.csr_array(sp.coo_array((np.concatenate(values), places), shape=(n, n))), apart


@dataclass(frozen=True)
class TiedAssembly:
    """Matrices of an assembly tied at all interfaces (module docstring).

    Attributes
    ----------
    models : of the bodies. where : slices of their full dofs. joints : the interfaces. trace : (n_flat, n_full) from
    the full dofs of all bodies to the channels. expansion : [E Q, E R] (n_full, n). n_free : number of q. driven : D
    (n_full, n_motion). springs : (n_full, n_full) of the interfaces that have them.
    stiffness, mass : (n, n) on [q, r], N m-1, kg. channels : (n_r,) channel of side E of each r.
    exists : (n_channel,) whether the r of each channel exists. free : (n_free,) numbers of q among the reduced dofs of
    all bodies, made ``hierarchical``. rank : (n,) elimination order of [q, r], nested
    dissection; None where a body has no places.
    """

    models: list[SubstructureModel]
    where: Mapping[str, slice]
    joints: Joints
    trace: sp.csr_array
    expansion: sp.csr_array
    n_free: int
    driven: Array
    springs: sp.csr_array
    stiffness: sp.csr_array
    mass: sp.csr_array
    channels: Index
    exists: NDArray[np.bool_]
    free: Index
    hierarchical: HierarchicalDofs
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
        trace = channel_trace(classes, layout, where, n_full)
        expansion = sp.csr_array(sp.block_diag([m.expansion for m in models], format="csr"))
        hierarchical = HierarchicalDofs.of(units, where, expansion)
        expansion = hierarchical.expanded(expansion)
        driven: Array = sp.block_diag([sp.coo_array(m.imposed_pattern) for m in models]).toarray()
        rows, weights, channels = joint_rows(units, layout, trace, joints)
        elimination = eliminated(_without_round_off(rows @ expansion), np.asarray(rows @ driven), weights)
        there = np.flatnonzero(elimination.exists)
        both = _narrow(sp.csr_array(expansion @ sp.hstack([elimination.q_part, elimination.r_part[:, there]])))
        springs = _springs(units, layout, trace, joints)
        stiffness, mass = (_product(both, [_matrix(m, kind) for m in models]) for kind in (STIFFNESS, MASS))
        stiffness = _ordered(stiffness + both.T @ springs @ both)
        shapes = driven + expansion @ elimination.driven
        rank = _rank(models, both, stiffness)
        n_free = elimination.q_part.shape[1]
        jumps = [sp.csr_array((0, n_full)), *(jump_rows(layout, trace, i) for i in joints.relative)]
        jump = sp.csr_array(sp.csr_array(sp.vstack(jumps))[there])
        return TiedAssembly(
            models,
            where,
            joints,
            trace,
            both,
            n_free,
            shapes,
            springs,
            stiffness,
            mass,
            channels[there],
            elimination.exists,
            elimination.free,
            hierarchical,
            rank,
            jump,
        )

    @property
    def n_relative(self) -> int:
        """Number of r."""
        return len(self.channels)

    def projected(self, kind: int, motions: Array) -> Array:
        """A^T M A (k, k) of motions A = E Q a of the free dofs, (n_free, k), and a matrix M of all bodies as in
        ``times``, without the springs of interfaces."""
        total = np.zeros((motions.shape[1], motions.shape[1]))
        for model in self.models:
            matrix = _matrix(model, kind)
            if matrix.nnz:
                moved = self.moved(model.name, motions)
                total += moved.T @ (matrix @ moved)
        return total

    def rows_times(self, kind: int, rows: sp.csr_array, names: Collection[str]) -> sp.csr_array:
        """Rows (k, n_full) times a matrix of the bodies ``names``, without those of the others and the springs of
        interfaces; DAMPING with that of their modes."""
        blocks = []
        for model in self.models:
            own = sp.csr_array(rows[:, self.where[model.name]])
            block = own @ _matrix(model, kind) if model.name in names else sp.csr_array(own.shape)
            if kind == DAMPING and model.name in names and model.modal_rows is not None:
                block = block + sp.csr_array((own @ model.modal_rows.T) @ model.modal_rows)
            blocks.append(sp.csr_array(block))
        return sp.csr_array(sp.hstack(blocks))

    def moved(self, name: str, motions: Array) -> Array:
        """Full dofs (n_full, k) of a body by motions (n_free, k) of the free dofs."""
        return np.asarray(self.expansion[self.where[name], : self.n_free] @ motions)

    def times(self, kind: int, motions: Array) -> Array:
        """A matrix of all bodies, STIFFNESS with the springs of interfaces, MASS or DAMPING, times motions (n_full,) or
        (n_full, k)."""
        product = np.zeros_like(motions)
        for model in self.models:
            where = self.where[model.name]
            product[where] = _matrix(model, kind) @ motions[where]
        return product + self.springs @ motions if kind == STIFFNESS else product


def placed(where: slice, n: int, rows: sp.csr_array | Array) -> sp.csr_array:
    """Rows (k, m) of the full dofs of a body, which are those of ``where`` among the n of all bodies, (k, n)."""
    matrix = sp.csr_array(rows)
    return sp.csr_array((matrix.data, matrix.indices + where.start, matrix.indptr), shape=(matrix.shape[0], n))


def channel_trace(classes: Sequence[ModelClass], layout: Layout, where: Mapping[str, slice], n: int) -> sp.csr_array:
    """Trace (n_flat, n_full) from the full dofs of all bodies to the channels."""
    rows = [np.zeros(0, np.int64)]
    columns = [np.zeros(0, np.int64)]
    values = [np.zeros(0)]
    for c in classes:
        for j, model in enumerate(c.members):
            trace = model.trace.tocoo()
            rows.append(c.channels[trace.coords[0], j])
            columns.append(trace.coords[1] + where[model.name].start)
            values.append(trace.data)
    entries = np.concatenate(values), (np.concatenate(rows), np.concatenate(columns))
    return sp.csr_array(sp.coo_array(entries, shape=(layout.n_flat, n)))


def joint_rows(
    units: Sequence[InterfaceUnit], layout: Layout, trace: sp.csr_array, joints: Joints
) -> tuple[sp.csr_array, sp.csr_array, Index]:
    """Rows J (k, n_full) in global axes where a point has three components, their weights (k, n_r), and the channels
    (n_r,) of the relative motions: those of side E."""
    rows = [sp.csr_array((0, trace.shape[1]))]
    weights = list[sp.csr_array]()
    channels = list[Index]()
    for i in (*joints.bonded, *joints.relative):
        unit, first = units[i], layout.channels(i, 0)
        # entries of the owner are the pivots
        if unit.geometry.owner == 0:
            sign = 1.0
        else:
            sign = -1.0
        turn = sign * _global(unit, first.shape[1])
        rows.append(sp.csr_array(turn @ jump_rows(layout, trace, i)))
        if i in joints.relative:
            weights.append(turn)
            channels.append(first.ravel())
    n_bonded = sum(layout.channels(i, 0).size for i in joints.bonded)
    if weights:
        of_relative = sp.block_diag(weights, format="csr")
    else:
        of_relative = sp.csr_array((0, 0))
    placed = sp.csr_array(sp.vstack([sp.csr_array((n_bonded, of_relative.shape[1])), of_relative]))
    return sp.csr_array(sp.vstack(rows)), placed, np.concatenate([np.zeros(0, dtype=np.int64), *channels])


def jump_rows(layout: Layout, trace: sp.csr_array, i: int) -> sp.csr_array:
    """Motion of side E over that of E' of an interface in local frames, (k, n_full)."""
    first, second = (layout.channels(i, side).ravel() for side in (0, 1))
    return sp.csr_array(trace[first] - trace[second])


def _springs(units: Sequence[InterfaceUnit], layout: Layout, trace: sp.csr_array, joints: Joints) -> sp.csr_array:
    """Springs (n_full, n_full) of the interfaces that have them."""
    n = trace.shape[1]
    springs = sp.csr_array((n, n))
    for i in joints.linear:
        rows = jump_rows(layout, trace, i)
        springs = sp.csr_array(springs + rows.T @ sp.diags_array(spring_weights(units[i])) @ rows)
    return springs


def spring_weights(unit: InterfaceUnit) -> Array:
    """Stiffness (n_channel,) of the springs of an interface at its channels, N m-1."""
    per_area = unit.behaviour.point_parameters(unit.geometry.n_point)
    tangential = [1] * (unit.behaviour.n_component - 1)
    return np.asarray((unit.geometry.areas[:, None] * per_area[:, [0, *tangential]]).ravel())


def _global(unit: InterfaceUnit, n_component: int) -> sp.csr_array:
    """Rotation of vectors at the points from local frames to global axes; none of single components."""
    n = unit.geometry.n_point * n_component
    if n_component != 3:
        return sp.csr_array(sp.eye_array(n))
    frames = np.ascontiguousarray(unit.geometry.frames.transpose(0, 2, 1))
    return _without_round_off(sp.csr_array(sp.block_diag(list(frames), format="csr")))


def _matrix(model: SubstructureModel, kind: int) -> sp.csr_array:
    """STIFFNESS, MASS, DAMPING or STRAINED (n_full, n_full) of a body."""
    if kind == DAMPING:
        return _viscosity(model)
    if kind == STRAINED:
        return relaxing_part(model)
    if kind == STIFFNESS:
        return model.stiffness
    return model.inertia


def _viscosity(model: SubstructureModel) -> sp.csr_array:
    """Damping (n_full, n_full) of a body without the viscosity of its contact layer, which belongs to faces that land,
    and without its modal damping."""
    if model.damping is None:
        return sp.csr_array((model.n_full, model.n_full))
    if model.landing is None:
        return model.damping
    return sp.csr_array(model.damping - model.landing)


def _narrow(matrix: sp.csr_array) -> sp.csr_array:
    """The matrix with places of four bytes where they do: half of the memory, and faster products."""
    if matrix.nnz > np.iinfo(np.int32).max:
        return matrix
    places = matrix.indices.astype(np.int32), matrix.indptr.astype(np.int32)
    return sp.csr_array((matrix.data, *places), shape=matrix.shape)


def side_by_side(matrices: Sequence[sp.csr_array]) -> sp.csr_array:
    """The block diagonal matrix of matrices, in a twentieth of the time that SciPy's takes by coordinates."""
    if not matrices:
        return sp.csr_array((0, 0))
    rows, columns = (np.cumsum([0, *(m.shape[axis] for m in matrices)]) for axis in (0, 1))
    entries = np.cumsum([0, *(m.nnz for m in matrices)])
    wide = np.int64 if max(entries[-1], rows[-1], columns[-1]) > np.iinfo(np.int32).max else np.int32
    starts = np.concatenate([[0], *(m.indptr[1:] + at for m, at in zip(matrices, entries, strict=False))])
    places = np.concatenate([m.indices + at for m, at in zip(matrices, columns, strict=False)])
    data = np.concatenate([m.data for m in matrices])
    return sp.csr_array((data, places.astype(wide), starts.astype(wide)), shape=(rows[-1], columns[-1]))


def _product(both: sp.csr_array, matrices: Sequence[sp.csr_array]) -> sp.csr_array:
    """B^T A B (n, n) of the matrices A of all bodies."""
    if not any(matrix.nnz for matrix in matrices):
        return sp.csr_array((both.shape[1], both.shape[1]))
    return _ordered(sp.csr_array(both.T) @ (side_by_side(matrices) @ both))


def _ordered(matrix: sp.csr_array) -> sp.csr_array:
    """The matrix with the entries of each row in order."""
    ordered = sp.csr_array(matrix)
    ordered.sort_indices()
    return ordered


def _rank(models: Sequence[SubstructureModel], both: sp.csr_array, stiffness: sp.csr_array) -> Array | None:
    """Elimination order (n,) of [q, r]: nested dissection of their places; None where a body has none."""
    if any(m.positions is None for m in models):
        return None
    places = np.repeat(np.concatenate([m.positions for m in models if m.positions is not None]), 3, axis=0)
    # a dof has the place of the first full dof that it moves
    columns = sp.csc_array(both)
    positions = places[columns.indices[columns.indptr[:-1]]]
    # dofs of one place are one node of the graph
    places = np.round(positions / np.ptp(positions, axis=0).max(), 9)
    _, first, node = np.unique(places, axis=0, return_index=True, return_inverse=True)
    node = node.ravel()
    n = len(first)
    pairs = np.repeat(node, np.diff(stiffness.indptr)), node[stiffness.indices]
    graph = sp.coo_array((np.ones(stiffness.nnz, dtype=np.int8), pairs), shape=(n, n)).tocsr()
    return dissected(positions[first], graph)[0][node]
