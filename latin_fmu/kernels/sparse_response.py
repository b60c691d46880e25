"""Large interfaces by sparse tables in place of substitutions; the error that this leaves in an instant.

Within one step a force reaches the points around it only. What is left of a compliance beyond that distance is dropped,
and the product with it reads some dozens of 3 x 3 blocks per point (``propagator.interface_probing``). A class has up
to three tables: of Y, for the linear stage, and of C between normal and between tangential channels, for the norms of
the force residual.

With the tractions F_0 of the last instant as reference, under which the velocities W_0 of the channels are exact,

    W = W_0 + Y area (q - q_0),    q_0 = F_0 + k W_0,

the dropped part of Y acts on the change within an instant alone. The instant ends with the tractions of the local stage
(``substructure.solve_under_tractions``), whose exact velocities W_A follow from the solution of all dofs: what they
leave of the laws of the interfaces, W_A - W_hat, is the ``defect``. Where it exceeds the tolerance, these tractions and
velocities become the reference, and the iteration goes on: every such correction multiplies the defect by about
|Y - Y_table| k, down to the exact solution.
"""

from __future__ import annotations

from typing import Any, Final

import numpy as np
from numpy.typing import NDArray

from ..compiled import entry, kernel

Array = NDArray[np.float64]
Field = tuple[str, str]

_TABLE: Final = (
    ("{0}_points", "points of the table of {1}, 0 where there is none"),
    ("{0}_width", "components per point h"),
    ("{0}_places", "direction, int64 (points, h): channel of each component, -1 where there is none"),
    ("{0}_starts", "direction, int64 (points + 1,): first run of each point"),
    ("{0}_runs", "direction, int64 (runs, 2): first of its successive components, and their number"),
    ("{0}_values", "direction, float32: entries (h, number) run after run, m s-1 N-1 over the gain of the scheme"),
    ("{0}_entries", "their number"),
)
_OF: Final = (("y", "Y"), ("normal", "C between normal channels"), ("tangential", "C between tangential channels"))
TABLES: Final = tuple(name for name, _ in _OF)
"""Tables of a class, the first part of the names of their fields."""
CLASS_FIELDS: Final[tuple[Field, ...]] = (
    *((key.format(name), text.format(name, what)) for name, what in _OF for key, text in _TABLE),
    ("sparse", "1 where the linear stage takes the table of Y"),
    ("ended", "work (1,) if swept: 1 where ``load`` holds the solution under ``reference`` at the end of the instant"),
    ("point_vectors", "work (2, 3, c) if swept: a vector over the points of a table, and its product"),
)
"""Fields of the record of a class, see ``records``."""
RUN_FIELDS: Final[tuple[Field, ...]] = (
    ("sparse", "1 where some class takes a table of Y"),
    ("defects", "output (R,): defect of the instants, 0 without tables of Y"),
    ("corrections", "output, int64 (R,): corrections of the instants"),
)
"""Fields of the record of the run."""

MOST_CORRECTIONS: Final = 8
"""Corrections of an instant, after which it is solved with the exact operator."""


@entry("i8, i8, i8[::1], i8[::1], f4[::1], f8[::1], f8[::1]")
def multiply(points: int, width: int, starts: Any, runs: Any, values: Any, x: Array, out: Array) -> None:
    """out (points h,) = a table times x (points h,)."""
    at = 0
    # up to three sums side by side: the components of the point
    for p in range(points):
        s0 = s1 = s2 = 0.0
        for r in range(starts[p], starts[p + 1]):
            # components in a run follow each other: no index for each entry
            n = runs[2 * r + 1]
            part = x[runs[2 * r] : runs[2 * r] + n]
            l0 = values[at : at + n]
            if width == 3:
                l1, l2 = values[at + n : at + 2 * n], values[at + 2 * n : at + 3 * n]
                for e in range(n):
                    value = part[e]
                    s0 += l0[e] * value
                    s1 += l1[e] * value
                    s2 += l2[e] * value
            elif width == 2:
                l1 = values[at + n : at + 2 * n]
                for e in range(n):
                    value = part[e]
                    s0 += l0[e] * value
                    s1 += l1[e] * value
            else:
                for e in range(n):
                    s0 += l0[e] * part[e]
            at += n * width
        out[width * p] = s0
        if width > 1:
            out[width * p + 1] = s1
        if width > 2:
            out[width * p + 2] = s2


@kernel
def add_response(pools: Any, c: int, force: Array, answer: Array) -> None:
    """Add the table of Y times forces (c, m) on the channels, times the gain in them, to ``answer`` (c, m)."""
    row = pools.classes[c]
    work = pools.moving
    m = pools.classes[c].m
    size = row.y_points * row.y_width
    places = pools.fixed_int[row.y_places : row.y_places + size]
    starts = pools.fixed_int[row.y_starts : row.y_starts + row.y_points + 1]
    runs = pools.fixed_int[row.y_runs : row.y_runs + 2 * starts[row.y_points]]
    values = pools.fixed_single[row.y_values : row.y_values + row.y_entries]
    x, product = work[row.point_vectors : row.point_vectors + size], work[row.point_vectors + size :]
    for j in range(m):
        for i in range(size):
            x[i] = force[places[i] * m + j] if places[i] >= 0 else 0.0
        multiply(row.y_points, row.y_width, starts, runs, values, x, product)
        for i in range(size):
            if places[i] >= 0:
                answer[places[i] * m + j] += product[i]


@kernel
def add_table_norms(pools: Any, c: int, i: int, part: int, gain: float) -> None:
    """Add x C x of the nodal forces and of their half residuals at instant i of the window, between normal (``part`` 0)
    or tangential channels (1), to ``class_norms``."""
    row = pools.classes[c]
    run = pools.run[0]
    work = pools.moving
    m = pools.classes[c].m
    points = row.normal_points
    width = row.normal_width
    places_at = row.normal_places
    starts_at = row.normal_starts
    runs_at = row.normal_runs
    values_at = row.normal_values
    entries = row.normal_entries
    if part == 1:
        points = row.tangential_points
        width = row.tangential_width
        places_at = row.tangential_places
        starts_at, runs_at = row.tangential_starts, row.tangential_runs
        values_at, entries = row.tangential_values, row.tangential_entries
    if points == 0:
        return
    size, channels = points * width, pools.fixed_int[row.channels : row.channels + row.n_channel * m]
    places, starts = pools.fixed_int[places_at : places_at + size], pools.fixed_int[starts_at : starts_at + points + 1]
    runs = pools.fixed_int[runs_at : runs_at + 2 * starts[points]]
    values = pools.fixed_single[values_at : values_at + entries]
    area = pools.fixed[run.area : run.area + run.n_flat]
    f_hat = work[run.local_f + i * run.n_flat : run.local_f + (i + 1) * run.n_flat]
    r = work[run.r + i * run.n_flat : run.r + (i + 1) * run.n_flat]
    x, product = work[row.point_vectors : row.point_vectors + size], work[row.point_vectors + size :]
    cross = 0.0
    for half in range(2):
        total = 0.0
        for j in range(m):
            for e in range(size):
                x[e] = 0.0
                if places[e] >= 0:
                    at = channels[places[e] * m + j]
                    x[e] = area[at] * (0.5 * r[at] if half == 1 else f_hat[at])
            multiply(points, width, starts, runs, values, x, product)
            for e in range(size):
                total += x[e] * product[e]
                # C is symmetric: the product with the forces serves their half residuals, too
                if half == 0 and places[e] >= 0:
                    at = channels[places[e] * m + j]
                    cross += 0.5 * area[at] * r[at] * product[e]
        # a truncated table need not be positive
        work[row.class_norms + 4 * i + 2 * part + half] += gain * max(total, 0.0)
    work[row.cross + i] += gain * cross


@kernel
def squared_defect(pools: Any) -> float:
    """Squared size of W_A - W_hat at the channels of classes with tables of Y, in the norm of the error indicator; with
    the exact velocities W_A under the tractions of the local stage in ``w_free``. The power of these tractions on it
    goes to ``cross`` of the classes, where the others have theirs already."""
    run, work = pools.run[0], pools.moving
    n, total = run.n_flat, 0.0
    f_hat, area = work[run.local_f : run.local_f + n], pools.fixed[run.area : run.area + n]
    w_hat, weights = work[run.local_w : run.local_w + n], pools.fixed[run.weights + 2 * n : run.weights + 3 * n]
    for c in range(len(pools.classes)):
        row = pools.classes[c]
        exact, power = row.sparse == 1 and work[row.ended] == 1.0, 0.0
        for at in range(row.n_channel * row.m):
            j = pools.fixed_int[row.channels + at]
            # of classes without a table those of the linear stage
            apart = (work[row.w_free + at] if exact else work[run.w + j]) - w_hat[j]
            power += area[j] * f_hat[j] * apart
            total += weights[j] * apart * apart if exact else 0.0
        work[row.cross] = power + (0.0 if exact else work[row.cross])
    return float(total)
