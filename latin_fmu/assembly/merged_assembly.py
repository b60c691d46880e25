"""Bonded assembly as one body: interface nodes made one, nothing iterated.

The linear transient of the bonded mesh is the lower bound of every cost of contact, and what an assembly with perfect
interfaces only reduces to.

Bonds of non-matching faces are constraints: the dofs of one side in terms of those of the other. With
u = P r + Q m (reduced dofs r, prescribed motions m) the bonds C u = 0, C = [T_E, -T_E'], are solved for as many
reduced dofs as there are independent bonds: those of the owner's nodes, whose block is the identity or close to it.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Final

import numpy as np
import scipy.linalg as la
import scipy.sparse as sp
import scipy.sparse.linalg as spla
from scipy.sparse.csgraph import connected_components

from ..fem.dissection import nested_dissection
from ..fem.mesh import Array, CellBlock, Index, Mesh, cell_blocks
from ..interface import Rods
from ..interface.laws import bonds as joins
from ..latin.assembly import InterfaceUnit
from ..latin.recorder import SubstructureInfo
from ..propagator import Histories, LoadTerm, SubstructureModel
from ..propagator.model import is_selection as copies
from ..scene.fields import split_face
from .body import Body, consecutive
from .timeline import Timeline

_NOTHING = 1e-9  # entries below this share of 1 are round-off
_MOST_ROWS: Final = 2000  # of bonds around loops, which are searched for dependent ones
_TAKES_PART = 1e-8  # of a unit combination of rows
_LARGEST = 1e3  # an entry above it means that two bonds are nearly linearly dependent


@dataclass(frozen=True)
class Merged:
    """Substructures bonded to one body.

    Attributes
    ----------
    model : the merged body. members : the models it is made of.
    where : slice of the full dofs of each among those of the merged body.
    """

    model: SubstructureModel
    members: list[SubstructureModel]
    where: dict[str, slice]

    def histories(self, timeline: Timeline, time: Array) -> Histories:
        """Histories that drive the merged body at the instants ``time``, s."""
        parts = [timeline.histories(m, time) for m in self.members]
        amplitudes = [a for part in parts for a in part.amplitudes]
        imposed = np.concatenate([p.imposed for p in parts], axis=1)
        return Histories(time, amplitudes, imposed, tuple(kind for p in parts for kind in p.motion_kinds))


def merge(
    members: Sequence[SubstructureModel], interfaces: Sequence[InterfaceUnit], info: Mapping[str, SubstructureInfo]
) -> Merged:
    """Matrices of substructures with every interface between them bonded; ``info`` holds their meshes.

    Raises
    ------
    ValueError : a substructure is rigid (its dofs are not those of its nodes); unlike Maxwell branches; bonds of
        non-matching faces that cannot be written as constraints, or that join bodies which start with a spin;
        conditions that couple directions.
    """
    models = {m.name: m for m in members}
    if any(m.nodal is not None for m in members):
        raise ValueError("an assembly with rigid substructures cannot be merged")
    if any(m.modal is not None for m in members):
        raise ValueError("modal damping is that of one substructure, not of several bonded ones")
    if not all(copies(m.expansion) for m in members):
        raise ValueError("faces held along directions that are no axes, or rigid ones")
    branches = {m.branches for m in members}
    if len(branches) > 1:
        raise ValueError("substructures whose damping by strain is not the same")
    names = list(models)
    where, total = consecutive({n: model.n_full for n, model in models.items()})
    paired = [unit for unit in interfaces if is_selection(unit)]
    same = _same_dofs(paired, where, total)
    expansion = _merged_expansion(models, where, same)
    # motions of one body drive only its own dofs
    imposed: Array = sp.block_diag([sp.coo_array(models[n].imposed_pattern) for n in names]).toarray()
    # a tied dof that is driven in one body is driven in all
    driven = np.zeros((same.max() + 1, imposed.shape[1]))
    np.maximum.at(driven, same, imposed)
    pattern = driven[same]
    if len(paired) < len(interfaces):
        mixed = [unit for unit in interfaces if not is_selection(unit)]
        expansion, pattern = tied(constraints(mixed, where, total), expansion, pattern)
        _check_start([models[n] for n in names])
    model = SubstructureModel(
        name="bonded",
        mass=_blocks([models[n].inertia for n in names]),
        damping=_damping([models[n] for n in names]),
        stiffness=_blocks([models[n].stiffness for n in names]),
        expansion=expansion,
        trace=sp.csr_array((0, total)),
        channel_area=np.zeros(0),
        loads=[LoadTerm(load.name, _placed(load.pattern, where[n], total)) for n in names for load in models[n].loads],
        displacement=np.concatenate([models[n].displacement for n in names]),
        velocity=np.concatenate([models[n].velocity for n in names]),
        imposed_pattern=pattern,
        imposed_start=np.concatenate([models[n].imposed_start for n in names]),
        imposed_speed=np.concatenate([_speed(models[n]) for n in names]),
        ordering=_rank(names, info, same),
        branches=branches.pop(),
    )
    return Merged(model, list(members), where)


def _check_start(models: list[SubstructureModel]) -> None:
    """Initial values of reduced dofs are weighted means over full ones: right for translations only where the weights
    of a constraint differ."""
    for model in models:
        for values in (model.displacement, model.velocity):
            nodal = values.reshape(-1, 3)
            if np.abs(nodal - nodal[0]).max() > 1e-12 * max(float(np.abs(nodal).max()), 1e-300):
                raise ValueError(f"{model.name} starts with a spin and is bonded to a face of another mesh")


def _same_dofs(interfaces: Sequence[InterfaceUnit], where: dict[str, slice], n: int) -> np.ndarray:
    """Number of the merged dof of every full dof."""
    firsts, seconds = [np.zeros(0, dtype=np.int64)], [np.zeros(0, dtype=np.int64)]
    for unit in interfaces:
        first, second = unit.geometry.traces
        if second is None:
            continue
        # one entry in a row: ``is_selection``
        firsts.append(where[split_face(unit.sides[0])[0]].start + first.indices)
        seconds.append(where[split_face(unit.sides[1])[0]].start + second.indices)
    a, b = np.concatenate(firsts), np.concatenate(seconds)
    graph = sp.coo_array((np.ones(len(a)), (a, b)), shape=(n, n))
    return np.asarray(connected_components(graph, directed=False)[1])


def _merged_expansion(models: dict[str, SubstructureModel], where: dict[str, slice], same: np.ndarray) -> sp.csr_array:
    """Selection matrix of the merged body: dofs tied by an interface or within a body are one."""
    apart = sp.csr_array(sp.block_diag([models[n].expansion for n in where]))
    n_full, n = apart.shape
    # reduced dofs that share a merged dof are one; a merged dof held in one body is held in all
    held_rows = np.flatnonzero(np.diff(apart.indptr) == 0)
    rows = np.flatnonzero(np.diff(apart.indptr))
    count = int(same.max()) + 1
    # bipartite: merged dofs, then reduced dofs, joined where a full dof is both
    graph = sp.coo_array((np.ones(len(rows)), (same[rows], count + apart.indices)), shape=(count + n, count + n))
    _, label = connected_components(graph, directed=False)
    fixed = np.zeros(int(label.max()) + 1, dtype=bool)
    fixed[label[same[held_rows]]] = True
    of_dof = label[same]
    free = np.flatnonzero(~fixed[of_dof])
    _, columns = np.unique(of_dof[free], return_inverse=True)
    shape = (n_full, int(columns.max(initial=-1)) + 1)
    return sp.coo_array((np.ones(len(free)), (free, columns)), shape=shape).tocsr()


def _blocks(matrices: list[sp.csr_array]) -> sp.csr_array:
    return sp.csr_array(sp.block_diag(matrices, format="csr"))


def _damping(models: list[SubstructureModel]) -> sp.csr_array | None:
    if all(m.damping is None for m in models):
        return None
    return _blocks([sp.csr_array(m.stiffness.shape) if m.damping is None else m.damping for m in models])


def _placed(pattern: Array, where: slice, n: int) -> Array:
    placed = np.zeros(n)
    placed[where] = pattern
    return placed


def _rank(names: list[str], info: Mapping[str, SubstructureInfo], same: np.ndarray) -> Array:
    """Elimination rank of the merged mesh."""
    nodes = np.concatenate([info[n].nodes for n in names])
    starts = np.cumsum([0, *(len(info[n].nodes) for n in names[:-1])])
    # the three components of a node are merged alike
    _, places, number = np.unique(same[::3], return_index=True, return_inverse=True)
    blocks = tuple(
        CellBlock(b.cell_type, number[b.cells + start])
        for n, start in zip(names, starts, strict=True)
        for b in cell_blocks(info[n].cells)
    )
    rank = nested_dissection(Mesh(nodes[places], blocks, {}))
    return np.repeat(rank[number], 3)


def is_selection(unit: InterfaceUnit) -> bool:
    """Whether an interface pairs nodes of both sides, one entry of 1 per row of its traces."""
    return all(
        trace is None or (trace.nnz == trace.shape[0] and bool((trace.data == 1.0).all()))
        for trace in unit.geometry.traces
    )


def constraints(units: Sequence[InterfaceUnit], where: dict[str, slice], n: int) -> sp.csr_array:
    """C (n_row, n): what bonds between bodies keep at zero; the owner's entries are positive."""
    bonds = [jump(unit, unit.geometry.traces, where, n) for unit in units if unit.geometry.traces[1] is not None]
    return sp.csr_array(sp.vstack([sp.csr_array((0, n)), *bonds]))


def jump(
    unit: InterfaceUnit, traces: Sequence[sp.csr_array | None], where: Mapping[str, slice], n: int
) -> sp.csr_array:
    """Motion of the owner's side of an interface less that of the other, (n_row, n), from the dofs of many bodies.

    traces : of both sides from the dofs of their bodies, None for the ground. where : place of these dofs, by body.
    """
    n_row = next(trace.shape[0] for trace in traces if trace is not None)
    total = sp.csr_array((n_row, n))
    for number, (trace, side) in enumerate(zip(traces, unit.sides, strict=True)):
        if trace is not None:
            # the owner is positive: its entries are the pivots of a bond (``tied``)
            if number == unit.geometry.owner:
                sign = 1.0
            else:
                sign = -1.0
            total = total + sign * placed(trace, where[split_face(side)[0]].start, n)
    return sp.csr_array(total)


def loop_remarks(bodies: Mapping[str, Body], units: Sequence[InterfaceUnit]) -> list[str]:
    """Bonds that close a loop: where three bodies or more meet at a node, each bonded to the next, as many conditions
    join them as there are bonds, one more than are needed. What goes round in the loop moves nothing: the force of each
    bond is unknown by it, the sum on every body is not.

    A combination of rows of the bonds that is zero takes every node at least twice: rows with a node of their own are
    left out, again and again, and the others are searched for dependent ones.
    """
    tied = [unit for unit in units if joins(unit.behaviour) and not isinstance(unit.behaviour, Rods)]
    if len(tied) < 3:
        return []
    where, total = consecutive({name: body.mesh.n_node for name, body in bodies.items()})
    rows = []
    for unit in tied:
        # one component stands for all
        along = [None if trace is None else sp.csr_array(trace[::3, ::3]) for trace in unit.geometry.traces]
        rows.append(jump(unit, along, where, total))
    owner = np.repeat(np.arange(len(tied)), [block.shape[0] for block in rows])
    matrix, numbers = sp.csr_array(sp.vstack(rows)), owner
    while matrix.shape[0]:
        present = (abs(matrix) > 0).astype(float)
        alone = present.sum(axis=0) < 2
        shared = present @ alone.astype(float) == 0.0
        if shared.all():
            break
        matrix, numbers = sp.csr_array(matrix[np.flatnonzero(shared)]), numbers[shared]
    if not 2 < matrix.shape[0] <= _MOST_ROWS:
        return []
    used = np.flatnonzero(abs(matrix).sum(axis=0))
    dependent = la.null_space(matrix[:, used].toarray().T)
    taken = np.abs(dependent).max(axis=1, initial=0.0) > _TAKES_PART
    if not taken.any():
        return []
    names = [tied[i].name for i in np.unique(numbers[taken])]
    return [
        f"bonds {', '.join(names)} close a loop of bodies at {dependent.shape[1]} place(s): the force that goes round "
        "in it is not unique, nor is that of each of these bonds; displacements, stresses and the sum of the forces on "
        "every body are. Make one body of them, or leave these places out of a bond"
    ]


def placed(rows: sp.csr_array, first: int, n: int) -> sp.csr_array:
    """Rows over the dofs of one body as rows over n dofs, of which those of the body begin at ``first``."""
    block = sp.csr_array(rows)
    return sp.csr_array((block.data, block.indices + first, block.indptr), shape=(block.shape[0], n))


def tied(bonds: sp.csr_array, expansion: sp.csr_array, pattern: Array) -> tuple[sp.csr_array, Array]:
    """Expansion (n_full, n) and prescribed shapes (n_full, n_motion) that keep the bonds, from those without them.

    Raises
    ------
    ValueError : bonds that hold the same dofs twice, or hold what is held already.
    """
    rows = sp.csr_array(bonds @ expansion)
    rows.data[np.abs(rows.data) < _NOTHING] = 0.0
    rows.eliminate_zeros()
    moved = np.asarray(bonds @ pattern)
    active = np.flatnonzero(np.diff(rows.indptr))
    silent = np.setdiff1d(np.arange(rows.shape[0]), active)
    if moved.size and np.abs(moved[silent]).max(initial=0.0) > _NOTHING:
        raise ValueError("bonds between faces that are driven apart")
    rows, moved = sp.csr_array(rows[active]), moved[active]
    chosen = _pivots(rows)
    free = np.setdiff1d(np.arange(rows.shape[1]), chosen)
    block = sp.csc_array(rows[:, chosen])
    try:
        factor = spla.splu(block)
    # a pivot of exactly zero
    except RuntimeError as error:
        raise ValueError("bonds that hold the same nodes twice") from error
    # C_c r_c = -C_f r_f - C m: the chosen dofs by the free ones and by the motions
    solved = -factor.solve(np.column_stack([rows[:, free].toarray(), moved]))
    if not np.isfinite(solved).all() or np.abs(solved).max(initial=0.0) > _LARGEST:
        raise ValueError("bonds that hold the same nodes twice")
    solved[np.abs(solved) < _NOTHING] = 0.0
    of_chosen = sp.csr_array(expansion[:, chosen])
    reduced = sp.csr_array(expansion[:, free] + of_chosen @ sp.csr_array(solved[:, : len(free)]))
    reduced.eliminate_zeros()
    return reduced, pattern + of_chosen @ solved[:, len(free) :]


def _pivots(rows: sp.csr_array) -> Index:
    """A column of its own for each row: its largest positive entry that no row before it has taken."""
    chosen = np.full(rows.shape[0], -1, dtype=np.int64)
    taken: set[int] = set()
    # rows with large entries choose first: small pivots are left to rows that have no other
    for i in np.argsort(-rows.max(axis=1).toarray().ravel(), kind="stable"):
        part = slice(rows.indptr[i], rows.indptr[i + 1])
        for j in np.argsort(-rows.data[part], kind="stable"):
            column = int(rows.indices[part][j])
            if column not in taken and abs(rows.data[part][j]) > _NOTHING:
                chosen[i] = column
                taken.add(column)
                break
        else:
            raise ValueError("bonds that hold the same nodes twice")
    return chosen


def _speed(model: SubstructureModel) -> Array:
    """Velocities of the accelerated motions of a body at t = 0, (n_motion,), m s-1."""
    if model.imposed_speed is None:
        return np.zeros(len(model.imposed_start))
    return model.imposed_speed
