"""One class of substructures over one instant: kernels twin to ``DirectPropagator.predict`` and ``commit``.

Arrays of a class are flat (rows x members). W = w_free + Y (q - k w_free) is the answer of the interface to q.
"""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import NDArray

from .sweeps import backward, forward
from .views import floats, indices, integers, kernel, table_of_floats

Array = NDArray[np.float64]


@kernel
def add_symmetric(
    n: int,
    diagonal_at: int,
    starts_at: int,
    columns_at: int,
    values_at: int,
    factor: float,
    m: int,
    x: Array,
    out: Array,
    scratch_at: int,
) -> None:
    """out += factor A x for symmetric A by addresses: its diagonal and its strict lower triangle in compressed rows.

    Several members are taken one after the other, gathered to ``scratch`` (2 n,): half the matrix on numbers that lie
    together is faster than whole rows on all of them.
    """
    diagonal, starts = floats(diagonal_at, n), integers(starts_at, n + 1)
    columns, values = indices(columns_at, starts[n]), floats(values_at, starts[n])
    if m == 1:
        half_product(n, diagonal, starts, columns, values, factor, x, out)
        return
    own, total = floats(scratch_at, n), floats(scratch_at + 8 * n, n)
    for j in range(m):
        for i in range(n):
            own[i] = x[i * m + j]
            total[i] = 0.0
        half_product(n, diagonal, starts, columns, values, factor, own, total)
        for i in range(n):
            out[i * m + j] += total[i]


@kernel
def half_product(
    n: int, diagonal: Array, starts: Any, columns: Any, values: Array, factor: float, x: Array, out: Array
) -> None:
    """out += factor A x for one vector; see ``add_symmetric``."""
    for i in range(n):
        column, value = columns[starts[i] : starts[i + 1]], values[starts[i] : starts[i + 1]]
        own = factor * x[i]
        total = diagonal[i] * x[i]
        for e in range(len(column)):
            total += value[e] * x[column[e]]
            out[column[e]] += value[e] * own
        out[i] += factor * total


@kernel
def add_matrix(n: int, starts_at: int, columns_at: int, values_at: int, m: int, x: Array, out: Array) -> None:
    """out += A x for A (n, ...) in compressed rows given by addresses; x, out flat, m members."""
    starts = integers(starts_at, n + 1)
    columns, values = indices(columns_at, starts[n]), floats(values_at, starts[n])
    for i in range(n):
        column, value = columns[starts[i] : starts[i + 1]], values[starts[i] : starts[i + 1]]
        line = out[i * m : i * m + m]
        for e in range(len(column)):
            at = np.int64(column[e]) * m
            for j in range(m):
                line[j] += value[e] * x[at + j]


@kernel
def add_terms(
    n: int,
    starts_at: int,
    rows_at: int,
    values_at: int,
    amplitudes_at: int,
    instant: int,
    factor: float,
    out: Array,
) -> None:
    """out += factor x the terms (see ``Terms``) at an instant."""
    if n == 0:
        return
    starts = integers(starts_at, n + 1)
    rows, values = integers(rows_at, starts[n]), floats(values_at, starts[n])
    amplitude = floats(amplitudes_at + 8 * n * instant, n)
    for t in range(n):
        now = factor * amplitude[t]
        if now != 0.0:
            for e in range(starts[t], starts[t + 1]):
                out[rows[e]] += now * values[e]


@kernel
def dense(n: int, matrix_at: int, m: int, x: Array, out: Array) -> None:
    """out = A x for symmetric dense A, x and out (n m,): A packed for one member (``packed_product``), else whole."""
    if m == 1:
        packed_product(n, floats(matrix_at, n * (n + 1) // 2), x, out)
    else:
        np.dot(table_of_floats(matrix_at, n, n), x.reshape(n, m), out.reshape(n, m))


@kernel
def packed_product(n: int, a: Array, x: Array, out: Array) -> None:
    """out = A x, A given by the rows of its lower triangle one after the other: half the memory to read, which is
    what a product with a matrix that does not stay in the cache costs. Two rows at a time."""
    at, i = 0, 0
    while i + 2 <= n:
        first, second = a[at : at + i], a[at + i + 1 : at + 2 * i + 1]
        corner, below, last = a[at + i], a[at + 2 * i + 1], a[at + 2 * i + 2]
        x0, x1 = x[i], x[i + 1]
        t0, t1 = corner * x0 + below * x1, below * x0 + last * x1
        known, into = x[:i], out[:i]
        for j in range(i):
            t0 += first[j] * known[j]
            t1 += second[j] * known[j]
            into[j] += first[j] * x0 + second[j] * x1
        out[i], out[i + 1] = t0, t1
        at += 2 * i + 3
        i += 2
    if i < n:
        first, t0 = a[at : at + i], a[at + i] * x[i]
        for j in range(i):
            t0 += first[j] * x[j]
            out[j] += first[j] * x[i]
        out[i] = t0


@kernel
def product(n: int, matrix_at: int, plain: int, m: int, x: Array, out: Array) -> None:
    """As ``dense``; ``plain``: A is given by its diagonal."""
    if plain == 0:
        dense(n, matrix_at, m, x, out)
        return
    diagonal = floats(matrix_at, n)
    for i in range(n):
        for j in range(m):
            out[i * m + j] = diagonal[i] * x[i * m + j]


@kernel
def add_trace(row: Any, x: Array, out: Array) -> None:
    """out (n_channel m,) += T x for x (n_inner m,)."""
    if row.dense_trace == 0:
        add_matrix(row.n_channel, row.trace_starts, row.trace_columns, row.trace_values, row.m, x, out)
        return
    m, table = row.m, table_of_floats(row.trace_table, row.n_channel, row.n_inner)
    if m == 1:
        out += np.dot(table, x)
    else:
        out += np.dot(table, x.reshape(row.n_inner, m)).reshape(-1)


@kernel
def add_spread(row: Any, x: Array, out: Array) -> None:
    """out (n_inner m,) += T^T x for x (n_channel m,)."""
    if row.dense_trace == 0:
        add_matrix(row.n_inner, row.spread_starts, row.spread_columns, row.spread_values, row.m, x, out)
        return
    m, table = row.m, table_of_floats(row.spread_table, row.n_inner, row.n_channel)
    if m == 1:
        out += np.dot(table, x)
    else:
        out += np.dot(table, x.reshape(row.n_channel, m)).reshape(-1)


@kernel
def resting(row: Any, scheme: Any, instant: int) -> bool:
    """Whether the class has not moved, and nothing but its interfaces drives it at this instant."""
    if row.driven == 1 or scheme.rest_traction < 0.0 or integers(row.rest, 1)[0] == 0:
        return False
    amplitude = floats(row.force_amplitudes + 8 * row.force_n * instant, row.force_n)
    for t in range(row.force_n):  # noqa: SIM110, kernels have no generators
        if amplitude[t] != 0.0:
            return False
    return True


@kernel
def predict(row: Any, scheme: Any, instant: int) -> None:
    """Free response of the instant; leaves ``w_free``, ``free_a`` and the swept load."""
    m, size, n_inner, n_channel = row.m, row.n * row.m, row.n_inner, row.n_channel
    u, v, a = floats(row.u, size), floats(row.v, size), floats(row.a, size)
    u_free, v_free, load = floats(row.u_free, size), floats(row.v_free, size), floats(row.load, size)
    free_a, w_free = floats(row.free_a, n_inner * m), floats(row.w_free, n_channel * m)
    if resting(row, scheme, instant):
        u_free[:] = 0.0
        v_free[:] = 0.0
        free_a[:] = 0.0
        w_free[:] = 0.0
        load[:] = 0.0
        return
    constant, residual = floats(row.constant, size), floats(row.residual, size)
    for i in range(size):
        u_free[i] = u[i] + scheme.u_v * v[i] + scheme.u_a * a[i]
        v_free[i] = v[i] + scheme.v_a * a[i]
        load[i] = constant[i]
    add_terms(
        row.force_n,
        row.force_starts,
        row.force_rows,
        row.force_values,
        row.force_amplitudes,
        instant,
        1.0,
        load,
    )
    add_symmetric(
        row.n,
        row.stiffness_diagonal,
        row.stiffness_starts,
        row.stiffness_columns,
        row.stiffness_values,
        -1.0,
        m,
        u_free,
        load,
        row.column,
    )
    if row.damping_n > 0:
        add_symmetric(
            row.n,
            row.damping_diagonal,
            row.damping_starts,
            row.damping_columns,
            row.damping_values,
            -1.0,
            m,
            v_free,
            load,
            row.column,
        )
    for i in range(size):
        load[i] = scheme.force_weight * load[i] - scheme.memory_weight * residual[i]
    add_terms(
        row.inertia_n, row.inertia_starts, row.inertia_rows, row.inertia_values, row.inertia_amplitudes,
        instant, -1.0, load,
    )  # fmt: skip
    forward(row, load)
    if n_inner > 0:
        product(n_inner, row.schur_inverse, row.plain_inverse, m, floats(row.inner, n_inner * m), free_a)
    reached, dofs = floats(row.inner, n_inner * m), integers(row.dofs, n_inner)
    for i in range(n_inner):
        for j in range(m):
            at = dofs[i] * m + j
            reached[i * m + j] = (
                scheme.w_u_old * u[at] + scheme.w_u * u_free[at] + scheme.w_v * v_free[at]
                + scheme.interface_gain * free_a[i * m + j]
            )  # fmt: skip
    w_free[:] = 0.0
    add_trace(row, reached, w_free)
    add_terms(
        row.velocity_n, row.velocity_starts, row.velocity_rows, row.velocity_values, row.velocity_amplitudes,
        instant, 1.0, w_free,
    )  # fmt: skip


@kernel
def respond(row: Any, q: Array, w: Array) -> None:
    """W at the channels of the class for q, both flat over the assembly."""
    m, n_live = row.m, row.n_live
    size = n_live * m
    channels, live = integers(row.channels, row.n_channel * m), integers(row.live, n_live)
    k, area, w_free = (
        floats(row.k, row.n_channel),
        floats(row.area, row.n_channel),
        floats(row.w_free, row.n_channel * m),
    )
    incoming, answer = floats(row.channel, size), floats(row.answer, size)
    for i in range(n_live):
        for j in range(m):
            at = live[i] * m + j
            incoming[i * m + j] = area[live[i]] * (q[channels[at]] - k[live[i]] * w_free[at])
    product(n_live, row.response, row.plain_response, m, incoming, answer)
    for at in range(row.n_channel * m):
        w[channels[at]] = w_free[at]
    for i in range(n_live):
        for j in range(m):
            w[channels[live[i] * m + j]] += answer[i * m + j]


@kernel
def commit(row: Any, scheme: Any, instant: int, traction: Array) -> int:
    """End the instant with tractions flat over the assembly; how many substructures were marched."""
    n, m, n_inner, n_channel = row.n, row.m, row.n_inner, row.n_channel
    size = n * m
    channels, area = integers(row.channels, n_channel * m), floats(row.area, n_channel)
    nodal, largest = floats(row.channel, n_channel * m), 0.0
    for i in range(n_channel):
        for j in range(m):
            now = traction[channels[i * m + j]]
            nodal[i * m + j] = area[i] * now
            largest = max(largest, abs(now))
    if resting(row, scheme, instant):
        if largest <= scheme.rest_traction:
            return 0
        floats(row.sweep, size)[:] = 0.0
    rest = integers(row.rest, 1)
    rest[0] = 0
    u, v, a = floats(row.u, size), floats(row.v, size), floats(row.a, size)
    u_free, v_free, residual = floats(row.u_free, size), floats(row.v_free, size), floats(row.residual, size)
    free_a, inner = floats(row.free_a, n_inner * m), floats(row.inner, n_inner * m)
    last = floats(row.inner_answer, n_inner * m)
    if n_inner > 0:
        for i in range(n_channel * m):
            nodal[i] *= scheme.force_weight
        inner[:] = 0.0
        add_spread(row, nodal, inner)
        product(n_inner, row.schur_inverse, row.plain_inverse, m, inner, last)
        for i in range(n_inner * m):
            last[i] += free_a[i]
    backward(row, last, a)
    massless, before = integers(row.massless, row.n_massless), floats(row.load, size)
    for e in range(row.n_massless):
        for j in range(m):
            before[massless[e] * m + j] = u[massless[e] * m + j]
    for i in range(size):
        u[i] = u_free[i] + scheme.u_late * v_free[i] + scheme.displacement_gain * a[i]
        v[i] = v_free[i] + scheme.velocity_gain * a[i]
    for e in range(
        row.n_massless
    ):  # statics alone moves them: a velocity that means something, and no memory
        for j in range(m):
            at = massless[e] * m + j
            v[at] = (u[at] - before[at]) / scheme.dt
            a[at] = 0.0
    for i in range(size):
        residual[i] = scheme.memory_weight * residual[i]
    add_symmetric(
        n,
        row.mass_diagonal,
        row.mass_starts,
        row.mass_columns,
        row.mass_values,
        1.0,
        m,
        a,
        residual,
        row.column,
    )
    add_terms(
        row.inertia_n, row.inertia_starts, row.inertia_rows, row.inertia_values, row.inertia_amplitudes,
        instant, 1.0, residual,
    )  # fmt: skip
    for i in range(size):
        residual[i] /= scheme.force_weight
    return int(m)


@kernel
def read_displacement(row: Any, instant: int, lead: float, out: Array) -> None:
    """Displacements of the channels, ``lead`` s ahead, into ``out`` (n_flat,)."""
    m, n_channel, n_inner = row.m, row.n_channel, row.n_inner
    channels, dofs = integers(row.channels, n_channel * m), integers(row.dofs, n_inner)
    u, v, inner, answer = (
        floats(row.u, row.n * m),
        floats(row.v, row.n * m),
        floats(row.inner, n_inner * m),
        floats(row.answer, n_channel * m),
    )
    for i in range(n_inner):
        for j in range(m):
            inner[i * m + j] = u[dofs[i] * m + j]
            if lead > 0.0:
                inner[i * m + j] += lead * v[dofs[i] * m + j]
    answer[:] = 0.0
    add_trace(row, inner, answer)
    add_terms(
        row.displacement_n, row.displacement_starts, row.displacement_rows, row.displacement_values,
        row.displacement_amplitudes, instant, 1.0, answer,
    )  # fmt: skip
    for at in range(n_channel * m):
        out[channels[at]] = answer[at]


@kernel
def probe(row: Any, instant: int) -> None:
    """Keep the velocities of the probed rows."""
    size = row.n_probe * row.m
    if size > 0:
        out = floats(row.probed + 8 * size * instant, size)
        out[:] = 0.0
        add_matrix(
            row.n_probe,
            row.probe_starts,
            row.probe_columns,
            row.probe_values,
            row.m,
            floats(row.v, row.n * row.m),
            out,
        )
