"""One class of substructures over one instant: kernels twin to ``DirectPropagator.predict`` and ``commit``.

Arrays of a class are flat (rows x members). W = w_free + Y (q - k w_free) is the answer of the interface to q.
"""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import NDArray

from ..compiled import kernel
from .lanes import padded
from .products import add_matrix, add_spread, add_symmetric, add_terms, add_trace, product
from .sweeps import backward, forward
from .views import floats, integers

Array = NDArray[np.float64]


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
    rest = integers(row.rest, 2)
    rest[1] = int(resting(row, scheme, instant))
    if rest[1] == 1:
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
        row.tile,
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
            row.tile,
        )
    for i in range(size):
        load[i] = scheme.force_weight * load[i] - scheme.memory_weight * residual[i]
    add_terms(
        row.inertia_n, row.inertia_starts, row.inertia_rows, row.inertia_values, row.inertia_amplitudes,
        instant, -1.0, load,
    )  # fmt: skip
    forward(row, load)
    if n_inner > 0:
        product(
            n_inner, row.schur_inverse, row.plain_inverse, m, floats(row.inner, n_inner * m), free_a, row.tile
        )
    reached, dofs = floats(row.inner, n_inner * m), integers(row.dofs, n_inner)
    for i in range(n_inner):
        for j in range(m):
            at = dofs[i] * m + j
            reached[i * m + j] = (
                scheme.w_u_old * u[at] + scheme.w_u * u_free[at] + scheme.w_v * v_free[at]
                + scheme.interface_gain * free_a[i * m + j]
            )  # fmt: skip
    w_free[:] = 0.0
    add_trace(row, reached, w_free, False)
    add_terms(
        row.velocity_n, row.velocity_starts, row.velocity_rows, row.velocity_values, row.velocity_amplitudes,
        instant, 1.0, w_free,
    )  # fmt: skip


@kernel
def respond(row: Any, q: Array, w: Array, level: float, weights: Array, enough: float) -> int:
    """W at the channels of the class for q, both flat over the assembly; substructures solved.

    A class at rest answers zero as long as q is not above ``level``; one whose q has changed by no more than ``enough``
    in the squared norm of ``weights`` since it answered keeps its answer (see ``latin.unchanged``).
    """
    m, n_live = row.m, row.n_live
    size = n_live * m
    channels, live = integers(row.channels, row.n_channel * m), integers(row.live, n_live)
    seen, change = floats(row.seen, row.n_channel * m), 0.0
    if integers(row.rest, 2)[1] == 1:
        largest = 0.0
        for at in range(row.n_channel * m):
            largest = max(largest, abs(q[channels[at]]))
        if largest <= level:
            for at in range(row.n_channel * m):
                seen[at] = q[channels[at]]
                w[channels[at]] = 0.0
            return 0
    if enough >= 0.0:
        for at in range(row.n_channel * m):
            moved = q[channels[at]] - seen[at]
            change += weights[channels[at]] * moved * moved
        if change <= enough:
            return 0
    for at in range(row.n_channel * m):
        seen[at] = q[channels[at]]
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
    product(n_live, row.response, row.plain_response, m, incoming, answer, row.tile)
    for at in range(row.n_channel * m):
        w[channels[at]] = w_free[at]
    for i in range(n_live):
        for j in range(m):
            w[channels[live[i] * m + j]] += answer[i * m + j]
    return int(m)


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
    rest = integers(row.rest, 2)
    if rest[1] == 1:
        if largest <= scheme.rest_traction:
            return 0
        floats(row.sweep, n * padded(m))[:] = 0.0
    rest[:] = 0
    u, v, a = floats(row.u, size), floats(row.v, size), floats(row.a, size)
    u_free, v_free, residual = floats(row.u_free, size), floats(row.v_free, size), floats(row.residual, size)
    free_a, inner = floats(row.free_a, n_inner * m), floats(row.inner, n_inner * m)
    last = floats(row.inner_answer, n_inner * m)
    if n_inner > 0:
        for i in range(n_channel * m):
            nodal[i] *= scheme.force_weight
        inner[:] = 0.0
        add_spread(row, nodal, inner)
        product(n_inner, row.schur_inverse, row.plain_inverse, m, inner, last, row.tile)
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
        row.tile,
    )
    add_terms(
        row.inertia_n, row.inertia_starts, row.inertia_rows, row.inertia_values, row.inertia_amplitudes,
        instant, 1.0, residual,
    )  # fmt: skip
    for i in range(size):
        residual[i] /= scheme.force_weight
    return int(m)


@kernel
def read_displacement(row: Any, instant: int, of_v: float, of_a: float, gaps: bool, out: Array) -> None:
    """u + of_v v + of_a a of the channels (of_v, of_a in s, s2) into ``out`` (n_flat,); ``gaps``: only the normal
    channels need to be right."""
    m, n_channel, n_inner = row.m, row.n_channel, row.n_inner
    channels, dofs = integers(row.channels, n_channel * m), integers(row.dofs, n_inner)
    u, inner, answer = (
        floats(row.u, row.n * m),
        floats(row.inner, n_inner * m),
        floats(row.answer, n_channel * m),
    )
    for i in range(n_inner):
        for j in range(m):
            inner[i * m + j] = u[dofs[i] * m + j]
    answer[:] = 0.0
    if of_v != 0.0 or of_a != 0.0:
        v, a = floats(row.v, row.n * m), floats(row.a, row.n * m)
        for i in range(n_inner):
            for j in range(m):
                inner[i * m + j] += of_v * v[dofs[i] * m + j] + of_a * a[dofs[i] * m + j]
        add_terms(
            row.velocity_n, row.velocity_starts, row.velocity_rows, row.velocity_values, row.velocity_amplitudes,
            instant, of_v, answer,
        )  # fmt: skip
        add_terms(
            row.acceleration_n, row.acceleration_starts, row.acceleration_rows, row.acceleration_values,
            row.acceleration_amplitudes, instant, of_a, answer,
        )  # fmt: skip
    add_trace(row, inner, answer, gaps)
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
