"""Half solves of a class given by its table row; see ``propagator.cholesky.sweeps``."""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import NDArray

from ..propagator.cholesky.sweeps import backward_many, backward_one, forward_many, forward_one
from .views import floats, integers, kernel, singles, table_of_floats, table_of_singles

Array = NDArray[np.float64]


@kernel
def forward(row: Any, load: Array) -> None:
    """Half solve of ``load`` (n m,): the inside stays in ``sweep``, the interface part goes to ``inner``."""
    n, m, n_interior, n_inner = row.n, row.m, row.n_interior, row.n_inner
    first, row_start = integers(row.first, row.n_super + 1), integers(row.row_start, row.n_super + 1)
    rows, panel_start = integers(row.rows, row.n_rows), integers(row.panel_start, row.n_super + 1)
    order, inner = integers(row.order, n), floats(row.inner, n_inner * m)
    grouped = row.grouped == 1
    if m == 1:
        x = floats(row.sweep, n)
        if row.single == 1:
            short = singles(row.panels, row.n_panels)
            forward_one(grouped, first, row_start, rows, panel_start, short, order, load, x)
        else:
            panels = floats(row.panels, row.n_panels)
            forward_one(grouped, first, row_start, rows, panel_start, panels, order, load, x)
        for i in range(n_inner):
            inner[i] = x[n_interior + i]
        return
    b, routine = load.reshape(n, m), integers(row.routines, 6)
    if row.single == 1:
        short, y = singles(row.panels, row.n_panels), table_of_singles(row.sweep, n, m)
        room = table_of_singles(row.below, row.tallest + 1, m)
        forward_many(routine, np.float32(1.0), first, row_start, rows, panel_start, short, order, b, y, room)
        for i in range(n_inner):
            for j in range(m):
                inner[i * m + j] = y[n_interior + i, j]
    else:
        panels, z = floats(row.panels, row.n_panels), table_of_floats(row.sweep, n, m)
        space = table_of_floats(row.below, row.tallest + 1, m)
        forward_many(routine, 1.0, first, row_start, rows, panel_start, panels, order, b, z, space)
        for i in range(n_inner):
            for j in range(m):
                inner[i * m + j] = z[n_interior + i, j]


@kernel
def backward(row: Any, last: Array, out: Array) -> None:
    """Full solution (n m,) from ``sweep`` and the interface values ``last`` (n_inner m,)."""
    n, m, n_interior, n_inner = row.n, row.m, row.n_interior, row.n_inner
    first, row_start = integers(row.first, row.n_super + 1), integers(row.row_start, row.n_super + 1)
    rows, panel_start = integers(row.rows, row.n_rows), integers(row.panel_start, row.n_super + 1)
    order = integers(row.order, n)
    grouped = row.grouped == 1
    if m == 1:
        x = floats(row.sweep, n)
        y = x[:n_interior]
        if row.single == 1:
            short = singles(row.panels, row.n_panels)
            backward_one(grouped, first, row_start, rows, panel_start, short, order, y, last, x, out)
        else:
            panels = floats(row.panels, row.n_panels)
            backward_one(grouped, first, row_start, rows, panel_start, panels, order, y, last, x, out)
        return
    x_last, found, routine = last.reshape(n_inner, m), out.reshape(n, m), integers(row.routines, 6)
    if row.single == 1:
        short, t = singles(row.panels, row.n_panels), table_of_singles(row.sweep, n, m)
        room = table_of_singles(row.below, row.tallest + 1, m)
        backward_many(
            routine, np.float32(1.0), first, row_start, rows, panel_start, short, order,
            t[:n_interior], x_last, t, room, found,
        )  # fmt: skip
    else:
        panels, z = floats(row.panels, row.n_panels), table_of_floats(row.sweep, n, m)
        space = table_of_floats(row.below, row.tallest + 1, m)
        backward_many(
            routine, 1.0, first, row_start, rows, panel_start, panels, order,
            z[:n_interior], x_last, z, space, found,
        )  # fmt: skip
