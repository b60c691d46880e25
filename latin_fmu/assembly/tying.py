"""Bonds of non-matching faces as constraints of one body: the dofs of one side in terms of those of the other.

With u = P r + Q m (reduced dofs r, prescribed motions m) the bonds C u = 0, C = [T_E, -T_E'], are solved for as many
reduced dofs as there are independent bonds: those of the owner's nodes, whose block is the identity or close to it.
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
import scipy.sparse as sp
import scipy.sparse.linalg as spla

from ..fem.mesh import Array, Index
from ..latin.layout import InterfaceUnit
from ..scene.fields import split_face

_NOTHING = 1e-9  # entries below this share of 1 are round-off
_LARGEST = 1e3  # an entry above it means that two bonds say nearly the same


def is_selection(unit: InterfaceUnit) -> bool:
    """Whether an interface pairs nodes of both sides, one entry of 1 per row of its traces."""
    return all(
        trace is None or (trace.nnz == trace.shape[0] and bool((trace.data == 1.0).all()))
        for trace in unit.geometry.traces
    )


def constraints(units: Sequence[InterfaceUnit], where: dict[str, slice], n: int) -> sp.csr_array:
    """C (n_row, n): what bonds between bodies keep at zero; the owner's entries are positive."""
    blocks = [sp.csr_array((0, n))]
    for unit in units:
        first, second = unit.geometry.traces
        if second is None:
            continue
        wide = sp.csr_array((first.shape[0], n))
        for trace, side in zip((first, second), unit.sides, strict=True):
            coo = sp.coo_array(trace)
            sign = 1.0 if (side == unit.sides[unit.geometry.owner]) else -1.0
            columns = coo.coords[1] + where[split_face(side)[0]].start
            wide = wide + sp.coo_array((sign * coo.data, (coo.coords[0], columns)), shape=wide.shape).tocsr()
        blocks.append(sp.csr_array(wide))
    return sp.csr_array(sp.vstack(blocks))


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
    except RuntimeError as error:
        raise ValueError("bonds that hold the same nodes twice") from error
    solved = -factor.solve(np.column_stack([rows[:, free].toarray(), moved]))
    if not np.isfinite(solved).all() or np.abs(solved).max(initial=0.0) > _LARGEST:
        raise ValueError("bonds that hold the same nodes twice")
    solved[np.abs(solved) < _NOTHING] = 0.0
    of_chosen = sp.csr_array(expansion[:, chosen])
    found = sp.csr_array(expansion[:, free] + of_chosen @ sp.csr_array(solved[:, : len(free)]))
    found.eliminate_zeros()
    return found, pattern + of_chosen @ solved[:, len(free) :]


def _pivots(rows: sp.csr_array) -> Index:
    """A column of its own for each row: its largest positive entry that no row before it has taken."""
    chosen = np.full(rows.shape[0], -1, dtype=np.int64)
    taken: set[int] = set()
    for i in np.argsort(-_largest(rows), kind="stable"):
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


def _largest(rows: sp.csr_array) -> Array:
    found: Array = rows.max(axis=1).toarray().ravel()
    return found
