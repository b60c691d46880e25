"""Half solves of a class given by its table row; see ``propagator.cholesky.sweeps``."""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import NDArray

from ..compiled import kernel
from ..propagator.cholesky.sweeps import backward_many, backward_one, forward_many, forward_one
from .lanes import LANES, SPARE, TILED, backward_tile, forward_tile, gather
from .views import floats, integers, table_of_floats

Array = NDArray[np.float64]


@kernel
def forward(row: Any, load: Array) -> None:
    """Half solve of ``load`` (n m,): the inside stays in ``sweep`` (in tiles, see ``lanes``, from three members on),
    the interface part goes to ``inner``."""
    n, m, n_interior, n_inner = row.n, row.m, row.n_interior, row.n_inner
    first, row_start = integers(row.first, row.n_super + 1), integers(row.row_start, row.n_super + 1)
    rows, panel_start = integers(row.rows, row.n_rows), integers(row.panel_start, row.n_super + 1)
    order, panels = integers(row.order, n), floats(row.panels, row.n_panels)
    inner, last = floats(row.inner, n_inner * m), floats(row.sweep, n * m)
    if m >= TILED:
        spare = floats(row.tile, SPARE * LANES)
        for start in range(0, m, LANES):
            x = floats(row.sweep + 8 * n * start, n * LANES)
            gather(n, m, start, order, load, x)
            forward_tile(first, row_start, rows, panel_start, row.panels, x, spare)
            lanes = min(m - start, LANES)
            for i in range(n_inner):
                for j in range(lanes):
                    inner[i * m + start + j] = x[(n_interior + i) * LANES + j]
        return
    if m == 1:
        forward_one(row.grouped == 1, first, row_start, rows, panel_start, panels, order, load, last)
    else:
        x, space = table_of_floats(row.sweep, n, m), table_of_floats(row.below, row.tallest + 1, m)
        routine = integers(row.routines, 6)
        forward_many(
            routine, 1.0, first, row_start, rows, panel_start, panels, order, load.reshape(n, m), x, space
        )
    for i in range(n_inner * m):
        inner[i] = last[n_interior * m + i]


@kernel
def backward(row: Any, last: Array, out: Array) -> None:
    """Full solution (n m,) from ``sweep`` and the interface values ``last`` (n_inner m,)."""
    n, m, n_interior, n_inner = row.n, row.m, row.n_interior, row.n_inner
    first, row_start = integers(row.first, row.n_super + 1), integers(row.row_start, row.n_super + 1)
    rows, panel_start = integers(row.rows, row.n_rows), integers(row.panel_start, row.n_super + 1)
    order, panels = integers(row.order, n), floats(row.panels, row.n_panels)
    if m >= TILED:
        spare = floats(row.tile, SPARE * LANES)
        for start in range(0, m, LANES):
            x = floats(row.sweep + 8 * n * start, n * LANES)
            lanes = min(m - start, LANES)
            for i in range(n_inner):
                for j in range(lanes):
                    x[(n_interior + i) * LANES + j] = last[i * m + start + j]
            backward_tile(first, row_start, rows, panel_start, row.panels, x, spare)
            for i in range(n):
                for j in range(lanes):
                    out[order[i] * m + start + j] = x[i * LANES + j]
        return
    if m == 1:
        x = floats(row.sweep, n)
        backward_one(
            row.grouped == 1, first, row_start, rows, panel_start, panels, order, x[:n_interior], last, x, out
        )
    else:
        z, space = table_of_floats(row.sweep, n, m), table_of_floats(row.below, row.tallest + 1, m)
        routine = integers(row.routines, 6)
        backward_many(
            routine, 1.0, first, row_start, rows, panel_start, panels, order,
            z[:n_interior], last.reshape(n_inner, m), z, space, out.reshape(n, m),
        )  # fmt: skip
