"""Matrices, loads, prescribed motions and readings of a class, where its record says they lie."""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import NDArray

from ..cholesky.substitution import LANES, SPARE
from ..compiled import kernel
from .products import add_dense, add_rows, add_symmetric, add_terms, product, symmetric_size

Array = NDArray[np.float64]


@kernel
def tile_of(row: Any, work: Array) -> Array:
    """Scratch of the products."""
    return work[row.tile : row.tile + (max(row.n, row.n_channel) + SPARE) * LANES]


@kernel
def add_mass(pools: Any, c: int, factor: float, x: Array, out: Array) -> None:
    """out += factor M x."""
    row = pools.classes[c]
    starts = pools.fixed_int[row.mass_starts : row.mass_starts + row.n + 1]
    add_symmetric(
        row.n,
        pools.fixed[row.mass_diagonal : row.mass_diagonal + row.n],
        starts,
        pools.fixed_col[row.mass_columns : row.mass_columns + starts[row.n]],
        pools.fixed[row.mass_values : row.mass_values + starts[row.n]],
        factor,
        row.m,
        x,
        out,
        tile_of(row, pools.moving),
    )


@kernel
def add_stiffness(pools: Any, c: int, factor: float, x: Array, out: Array) -> None:
    """out += factor K x."""
    row = pools.classes[c]
    starts = pools.fixed_int[row.stiffness_starts : row.stiffness_starts + row.n + 1]
    add_symmetric(
        row.n,
        pools.fixed[row.stiffness_diagonal : row.stiffness_diagonal + row.n],
        starts,
        pools.fixed_col[row.stiffness_columns : row.stiffness_columns + starts[row.n]],
        pools.fixed[row.stiffness_values : row.stiffness_values + starts[row.n]],
        factor,
        row.m,
        x,
        out,
        tile_of(row, pools.moving),
    )


@kernel
def add_damping(pools: Any, c: int, factor: float, x: Array, out: Array) -> None:
    """out += factor C x, where there is damping."""
    row = pools.classes[c]
    if row.damping_rows == 0:
        return
    starts = pools.fixed_int[row.damping_starts : row.damping_starts + row.n + 1]
    add_symmetric(
        row.n,
        pools.fixed[row.damping_diagonal : row.damping_diagonal + row.n],
        starts,
        pools.fixed_col[row.damping_columns : row.damping_columns + starts[row.n]],
        pools.fixed[row.damping_values : row.damping_values + starts[row.n]],
        factor,
        row.m,
        x,
        out,
        tile_of(row, pools.moving),
    )


@kernel
def add_dashpots(pools: Any, c: int, factor: float, x: Array, out: Array) -> None:
    """out += factor C_d x, the lumped part of the damping of an EXPLICIT class."""
    row = pools.classes[c]
    if row.dashpots_rows == 0:
        return
    starts = pools.fixed_int[row.dashpots_starts : row.dashpots_starts + row.n + 1]
    add_symmetric(
        row.n,
        pools.fixed[row.dashpots_diagonal : row.dashpots_diagonal + row.n],
        starts,
        pools.fixed_col[row.dashpots_columns : row.dashpots_columns + starts[row.n]],
        pools.fixed[row.dashpots_values : row.dashpots_values + starts[row.n]],
        factor,
        row.m,
        x,
        out,
        tile_of(row, pools.moving),
    )


@kernel
def springs(pools: Any, c: int, x: Array, out: Array) -> None:
    """out = (S + T^T area k/dt T)^-1 x of a STATIC class."""
    row = pools.classes[c]
    inverse = pools.fixed[row.spring_inverse : row.spring_inverse + symmetric_size(row.n_inner, 0, row.m)]
    product(row.n_inner, inverse, 0, row.m, x, out, tile_of(row, pools.moving))


@kernel
def forces(pools: Any, c: int, instant: int, out: Array) -> None:
    """Add the time-dependent forces of the instant."""
    row = pools.classes[c]
    _terms(
        pools,
        row.force_terms,
        row.force_starts,
        row.force_rows,
        row.force_values,
        row.force_amplitudes,
        instant,
        1.0,
        out,
    )


@kernel
def inertia(pools: Any, c: int, instant: int, factor: float, out: Array) -> None:
    """Add factor times the inertia of the prescribed motions."""
    row = pools.classes[c]
    _terms(
        pools,
        row.inertia_terms,
        row.inertia_starts,
        row.inertia_rows,
        row.inertia_values,
        row.inertia_amplitudes,
        instant,
        factor,
        out,
    )


@kernel
def imposed(pools: Any, c: int, instant: int, order: int, factor: float, out: Array) -> None:
    """Add factor times the share of prescribed motions in the channels: displacements (``order`` 0), velocities (1) or
    accelerations (2)."""
    row = pools.classes[c]
    if order == 0:
        _terms(
            pools,
            row.displacement_terms,
            row.displacement_starts,
            row.displacement_rows,
            row.displacement_values,
            row.displacement_amplitudes,
            instant,
            factor,
            out,
        )
    elif order == 1:
        _terms(
            pools,
            row.velocity_terms,
            row.velocity_starts,
            row.velocity_rows,
            row.velocity_values,
            row.velocity_amplitudes,
            instant,
            factor,
            out,
        )
    else:
        _terms(
            pools,
            row.acceleration_terms,
            row.acceleration_starts,
            row.acceleration_rows,
            row.acceleration_values,
            row.acceleration_amplitudes,
            instant,
            factor,
            out,
        )


@kernel
def _terms(
    pools: Any,
    n: int,
    starts_at: int,
    rows_at: int,
    values_at: int,
    amplitudes_at: int,
    instant: int,
    factor: float,
    out: Array,
) -> None:
    if n == 0:
        return
    starts = pools.moving_int[starts_at : starts_at + n + 1]
    at = amplitudes_at + n * instant
    add_terms(
        n,
        starts,
        pools.moving_int[rows_at : rows_at + starts[n]],
        pools.moving[values_at : values_at + starts[n]],
        pools.moving[at : at + n],
        factor,
        out,
    )


@kernel
def add_trace(pools: Any, c: int, x: Array, out: Array, normal: bool) -> None:
    """out (c m,) += T x for x (g m,); ``normal``: a dense T is taken at its normal channels alone."""
    row = pools.classes[c]
    if row.dense_trace == 0:
        starts = pools.fixed_int[row.trace_starts : row.trace_starts + row.n_channel + 1]
        add_rows(
            row.n_channel,
            starts,
            pools.fixed_col[row.trace_columns : row.trace_columns + starts[row.n_channel]],
            pools.fixed[row.trace_values : row.trace_values + starts[row.n_channel]],
            1.0,
            row.m,
            x,
            out,
        )
        return
    if not normal:
        table = pools.fixed[row.trace_table : row.trace_table + row.n_channel * row.n_inner]
        add_dense(row.n_channel, row.n_inner, table, row.m, x, out)
        return
    n, m = row.n_normal, row.m
    found = pools.moving[row.answers : row.answers + n * m]
    found[:] = 0.0
    add_dense(n, row.n_inner, pools.fixed[row.normal_table : row.normal_table + n * row.n_inner], m, x, found)
    at = pools.fixed_int[row.measured : row.measured + n]
    for i in range(n):
        for j in range(m):
            out[at[i] * m + j] += found[i * m + j]


@kernel
def add_spread(pools: Any, c: int, x: Array, out: Array) -> None:
    """out (g m,) += T^T x for x (c m,)."""
    row = pools.classes[c]
    if row.dense_trace == 1:
        table = pools.fixed[row.spread_table : row.spread_table + row.n_inner * row.n_channel]
        add_dense(row.n_inner, row.n_channel, table, row.m, x, out)
        return
    starts = pools.fixed_int[row.spread_starts : row.spread_starts + row.n_inner + 1]
    add_rows(
        row.n_inner,
        starts,
        pools.fixed_col[row.spread_columns : row.spread_columns + starts[row.n_inner]],
        pools.fixed[row.spread_values : row.spread_values + starts[row.n_inner]],
        1.0,
        row.m,
        x,
        out,
    )


# -- reading the motion -------------------------------------------------------------------------------------------
@kernel
def read_channels(
    pools: Any, c: int, instant: int, of_u: float, of_v: float, of_a: float, normal: bool, out: Array
) -> None:
    """of_u u + of_v v + of_a a of the channels into ``out`` (N,); ``normal``: only normal channels need be right."""
    row, work, state = pools.classes[c], pools.moving, pools.moving
    m, n_inner, size = row.m, row.n_inner, row.n_channel * row.m
    channels, dofs = (
        pools.fixed_int[row.channels : row.channels + size],
        pools.fixed_int[row.dofs : row.dofs + n_inner],
    )
    inner, answer = work[row.inner : row.inner + n_inner * m], work[row.answer : row.answer + size]
    u, v, a = (state[row.u : row.u + row.n * m], state[row.v : row.v + row.n * m], state[row.a : row.a + row.n * m])
    for i in range(n_inner):
        for j in range(m):
            inner[i * m + j] = of_u * u[dofs[i] * m + j]
    if of_v != 0.0 or of_a != 0.0:
        for i in range(n_inner):
            for j in range(m):
                at = dofs[i] * m + j
                inner[i * m + j] += of_v * v[at] + of_a * a[at]
    answer[:] = 0.0
    add_trace(pools, c, inner, answer, normal)
    if of_u != 0.0:
        imposed(pools, c, instant, 0, of_u, answer)
    if of_v != 0.0:
        imposed(pools, c, instant, 1, of_v, answer)
    if of_a != 0.0:
        imposed(pools, c, instant, 2, of_a, answer)
    for at in range(size):
        out[channels[at]] = answer[at]


@kernel
def probe(pools: Any, c: int, instant: int) -> None:
    """Keep the velocities of the probed rows."""
    row = pools.classes[c]
    size = row.n_probe * row.m
    if size == 0:
        return
    at = row.probed + size * (instant - pools.run[0].first_row)
    out = pools.moving[at : at + size]
    out[:] = 0.0
    starts = pools.fixed_int[row.probe_starts : row.probe_starts + row.n_probe + 1]
    add_rows(
        row.n_probe,
        starts,
        pools.fixed_col[row.probe_columns : row.probe_columns + starts[row.n_probe]],
        pools.fixed[row.probe_values : row.probe_values + starts[row.n_probe]],
        1.0,
        row.m,
        pools.moving[row.v : row.v + row.n * row.m],
        out,
    )
