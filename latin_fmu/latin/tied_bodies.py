"""The assembly with the points of its interfaces tied by dashpots, one sparse factor: see ``kernels.tied``."""

from __future__ import annotations

from typing import Any, Final

import numpy as np
import scipy.sparse as sp

from ..cholesky.factor import CholeskyFactor
from ..cholesky.symbolic import Pattern, shared_analysis
from ..fem.dissection import dissected
from ..propagator.interface_sweeps import NONE, interface_last
from ..propagator.model import operator_factors, operator_matrices
from .assembly import Array, Assembly, Index

MOST_TIED: Final = 4
"""Numbers of its factor, in single precision, over those of the factors of the bodies, up to which it is made."""
_CACHE: Final = 16_000_000  # bytes of panels up to which four rows at a time are faster


def tied_size(assembly: Assembly) -> int:
    """Dofs of all bodies."""
    return sum(p.n_dof * len(p.names) for p in assembly.propagators)


def tied_fields(assembly: Assembly, softness: Array) -> dict[str, Any]:
    """Fields of the record of the run for the preconditioner; empty where its factor would be too large.

    softness : (n_flat,) diagonal of sticking components, the sum of both sides, m3 N-1 s-1; 0 where nothing is tied.
    """
    n_flat = assembly.layout.n_flat
    dashpot = np.divide(assembly.layout.area, softness, out=np.zeros(n_flat), where=softness > 0.0)
    blocks = []
    traces = []
    size = 0
    for propagator, channels in zip(assembly.propagators, assembly.channels, strict=True):
        ops, model = propagator.operators, propagator.members[0]
        factors = operator_factors(model, assembly.scheme, assembly.dt)
        operator = model.operator_pattern.sum(factors, operator_matrices(model))
        gain = assembly.scheme.interface_gain(assembly.dt) * assembly.scheme.traction_weight
        # of every member: alike bodies share a factor, the tied one has each of them
        size += channels.shape[1] * (getattr(ops.factor, "panels", NONE).size + ops.factor.schur.size)
        for member in channels.T:
            blocks.append(sp.csr_array(operator / gain))
            # rows of its channels, columns of its dofs
            rows = np.repeat(member, np.diff(ops.trace.indptr))
            entries = ops.trace.data, (rows, ops.dofs[ops.trace.indices])
            traces.append(sp.csr_array(sp.coo_array(entries, shape=(n_flat, propagator.n_dof))))
    trace = sp.csr_array(sp.hstack(traces))
    jump = sp.csr_array(_jumps(assembly) @ trace)
    ties = jump.T @ sp.diags_array(dashpot) @ jump
    matrix = sp.csr_array(sp.block_diag(blocks, format="csr") + ties)
    matrix.sort_indices()
    face = np.unique(trace.indices).astype(np.int64)
    shape = shared_analysis(Pattern(matrix, NONE, _rank(assembly, matrix, face), face))
    if int(shape.panel_start[-1]) > MOST_TIED * size:
        return {}
    factor = CholeskyFactor(matrix, NONE, None, np.float32, shape, face)
    places = sp.csr_array((trace.data, shape.position[trace.indices], trace.indptr), shape=trace.shape)
    return {
        "tied_super": len(shape.face_start),
        "tied_entries": shape.face_entries,
        "tied_grouped": int(factor.panels.nbytes <= _CACHE),
        "tied_first": shape.first,
        "tied_row_start": shape.row_start,
        "tied_rows_below": shape.rows,
        "tied_panel_start": shape.panel_start,
        "tied_face_start": shape.face_start,
        "tied_panels": factor.panels,
        "tied_dashpot": dashpot,
        "tied": places,
    }


def _jumps(assembly: Assembly) -> sp.csr_array:
    """Matrix (n_flat, n_flat) of the jumps of channels, in the rows of the first sides; the others have none."""
    rows = [NONE]
    columns = [NONE]
    values = [np.zeros(0)]
    for group in assembly.layout.groups:
        size = group.n_point * group.n_component
        first = np.arange(group.start, group.start + size)
        rows += [first, first]
        columns += [first, first + size]
        values += [np.ones(size), -np.ones(size)]
    entries = np.concatenate(values), (np.concatenate(rows), np.concatenate(columns))
    return sp.csr_array(sp.coo_array(entries, shape=(assembly.layout.n_flat, assembly.layout.n_flat)))


def _rank(assembly: Assembly, matrix: sp.csr_array, face: Index) -> Array | None:
    """Elimination order of the dofs by nested dissection of the nodes of all bodies; None where some have no nodes."""
    members = [m for p in assembly.propagators for m in p.members]
    nodes = []
    positions = []
    start = 0
    for model in members:
        if model.positions is None:
            return None
        # a dof that stands for several has the place of the first
        expansion = sp.csc_array(model.expansion)
        used, number = np.unique(expansion.indices[expansion.indptr[:-1]] // 3, return_inverse=True)
        positions.append(model.positions[used])
        nodes.append(start + number)
        start += len(used)
    node = np.concatenate(nodes)
    pairs = np.repeat(node, np.diff(matrix.indptr)), node[matrix.indices]
    graph = sp.coo_array((np.ones(matrix.nnz, dtype=np.int8), pairs), shape=(start, start)).tocsr()
    rank, parts = dissected(np.concatenate(positions), graph)
    return interface_last(rank[node], parts[node], face)
