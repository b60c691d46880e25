"""Matrices, loads and prescribed motions of a class at the places in its record; velocities and displacements read."""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import NDArray

from ..compiled import kernel
from .products import LONG, add_dense, add_dense_members, add_rows, add_terms, read_long_rows, symmetric_size
from .splits import dense, tile_of

Array = NDArray[np.float64]

FORCES, INERTIA, DISPLACEMENTS, VELOCITIES, ACCELERATIONS, LOADS = range(6)
"""Sums of ``add_sum``."""


@kernel
def add_matrix(
    pools: Any, rows: int, starts_at: int, columns_at: int, values_at: int, m: int, x: Array, out: Array
) -> None:
    """out (rows m,) += A x for a matrix in compressed rows."""
    starts = pools.fixed_int[starts_at : starts_at + rows + 1]
    columns = pools.fixed_col[columns_at : columns_at + starts[rows]]
    add_rows(rows, starts, columns, pools.fixed[values_at : values_at + starts[rows]], 1.0, m, x, out)


@kernel
def springs(pools: Any, c: int, x: Array, out: Array) -> None:
    """out = (S + T^T area k/dt T)^-1 x of a STATIC class."""
    row = pools.classes[c]
    inverse = pools.fixed[row.spring_inverse : row.spring_inverse + symmetric_size(row.n_inner, 0, row.m)]
    dense(pools, c, row.n_inner, inverse, 0, row.m, x, out)


@kernel
def add_sum(pools: Any, c: int, which: int, instant: int, factor: float, out: Array) -> None:
    """out += factor times a sum of patterns with their amplitudes at an instant: forces on the dofs, inertia of the
    prescribed motions, displacements, velocities or accelerations that these give the channels, or loads."""
    row = pools.classes[c]
    n = row.force_terms
    starts_at = row.force_starts
    rows_at = row.force_rows
    values_at, at = row.force_values, row.force_amplitudes
    if which == INERTIA:
        n = row.inertia_terms
        starts_at = row.inertia_starts
        rows_at = row.inertia_rows
        values_at, at = row.inertia_values, row.inertia_amplitudes
    elif which == DISPLACEMENTS:
        n = row.displacement_terms
        starts_at = row.displacement_starts
        rows_at = row.displacement_rows
        values_at, at = row.displacement_values, row.displacement_amplitudes
    elif which == VELOCITIES:
        n = row.velocity_terms
        starts_at = row.velocity_starts
        rows_at = row.velocity_rows
        values_at, at = row.velocity_values, row.velocity_amplitudes
    elif which == ACCELERATIONS:
        n = row.acceleration_terms
        starts_at = row.acceleration_starts
        rows_at = row.acceleration_rows
        values_at, at = row.acceleration_values, row.acceleration_amplitudes
    elif which == LOADS:
        n = row.work_terms
        starts_at = row.work_starts
        rows_at = row.work_rows
        values_at, at = row.work_values, row.work_amplitudes
    if n == 0:
        return
    # a row of amplitudes for every instant
    starts, at = pools.moving_int[starts_at : starts_at + n + 1], at + n * instant
    rows = pools.moving_int[rows_at : rows_at + starts[n]]
    values = pools.moving[values_at : values_at + starts[n]]
    add_terms(n, starts, rows, values, pools.moving[at : at + n], factor, out)


@kernel
def _add_table(pools: Any, c: int, rows: int, columns: int, at: int, x: Array, out: Array) -> None:
    """out (rows m,) += A x for the dense matrix (rows, columns) at a place of the fixed block."""
    row, table = pools.classes[c], pools.fixed[at : at + rows * columns]
    if row.m == 1:
        add_dense(rows, columns, table, x, out)
        return
    add_dense_members(rows, columns, table, row.m, x, out, tile_of(row, pools.moving))


@kernel
def add_trace(pools: Any, c: int, x: Array, out: Array, normal: bool) -> None:
    """out (c m,) += T x for x (g m,); ``normal``: a dense T is taken at its normal channels alone."""
    row = pools.classes[c]
    if row.dense_trace == 0:
        add_matrix(pools, row.n_channel, row.trace_starts, row.trace_columns, row.trace_values, row.m, x, out)
        return
    if not normal:
        _add_table(pools, c, row.n_channel, row.n_inner, row.trace_table, x, out)
        # rows of the normal channels alone, which are apart in ``out``
        return
    n, m = row.n_normal, row.m
    normals = pools.moving[row.answers : row.answers + n * m]
    normals[:] = 0.0
    _add_table(pools, c, n, row.n_inner, row.normal_table, x, normals)
    at = pools.fixed_int[row.measured : row.measured + n]
    for i in range(n):
        for j in range(m):
            out[at[i] * m + j] += normals[i * m + j]


@kernel
def add_spread(pools: Any, c: int, x: Array, out: Array) -> None:
    """out (g m,) += T^T x for x (c m,)."""
    row = pools.classes[c]
    if row.dense_trace == 1:
        _add_table(pools, c, row.n_inner, row.n_channel, row.spread_table, x, out)
        return
    add_matrix(pools, row.n_inner, row.spread_starts, row.spread_columns, row.spread_values, row.m, x, out)


@kernel
def read_channels(
    pools: Any, c: int, instant: int, of_u: float, of_v: float, of_a: float, normal: bool, out: Array
) -> None:
    """of_u u + of_v v + of_a a of the channels into ``out`` (N,); ``normal``: only normal channels need be right."""
    row = pools.classes[c]
    work = pools.moving
    state = pools.moving
    m = row.m
    n_inner = row.n_inner
    size = row.n_channel * row.m
    channels, dofs = pools.fixed_int[row.channels : row.channels + size], pools.fixed_int[row.dofs : row.dofs + n_inner]
    inner, answer = work[row.inner : row.inner + n_inner * m], work[row.answer : row.answer + size]
    u = state[row.u : row.u + row.n * m]
    v = state[row.v : row.v + row.n * m]
    a = state[row.a : row.a + row.n * m]
    for i in range(n_inner):
        for j in range(m):
            inner[i * m + j] = of_u * u[dofs[i] * m + j]
    # gaps of schemes without an offset need displacements alone
    if of_v != 0.0 or of_a != 0.0:
        for i in range(n_inner):
            for j in range(m):
                at = dofs[i] * m + j
                inner[i * m + j] += of_v * v[at] + of_a * a[at]
    answer[:] = 0.0
    add_trace(pools, c, inner, answer, normal)
    if of_u != 0.0:
        add_sum(pools, c, DISPLACEMENTS, instant, of_u, answer)
    if of_v != 0.0:
        add_sum(pools, c, VELOCITIES, instant, of_v, answer)
    if of_a != 0.0:
        add_sum(pools, c, ACCELERATIONS, instant, of_a, answer)
    for at in range(size):
        out[channels[at]] = answer[at]


@kernel
def probe(pools: Any, c: int, instant: int) -> None:
    """Keep the velocities of the probed rows, and the motions at the sensors."""
    row, state = pools.classes[c], pools.moving
    at_row, size = instant - pools.run[0].first_row, row.n * row.m
    if row.n_probe > 0:
        at = row.probed + row.n_probe * row.m * at_row
        out = pools.moving[at : at + row.n_probe * row.m]
        out[:] = 0.0
        velocities = state[row.v : row.v + size]
        add_matrix(pools, row.n_probe, row.probe_starts, row.probe_columns, row.probe_values, row.m, velocities, out)
    if row.n_sensor == 0:
        return
    # of no branches the displacements once more
    strained = state[row.u : row.u + size]
    if row.n_branch > 0:
        strained = pools.moving[row.u_free : row.u_free + size]
        strained[:] = 0.0
        for j in range(row.n_branch):
            strength, first = pools.fixed[row.branches + j], row.elongation + j * size
            for i in range(size):
                strained[i] += strength * state[first + i]
    read_sensors(pools, c, at_row, strained)


@kernel
def read_sensors(pools: Any, c: int, at_row: int, strained: Array) -> None:
    """Displacements, velocities, accelerations and, with branches, ``strained`` (n m,) at the sensors, into a row of
    the output."""
    row, state = pools.classes[c], pools.moving
    n, wide = row.n_sensor, row.n_sensor * row.m
    size = row.n * row.m
    u, v, a = state[row.u : row.u + size], state[row.v : row.v + size], state[row.a : row.a + size]
    at = row.sensed + wide * row.n_sensed * at_row
    out = state[at : at + wide * row.n_sensed]
    out[:] = 0.0
    starts = pools.fixed_int[row.sensor_starts : row.sensor_starts + n + 1]
    if row.m == 1 and starts[n] >= LONG * n:
        columns = pools.fixed_col[row.sensor_columns : row.sensor_columns + starts[n]]
        values = pools.fixed[row.sensor_values : row.sensor_values + starts[n]]
        read_long_rows(n, row.n_sensed, starts, columns, values, u, v, a, strained, out)
        return
    for kind in range(row.n_sensed):
        field = u if kind == 0 else v if kind == 1 else a if kind == 2 else strained
        part = out[kind * wide : (kind + 1) * wide]
        add_matrix(pools, n, row.sensor_starts, row.sensor_columns, row.sensor_values, row.m, field, part)
