"""Large parts of an assembly shared by threads: the factor in pieces, products in parts of the rows.

The supernodes of a large factor are cut into pieces along the elimination tree (``cholesky.pieces``): below the last
separators two pieces that are coupled by these alone, and in each of them two again. Pieces of one level are
independent of each other. A forward substitution sums what a piece adds to the rows behind it in a vector of the piece
(``slot``), which the piece above takes over; the first of two pieces shares the vector of that one. A backward
substitution goes the other way and needs no vectors.

A product with half of a symmetric matrix writes to rows before its own: each part of the rows has a vector for those.

Pieces and parts, and the order of their sums, belong to the class, not to the threads: the same numbers result to the
last bit with any number of threads, one included.
"""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import NDArray

from ..cholesky.substitution import (
    CHILDREN,
    CLEARED,
    FRONT,
    LANES,
    RANGES,
    SLOT,
    SPARE,
    STRIDE,
    TILED,
    backward_one,
    backward_tile,
    forward_one,
    forward_tile,
)
from ..compiled import kernel
from .products import dense_tile, gather, half_product, packed_product, product, sparse_rows
from .team import PARTS, claimed, close_region, end_task, open_region, place_in

Array = NDArray[np.float64]

MASS, STIFFNESS, DAMPING, DASHPOTS, LANDING, UNRELAXED, GEOMETRIC = range(7)
"""Matrices of ``add_product``."""
FORWARD, BACKWARD, VECTORS, PRODUCT, DENSE = range(100, 105)
"""Actions of ``leaf``."""
MOST = 1 << 20
"""More than the members of a class, twice."""


@kernel
def leaf(pools: Any, action: int, t: int, c: int, a: int, b: int, d: int, factor: float) -> None:
    """Task t of an action on the class c.

    FORWARD, BACKWARD: the piece a + t of a substitution of the vector at b. VECTORS: a substitution of the t-th vector
    or tile from b on. PRODUCT: part t of the product of the matrix a with the vectors at b, added to those at d; DENSE:
    the t-th vector or tile of a product of a dense matrix.
    """
    if action == FORWARD:
        # d: 4 for ``with_k``, 2 for ``backwards``, 1 for ``whole``
        _forward_piece(pools, c, a + t, t, b, d // 4 == 1, d % 2 == 1)
    elif action == BACKWARD:
        _backward_piece(pools, c, a + t, t, b, d // 4 == 1, d % 2 == 1)
    elif action == VECTORS:
        row = pools.classes[c]
        vector = b + row.n * t * (1 if row.m < TILED else LANES)
        sweep(pools, c, vector, 0, row.n_super, tile_at(row, t), d // 4 == 1, d // 2 % 2 == 1, d % 2 == 1)
    elif action == PRODUCT:
        _product_part(pools, c, t, a, b, d, factor)
    elif action == DENSE:
        _dense_part(pools, c, t, a, b, d, int(factor))


@kernel
def each_leaf(pools: Any, n: int, action: int, c: int, a: int, b: int, d: int, factor: float) -> None:
    """Do the tasks of an action, by the threads of the run where they share the class."""
    # one task, or nobody to share it with
    if pools.run[0].threads <= 1 or pools.classes[c].split == 0 or n == 1:
        for t in range(n):
            leaf(pools, action, t, c, a, b, d, factor)
        return
    ticket = open_region(pools, n, action, c, a, b, d, factor)
    t = claimed(pools, ticket, n, 0, 0)
    while t < n:
        leaf(pools, action, t, c, a, b, d, factor)
        end_task(pools)
        t = claimed(pools, ticket, n, 0, t + 1)
    close_region(pools)


# -- substitutions --------------------------------------------------------------------------------------------------
@kernel
def sweep(
    pools: Any, c: int, at: int, low: int, high: int, tile: int, with_k: bool, backwards: bool, whole: bool
) -> None:
    """Forward or backward substitution through the supernodes from ``low`` to ``high``, in place, of one vector or tile
    at ``at``; ``tile`` : place of scratch."""
    row = pools.classes[c]
    work = pools.moving
    numbers = pools.fixed_int
    n = row.n
    first = numbers[row.first + low : row.first + high + 1]
    row_start = numbers[row.row_start + low : row.row_start + high + 1]
    panel_start = numbers[row.panel_start + low : row.panel_start + high + 1]
    begin = row.face_start + low if row.swept == 1 else 0  # columns for the face: swept classes alone
    face_start = numbers[begin : begin + (high - low if row.swept == 1 else 0)]
    rows = numbers[row.rows : row.rows + row.n_rows]
    halved = row.single == 1 or (with_k and row.single == 2)
    panels_at = row.k_panels if with_k else row.panels
    panels = pools.fixed[panels_at : panels_at + (0 if halved else row.n_panels)]
    single = pools.fixed_single[panels_at : panels_at + (row.n_panels if halved else 0)]
    ways = row.m, row.grouped == 1, whole, backwards
    x, tail = work[at : at + n * (1 if row.m < TILED else LANES)], work[tile : tile + SPARE * LANES]
    if halved:
        _through_panels(ways, first, row_start, rows, panel_start, face_start, single, x, tail)
    else:
        _through_panels(ways, first, row_start, rows, panel_start, face_start, panels, x, tail)


@kernel
def _through_panels(
    ways: Any,
    first: Any,
    row_start: Any,
    rows: Any,
    panel_start: Any,
    face_start: Any,
    panels: Any,
    x: Array,
    tail: Array,
) -> None:
    """``sweep`` with panels in one precision; ``ways`` : members, four rows at a time, whole, backwards."""
    m, grouped, whole, backwards = ways
    if m < TILED and backwards:
        backward_one(grouped, whole, first, row_start, rows, panel_start, face_start, panels, x)
    elif m < TILED:
        forward_one(grouped, whole, first, row_start, rows, panel_start, face_start, panels, x)
    elif backwards:
        backward_tile(whole, first, row_start, rows, panel_start, face_start, panels, x, tail)
    else:
        forward_tile(whole, first, row_start, rows, panel_start, face_start, panels, x, tail)


@kernel
def substitute(pools: Any, c: int, at: int, with_k: bool, backwards: bool, whole: bool) -> None:
    """Forward or backward substitution of the vectors of all members in elimination order, in place: from ``at`` on,
    one after the other or in tiles from TILED members on. ``with_k``: with the factor that has the dashpots k. Not
    ``whole``: for the face alone."""
    row = pools.classes[c]
    n = row.n
    m = row.m
    levels = row.n_level
    width = 1 if m < TILED else LANES
    # three flags in one number, as a task has so many arguments
    ways = 4 * (1 if with_k else 0) + 2 * (1 if backwards else 0) + (1 if whole else 0)
    if row.n_piece == 0:
        each_leaf(pools, tiles(m), VECTORS, c, 0, at, ways, 0.0)
    for start in range(0, m, width):
        vector = at + n * start
        # forward from the leaves of the tree, backward from its root
        for i in range(levels):
            level = levels - 1 - i if backwards else i
            begin = pools.fixed_int[row.pieces + level]
            count = pools.fixed_int[row.pieces + level + 1] - begin
            each_leaf(pools, count, BACKWARD if backwards else FORWARD, c, begin, vector, ways, 0.0)


@kernel
def _list(pools: Any, c: int, p: int, which: int) -> Any:
    """A list of the piece p: ``RANGES``, ``CLEARED``, ``CHILDREN`` or ``FRONT``."""
    row, numbers = pools.classes[c], pools.fixed_int
    at = row.pieces + row.n_level + 1 + STRIDE * p + which
    first = row.pieces + numbers[at]
    return numbers[first : first + numbers[at + 1]]


@kernel
def _vector_of(pools: Any, c: int, p: int, at: int) -> int:
    """Place of the vector that the piece p sums in, for a substitution of the vector at ``at``."""
    row = pools.classes[c]
    slot = pools.fixed_int[row.pieces + row.n_level + 1 + STRIDE * p + SLOT]
    if slot == 0:
        return at
    return int(row.piece_work + (slot - 1) * row.n * (1 if row.m < TILED else LANES))


@kernel
def _forward_piece(pools: Any, c: int, p: int, t: int, at: int, with_k: bool, whole: bool) -> None:
    """Forward substitution through the piece p, task t of its level."""
    row, work = pools.classes[c], pools.moving
    width, into = 1 if row.m < TILED else LANES, _vector_of(pools, c, p, at)
    cleared = _list(pools, c, p, CLEARED)
    children = _list(pools, c, p, CHILDREN)
    ranges = _list(pools, c, p, RANGES)
    for e in range(len(cleared)):
        line = work[into + cleared[e] * width : into + (cleared[e] + 1) * width]
        line[:] = 0.0
    for e in range(len(children)):
        front, source = _list(pools, c, children[e], FRONT), _vector_of(pools, c, children[e], at)
        if source != into:  # the first child sums in the vector of its parent
            for i in range(len(front)):
                for j in range(front[i] * width, (front[i] + 1) * width):
                    work[into + j] += work[source + j]
    for e in range(0, len(ranges), 2):
        low, high = ranges[e], ranges[e + 1]
        begin, end = pools.fixed_int[row.first + low] * width, pools.fixed_int[row.first + high] * width
        sums, vector = work[into + begin : into + end], work[at + begin : at + end]
        # what the children left is there, and the right-hand side is added; a leaf begins with the latter
        if into != at and len(children) > 0:
            for i in range(len(sums)):
                sums[i] += vector[i]
        elif into != at:
            for i in range(len(sums)):
                sums[i] = vector[i]
        sweep(pools, c, into, low, high, row.piece_tile + t * SPARE * LANES, with_k, False, whole)
        if into != at:  # the solution belongs to the vector itself
            for i in range(len(sums)):
                vector[i] = sums[i]


@kernel
def _backward_piece(pools: Any, c: int, p: int, t: int, at: int, with_k: bool, whole: bool) -> None:
    """Backward substitution through the piece p, task t of its level."""
    row, ranges = pools.classes[c], _list(pools, c, p, RANGES)
    # the last range first, against the order of elimination
    for e in range(len(ranges) - 2, -1, -2):
        tile = row.piece_tile + t * SPARE * LANES
        sweep(pools, c, at, ranges[e], ranges[e + 1], tile, with_k, True, whole)


# -- products ---------------------------------------------------------------------------------------------------------
@kernel
def _part(row: Any, which: int) -> tuple[int, int, int, int, int, int, int]:
    """Rows and places likewise (``_matrix``) of a part of C or K."""
    if which == LANDING:
        return (
            row.landing_rows,
            row.landing_starts,
            row.landing_columns,
            row.landing_values,
            row.landing_diagonal,
            row.landing_together,
            row.landing_parts,
        )
    if which == UNRELAXED:
        return (
            row.unrelaxed_rows,
            row.unrelaxed_starts,
            row.unrelaxed_columns,
            row.unrelaxed_values,
            row.unrelaxed_diagonal,
            row.unrelaxed_together,
            row.unrelaxed_parts,
        )
    return (
        row.geometric_rows,
        row.geometric_starts,
        row.geometric_columns,
        row.geometric_values,
        row.geometric_diagonal,
        row.geometric_together,
        row.geometric_parts,
    )


@kernel
def _matrix(row: Any, which: int) -> tuple[int, int, int, int, int, int, int]:
    """Rows of a matrix of a class; places of its starts, columns, values, diagonal, rows together and parts."""
    if which == STIFFNESS:
        return (
            row.stiffness_rows,
            row.stiffness_starts,
            row.stiffness_columns,
            row.stiffness_values,
            row.stiffness_diagonal,
            row.stiffness_together,
            row.stiffness_parts,
        )
    if which == DAMPING:
        return (
            row.damping_rows,
            row.damping_starts,
            row.damping_columns,
            row.damping_values,
            row.damping_diagonal,
            row.damping_together,
            row.damping_parts,
        )
    if which == DASHPOTS:
        return (
            row.dashpots_rows,
            row.dashpots_starts,
            row.dashpots_columns,
            row.dashpots_values,
            row.dashpots_diagonal,
            row.dashpots_together,
            row.dashpots_parts,
        )
    if which != MASS:
        return _part(row, which)
    return (
        row.mass_rows,
        row.mass_starts,
        row.mass_columns,
        row.mass_values,
        row.mass_diagonal,
        row.mass_together,
        row.mass_parts,
    )


@kernel
def tiles(m: int) -> int:
    """Vectors or tiles of m members."""
    return m if m < TILED else (m + LANES - 1) // LANES


@kernel
def tile_at(row: Any, t: int) -> int:
    """Place of the scratch of the t-th vector or tile."""
    return int(row.tile + t * (max(row.n, row.n_channel) + SPARE) * LANES)


@kernel
def tile_of(row: Any, work: Array) -> Array:
    """Scratch of the products with tiles."""
    return work[row.tile : row.tile + (max(row.n, row.n_channel) + SPARE) * LANES]


@kernel
def add_squares(pools: Any, c: int, rows: int, count: int, factor: float, x: Array, out: Array) -> None:
    """out += factor R^T R x for ``count`` rows R from the place ``rows`` on: modal damping.

    Of one member four rows at a time, so that x and out are read once for them."""
    row = pools.classes[c]
    n = row.n
    m = row.m
    begun = count - count % 4 if row.m == 1 else 0
    for p in range(0, begun, 4):
        first, second = pools.fixed[rows + p * n : rows + (p + 1) * n], pools.fixed[rows + (p + 1) * n :]
        third, fourth = pools.fixed[rows + (p + 2) * n :], pools.fixed[rows + (p + 3) * n :]
        t0 = t1 = t2 = t3 = 0.0
        for i in range(n):
            value = x[i]
            t0 += first[i] * value
            t1 += second[i] * value
            t2 += third[i] * value
            t3 += fourth[i] * value
        t0 = factor * t0
        t1 = factor * t1
        t2 = factor * t2
        t3 = factor * t3
        for i in range(n):
            out[i] += (t0 * first[i] + t1 * second[i]) + (t2 * third[i] + t3 * fourth[i])
    for p in range(begun, count):
        line = pools.fixed[rows + p * n : rows + (p + 1) * n]
        for j in range(m):
            rate = 0.0
            for i in range(n):
                rate += line[i] * x[i * m + j]
            rate *= factor
            for i in range(n):
                out[i * m + j] += line[i] * rate


@kernel
def add_product(pools: Any, c: int, which: int, factor: float, x: Array, out: Array) -> None:
    """out += factor A x for A = M, K, C or a part of these (``MASS`` ...), without the stiffness of a face (``face``);
    nothing where the class has none."""
    row, work = pools.classes[c], pools.moving
    if which == DAMPING:
        add_squares(pools, c, row.viscous_rows, row.n_viscous, factor, x, out)
    n, starts_at, columns_at, values_at, diagonal_at, together_at, parts_at = _matrix(row, which)
    if n == 0:
        return
    if row.n_piece == 0 and row.m == 1:
        starts = pools.fixed_int[starts_at : starts_at + n + 1]
        columns = pools.fixed_col[columns_at : columns_at + starts[n]]
        values, diagonal = pools.fixed[values_at : values_at + starts[n]], pools.fixed[diagonal_at : diagonal_at + n]
        together = pools.fixed_col[together_at : together_at + n]
        half_product(0, n, diagonal, together, starts, columns, values, factor, x, out)
        return
    # places instead of arrays: tasks of other threads have numbers for arguments
    source = place_in(work, x)
    into = place_in(work, out)
    m = row.m
    if m > 1 and row.n_piece == 0:
        each_leaf(pools, tiles(m), PRODUCT, c, which, source, into, factor)
        return
    if m >= TILED:
        for first in range(0, m, LANES):
            gather(n, m, first, x, tile_of(row, work))
            each_leaf(pools, PARTS, PRODUCT, c, which, first, into, factor)
        return
    each_leaf(pools, PARTS if m == 1 else m, PRODUCT, c, which, source, into, factor)
    parts = pools.fixed_int[parts_at : parts_at + 3 * PARTS]
    # in the order of the parts, whichever thread made them
    for t in range(1, PARTS if m == 1 else 0):
        part = work[row.piece_work + (t - 1) * n : row.piece_work + t * n]
        for i in range(parts[3 * t + 2], parts[3 * t + 1]):
            out[i] += part[i]


@kernel
def _product_part(pools: Any, c: int, t: int, which: int, source: int, into: int, factor: float) -> None:
    """Part t of ``add_product``: the t-th of two members or of the tiles; with pieces, rows of the matrix, for the tile
    that begins with the member ``source`` from TILED members on."""
    row, work = pools.classes[c], pools.moving
    n, starts_at, columns_at, values_at, diagonal_at, together_at, parts_at = _matrix(row, which)
    m, starts = row.m, pools.fixed_int[starts_at : starts_at + n + 1]
    columns = pools.fixed_col[columns_at : columns_at + starts[n]]
    values, diagonal = pools.fixed[values_at : values_at + starts[n]], pools.fixed[diagonal_at : diagonal_at + n]
    if m == 2:  # two members: each a vector of its own
        x, out = work[source : source + 2 * n], work[into : into + 2 * n]
        tile = tile_at(row, t)
        member, total = work[tile : tile + n], work[tile + n : tile + 2 * n]
        # one member out of rows of two, side by side in memory
        for i in range(n):
            member[i], total[i] = x[2 * i + t], 0.0
        together = pools.fixed_col[together_at : together_at + n]
        half_product(0, n, diagonal, together, starts, columns, values, factor, member, total)
        for i in range(n):
            out[2 * i + t] += total[i]
        return
    if row.n_piece == 0:
        tile = work[tile_at(row, t) : tile_at(row, t) + (n + 1) * LANES]
        gather(n, m, t * LANES, work[source : source + n * m], tile)
        line, out = tile[n * LANES : (n + 1) * LANES], work[into : into + n * m]
        sparse_rows(0, n, starts, columns, values, factor, m, t * LANES, tile, out, line)
        return
    low = pools.fixed_int[parts_at + 3 * t]
    high = pools.fixed_int[parts_at + 3 * t + 1]
    least = pools.fixed_int[parts_at + 3 * t + 2]
    if m == 1:
        at = into if t == 0 else row.piece_work + (t - 1) * n
        out = work[at : at + n]
        # the part writes to no row before ``least``
        if t > 0:
            out[least:high] = 0.0
        together = pools.fixed_col[together_at : together_at + n]
        half_product(low, high, diagonal, together, starts, columns, values, factor, work[source : source + n], out)
        return
    spare = work[row.piece_tile + t * LANES : row.piece_tile + (t + 1) * LANES]
    out = work[into : into + n * m]
    sparse_rows(low, high, starts, columns, values, factor, m, source, tile_of(row, work), out, spare)


@kernel
def dense(pools: Any, c: int, n: int, matrix: Array, plain: int, m: int, x: Array, out: Array) -> None:
    """out (n m,) = A x for a symmetric dense A of a class, kept as ``symmetric_size`` says."""
    if plain == 1 or m == 1:
        product(n, matrix, plain, m, x, out, tile_of(pools.classes[c], pools.moving))
        return
    table = place_in(pools.fixed, matrix)
    # two sizes in the one real argument: whole numbers below 2^53 are exact
    each_leaf(
        pools, tiles(m), DENSE, c, table, place_in(pools.moving, x), place_in(pools.moving, out), 1.0 * (m + n * MOST)
    )


@kernel
def _dense_part(pools: Any, c: int, t: int, table: int, source: int, into: int, sizes: int) -> None:
    """The t-th vector or tile of ``dense``; ``sizes`` : m + n MOST."""
    row = pools.classes[c]
    work = pools.moving
    n = sizes // MOST
    m = sizes % MOST
    at = tile_at(row, t)
    x = work[source : source + n * m]
    out = work[into : into + n * m]
    if m >= TILED:
        matrix = pools.fixed[table : table + n * n]
        dense_tile(n, matrix, m, t * LANES, x, out, work[at : at + (n + SPARE) * LANES])
        return
    member, total = work[at : at + n], work[at + n : at + 2 * n]
    for i in range(n):
        member[i] = x[i * m + t]
    packed_product(n, pools.fixed[table : table + n * (n + 1) // 2], member, total)
    for i in range(n):
        out[i * m + t] = total[i]
