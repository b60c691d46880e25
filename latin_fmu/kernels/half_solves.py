"""Substitution through the factor of a class: half solves of an instant, and interfaces without dense matrices.

``forward`` and ``backward`` are the halves of the solution with the operator of the march. A class with dense matrices
keeps its interface dofs for last, between the two. Of a ``swept`` class the factor holds all dofs, and solves with its
interfaces are substitutions through the part of it next to them (``propagator.interface_sweeps``): Y is that with the
dashpots k in the factor, and the tractions of an instant enter before ``backward`` ends it by

    half_solution += L^-1 T^T area (F - F_0)

with the tractions F_0 of the last instant, which are among the loads of ``forward`` (``substructure``).

Modal damping adds k dot products to both halves (``cholesky.factor.LowRankFactor``); such a class is not swept.
"""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import NDArray

from ..cholesky.substitution import LANES, TILED, forward_four, forward_tile
from ..compiled import kernel
from .matrices import add_spread, add_trace
from .products import tile_width
from .records import STATIC
from .sparse_response import add_response
from .splits import substitute

Array = NDArray[np.float64]


@kernel
def place_of(n: int, m: int, i: int, j: int) -> int:
    """Place of entry i of member j among the vectors of ``substitute``."""
    if m < TILED:
        return n * j + i
    # in tiles of LANES members, which lie next to each other within a row
    return n * (j - j % LANES) + LANES * i + j % LANES


@kernel
def on_springs(pools: Any, c: int) -> bool:
    """Whether the class is marched with the factor that has the search direction in it: without inertia, where the
    interface dofs are not kept for last."""
    row = pools.classes[c]
    return bool(row.swept == 1 and row.kind == STATIC)


@kernel
def gain_of(row: Any, run: Any) -> float:
    """Velocities of the interface dofs per solution with the operator of the march."""
    return float(1.0 / run.dt if row.kind == STATIC else run.interface_gain * run.traction_weight)


@kernel
def forward(pools: Any, c: int) -> None:
    """Forward substitution of the load: its interior part stays in ``half_solution`` (in tiles from TILED members on),
    the interface part, where it is kept for last, goes to ``inner``."""
    row, work = pools.classes[c], pools.moving
    n = row.n
    m = row.m
    n_interior = row.n_interior
    order = pools.fixed_int[row.order : row.order + n]
    load, inner = work[row.load : row.load + n * m], work[row.inner : row.inner + row.n_inner * m]
    x = work[row.half_solution : row.half_solution + n * tile_width(m)]
    modal = work[row.modal : row.modal + row.n_modal * m]
    for p in range(row.n_modal):
        inside = pools.fixed[row.modal_inside + p * n : row.modal_inside + (p + 1) * n]
        for j in range(m):
            total = 0.0
            for i in range(n):
                total += inside[i] * load[i * m + j]
            modal[p * m + j] = total
    if m >= TILED:  # lanes without a member
        x[:] = 0.0
    alone = m == 1  # without a loop over the members, as most classes are
    for i in range(n):
        if alone:
            x[i] = load[order[i]]
            continue
        for j in range(m):
            x[place_of(n, m, i, j)] = load[order[i] * m + j]
    substitute(pools, c, row.half_solution, on_springs(pools, c), False, True)
    for i in range(n - n_interior):
        if alone:
            inner[i] = x[n_interior + i]
            continue
        for j in range(m):
            inner[i * m + j] = x[place_of(n, m, n_interior + i, j)]
    for p in range(row.n_modal):
        edge = pools.fixed[row.modal_edge + p * row.n_inner : row.modal_edge + (p + 1) * row.n_inner]
        for i in range(row.n_inner):
            for j in range(m):
                inner[i * m + j] -= edge[i] * modal[p * m + j]


@kernel
def backward(pools: Any, c: int) -> None:
    """Full solution in ``load`` from ``half_solution`` and, where the interface dofs are kept for last, their values in
    ``inner_answer``."""
    row, work = pools.classes[c], pools.moving
    n = row.n
    m = row.m
    n_interior = row.n_interior
    order = pools.fixed_int[row.order : row.order + n]
    out, last = work[row.load : row.load + n * m], work[row.inner_answer : row.inner_answer + row.n_inner * m]
    at = row.half_solution
    x = work[at : at + n * tile_width(m)]
    if row.sparse == 1:  # the half solution is needed again where the instant goes on
        half, at = x, row.face_vector
        x = work[at : at + n * tile_width(m)]
        for i in range(len(x)):
            x[i] = half[i]
    alone = m == 1
    for i in range(n - n_interior):
        if alone:
            x[n_interior + i] = last[i]
            continue
        for j in range(m):
            x[place_of(n, m, n_interior + i, j)] = last[i * m + j]
    substitute(pools, c, at, on_springs(pools, c), True, True)
    for i in range(n):
        if alone:
            out[order[i]] = x[i]
            continue
        for j in range(m):
            out[order[i] * m + j] = x[place_of(n, m, i, j)]
    modal = work[row.modal : row.modal + row.n_modal * m]
    for p in range(row.n_modal):
        inside = pools.fixed[row.modal_inside + p * n : row.modal_inside + (p + 1) * n]
        edge = pools.fixed[row.modal_edge + p * row.n_inner : row.modal_edge + (p + 1) * row.n_inner]
        for j in range(m):
            weight = modal[p * m + j]
            for i in range(row.n_inner):
                weight += edge[i] * last[i * m + j]
            for i in range(n):
                out[i * m + j] -= inside[i] * weight


@kernel
def to_face(pools: Any, c: int, values: Array) -> None:
    """Values (g, m) on the interface dofs, zero elsewhere, into ``face_vector`` in elimination order."""
    row, work = pools.classes[c], pools.moving
    n, m = row.n, row.m
    face = pools.fixed_int[row.face : row.face + row.n_inner]
    x = work[row.face_vector : row.face_vector + n * tile_width(m)]
    x[:] = 0.0
    for i in range(row.n_inner):
        for j in range(m):
            x[place_of(n, m, face[i], j)] = values[i * m + j]


@kernel
def from_face(pools: Any, c: int, values: Array) -> None:
    """Values (g, m) on the interface dofs from ``face_vector``."""
    row = pools.classes[c]
    n, m = row.n, row.m
    face = pools.fixed_int[row.face : row.face + row.n_inner]
    x = pools.moving[row.face_vector : row.face_vector + n * tile_width(m)]
    for i in range(row.n_inner):
        for j in range(m):
            values[i * m + j] = x[place_of(n, m, face[i], j)]


@kernel
def refers(pools: Any, c: int) -> bool:
    """Whether tractions close to those of the instant are among the loads of a class with inertia: those of the last
    one where steps are short, or where Y is float32; in long steps otherwise only where some are expected."""
    run = pools.run[0]
    if run.referenced < 2:
        return bool(run.referenced == 1)
    return bool(pools.classes[c].halved == 1 or (run.expects == 1 and 0.0 < pools.moving[run.misfit] < 1.0))


@kernel
def add_reference(pools: Any, c: int) -> None:
    """Add the tractions of the last instant, or those that are expected (``prediction``), as the reference of the new
    ones, to the load of a class; none where it rests, and without inertia."""
    row = pools.classes[c]
    run = pools.run[0]
    work = pools.moving
    m = row.m
    n_inner = row.n_inner
    size = row.n_channel * row.m
    reference, nodal = work[row.reference : row.reference + size], work[row.channel : row.channel + size]
    inner, load = work[row.inner : row.inner + n_inner * m], work[row.load : row.load + row.n * m]
    # 0 where nothing is added
    reference[:] = 0.0
    if not refers(pools, c) or work[row.passed] == 1.0 or row.kind == STATIC:
        return
    channels = pools.fixed_int[row.channels : row.channels + size]
    area, dofs = pools.fixed[row.area : row.area + row.n_channel], pools.fixed_int[row.dofs : row.dofs + n_inner]
    f_hat, weight = work[run.f_hat : run.f_hat + run.n_flat], run.traction_weight
    for i in range(row.n_channel):
        for j in range(m):
            at = i * m + j
            reference[at] = f_hat[channels[at]]
            if run.expects == 1:
                reference[at] += work[run.ahead + channels[at]]
            nodal[at] = weight * area[i] * reference[at]
    inner[:] = 0.0
    add_spread(pools, c, nodal, inner)
    for i in range(n_inner):
        for j in range(m):
            load[dofs[i] * m + j] += inner[i * m + j]


@kernel
def face_response(pools: Any, c: int, with_k: bool, force: Array, answer: Array) -> None:
    """Add the channel values of the solution with forces (c, m) on the channels to ``answer`` (c, m), by substitution
    on the face; ``with_k`` as for ``substitute``."""
    row = pools.classes[c]
    inner = pools.moving[row.inner : row.inner + row.n_inner * row.m]
    inner[:] = 0.0
    add_spread(pools, c, force, inner)
    # L^-1, then L^-T, on the rows and columns of the face alone
    to_face(pools, c, inner)
    substitute(pools, c, row.face_vector, with_k, False, False)
    substitute(pools, c, row.face_vector, with_k, True, False)
    from_face(pools, c, inner)
    add_trace(pools, c, inner, answer, False)


@kernel
def swept_response(pools: Any, c: int, incoming: Array, w: Array) -> None:
    """Add Y times the nodal forces ``incoming`` (c, m) on the channels of a swept class to its W, (N,), by substitution
    on the face with the factor that has the dashpots k on the interfaces, or by the table of Y."""
    row, work = pools.classes[c], pools.moving
    size = row.n_channel * row.m
    channels, answer = pools.fixed_int[row.channels : row.channels + size], work[row.answer : row.answer + size]
    gain = gain_of(row, pools.run[0])
    for at in range(size):
        incoming[at] *= gain
        answer[at] = 0.0
    if row.sparse == 1:
        add_response(pools, c, incoming, answer)
    else:
        face_response(pools, c, True, incoming, answer)
    for at in range(size):
        w[channels[at]] += answer[at]


@kernel
def add_on_face(pools: Any, c: int, forces: Array) -> None:
    """Add the forward substitution of forces (g, m) on the interface dofs to ``half_solution``."""
    row, work = pools.classes[c], pools.moving
    to_face(pools, c, forces)
    substitute(pools, c, row.face_vector, on_springs(pools, c), False, False)
    size = row.n * tile_width(row.m)
    half, vector = work[row.half_solution : row.half_solution + size], work[row.face_vector : row.face_vector + size]
    for i in range(size):
        half[i] += vector[i]


@kernel
def forward_on_face(pools: Any, c: int, four: bool, x: Array, tail: Array) -> None:
    """Forward substitution of a tile, or of ``four`` vectors, on the face with the factor without dashpots."""
    row, numbers = pools.classes[c], pools.fixed_int
    n_super = row.n_super
    first = numbers[row.first : row.first + n_super + 1]
    row_start = numbers[row.row_start : row.row_start + n_super + 1]
    panel_start = numbers[row.panel_start : row.panel_start + n_super + 1]
    face_start, rows = numbers[row.face_start : row.face_start + n_super], numbers[row.rows : row.rows + row.n_rows]
    single = pools.fixed_single[row.panels : row.panels + (row.n_panels if row.single == 1 else 0)]
    panels = pools.fixed[row.panels : row.panels + (0 if row.single == 1 else row.n_panels)]
    if row.single == 1 and four:
        forward_four(first, row_start, rows, panel_start, face_start, single, x)
    elif row.single == 1:
        forward_tile(False, first, row_start, rows, panel_start, face_start, single, x, tail)
    elif four:
        forward_four(first, row_start, rows, panel_start, face_start, panels, x)
    else:
        forward_tile(False, first, row_start, rows, panel_start, face_start, panels, x, tail)
