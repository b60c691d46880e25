"""Error indicator (24) and force residual: when to stop.

    eta = ||s - s_hat||^2 / (||s||^2 + ||s_hat||^2),  ||s||^2 = sum of int F Z^-1 F + int W Z W

over interfaces, sides and the instants of the window, Z the material impedance of the side whatever k is used;
``error_indicator`` is sqrt(eta). Without inertia the denominator leaves out the velocities: a body may travel far under
next to no force. By E+, F_hat - F = r/2 and W_hat - W = r/(2k) with the residual r = (F_hat + k W_hat) - q.

The indicator alone weights shear and the soft side of a contrast too little. A window has converged when both the
indicator and the force residual are within tolerance. The force residual is the norm sqrt(f . C f) of the nodal forces
f of F - F_hat, with the admittance C of one instant: the velocity error that these forces would cause. Normal and
tangential parts are each relative to their own largest value so far.

A motion that starts from an equilibrium with tractions F_0 (static start, preload) may be small against these. Errors
that are small against F_0 alone are then not small against the motion: they add up from instant to instant, until a
body at rest vibrates within the tolerance. So the size of the fields counts as min(||s||, a ||s - s_0||), with the
fields s_0 = (F_0, 0) and a factor a = ``amplified`` that leaves motions of more than a few per cent as they are.
"""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import NDArray

from ..cholesky.substitution import LANES, SPARE, TILED
from ..compiled import kernel
from .half_solves import forward_on_face, gain_of
from .products import symmetric_size, two_norms
from .sparse_response import add_table_norms
from .splits import dense
from .sums import add_parts

Array = NDArray[np.float64]

TANGENTIAL_FLOOR = 1e-2
"""Smallest scale of tangential forces over that of normal ones."""


@kernel
def error_indicator(pools: Any, window: int) -> float:
    """Residual r of q and sqrt(eta) over the window; ``measure[2]``: largest norm of the fields with this iterate."""
    residual_parts(pools, window)
    return set_error(pools, window)


@kernel
def residual_parts(pools: Any, window: int) -> None:
    """Residual r of q over the window, and the sums of the indicator over each interface, into ``own_parts``: of
    weighted squares of r, of the fields, of the fields without those of the equilibrium that the motion starts from."""
    run, work, direction = pools.run[0], pools.moving, pools.fixed
    n, wide = run.n_flat, run.part_width
    parts = work[run.own_parts : run.own_parts + run.n_interface * wide]
    for e in range(run.n_interface):
        parts[e * wide : e * wide + 3] = 0.0
    for i in range(window):
        for e in range(run.n_interface):
            size = pools.fixed_int[run.segments + 3 * e + 2]
            for side in range(2):
                at = pools.fixed_int[run.segments + 3 * e + side]
                k, still = direction[run.k + at : run.k + at + size], direction[run.still + at : run.still + at + size]
                of_r = direction[run.weights + at : run.weights + at + size]
                of_f = direction[run.weights + n + at : run.weights + n + at + size]
                of_w = direction[run.weights + 2 * n + at : run.weights + 2 * n + at + size]
                at += i * n
                q, r = work[run.q + at : run.q + at + size], work[run.r + at : run.r + at + size]
                f, w = work[run.f + at : run.f + at + size], work[run.w + at : run.w + at + size]
                f_hat = work[run.local_f + at : run.local_f + at + size]
                w_hat = work[run.local_w + at : run.local_w + at + size]
                difference, fields, moved = 0.0, 0.0, 0.0
                for j in range(size):
                    rest = f_hat[j] + k[j] * w_hat[j] - q[j]
                    r[j] = rest
                    difference += of_r[j] * rest * rest
                    motion = of_w[j] * (w[j] * w[j] + w_hat[j] * w_hat[j])
                    fields += of_f[j] * (f[j] * f[j] + f_hat[j] * f_hat[j]) + motion
                    moved += of_f[j] * ((f[j] - still[j]) ** 2 + (f_hat[j] - still[j]) ** 2) + motion
                parts[e * wide] += difference
                parts[e * wide + 1] += fields
                parts[e * wide + 2] += moved


@kernel
def set_error(pools: Any, window: int) -> float:
    """sqrt(eta) over the window from the ``parts`` of all interfaces."""
    run, work = pools.run[0], pools.moving
    add_parts(pools, 0, 3)
    difference, size, moved = work[run.totals], work[run.totals + 1], work[run.totals + 2]
    measure, scales = work[run.measure : run.measure + 8], pools.moving[run.scales : run.scales + 3]
    measure[7] = min(1.0, np.sqrt(run.amplified * moved / size)) if size > 0.0 else 1.0
    measure[2] = max(scales[0], measure[7] ** 2 * size / window)
    measure[0] = np.sqrt(difference / window / measure[2])
    measure[1] = np.nan
    measure[3], measure[4] = scales[1], scales[2]
    return float(measure[0])


@kernel
def class_norms(pools: Any, c: int, window: int) -> None:
    """Squared norms of the forces and of their half residuals of a class at the instants of the window, into
    ``class_norms``."""
    parts, row = 1 + pools.run[0].tangential, pools.classes[c]
    pools.moving[row.class_norms : row.class_norms + 4 * window] = 0.0
    for i in range(window):
        start, at = 0, 0
        if row.swept == 1 and row.normal_points > 0:
            for part in range(parts):
                add_table_norms(pools, c, i, part, gain_of(row, pools.run[0]))
            continue
        if row.swept == 1:
            _add_swept_norms(pools, c, i, parts)
            continue
        for part in range(parts):
            n = row.n_normal if part == 0 else row.n_live - row.n_normal
            if n > 0:
                _add_norms(pools, c, i, start, n, row.compliance + at, 2 * part)
            start += n
            at += symmetric_size(n, row.plain_response, row.m)


@kernel
def add_class_norms(pools: Any, window: int) -> None:
    """Sums of the ``class_norms`` over the classes, into ``norms``."""
    run, work = pools.run[0], pools.moving
    for e in range(4 * window):
        total = 0.0
        for c in range(len(pools.classes)):
            total += work[pools.classes[c].class_norms + e]
        work[run.norms + e] = total


@kernel
def relative_forces(pools: Any, window: int) -> float:
    """Largest relative force residual over the instants of the window by the ``norms`` of all substructures;
    ``measure[3:5]``: largest norms of normal and tangential forces with this iterate."""
    run, work = pools.run[0], pools.moving
    measure = work[run.measure : run.measure + 8]
    parts, error_n, error_t = 1 + run.tangential, 0.0, 0.0
    for i in range(window):
        total = work[run.norms + 4 * i : run.norms + 4 * i + 4]
        for part in range(parts):
            measure[3 + part] = max(measure[3 + part], measure[7] * np.sqrt(max(total[2 * part], 0.0)))
        error_n = max(error_n, np.sqrt(max(total[1], 0.0)))
        if parts == 2:
            error_t = max(error_t, np.sqrt(max(total[3], 0.0)))
    measure[4] = max(measure[4], TANGENTIAL_FLOOR * measure[3])
    measure[1] = max(error_n / measure[3], error_t / measure[4] if parts == 2 else 0.0)
    return float(measure[1])


@kernel
def _add_norms(pools: Any, c: int, i: int, start: int, n: int, compliance: int, into: int) -> None:
    """Add x C x of the nodal forces and of their half residuals on the n channels ``measured`` from ``start`` on."""
    row, run, work = pools.classes[c], pools.run[0], pools.moving
    m = row.m
    channels = pools.fixed_int[row.channels : row.channels + row.n_channel * m]
    measured = pools.fixed_int[row.measured + start : row.measured + start + n]
    area = pools.fixed[run.area : run.area + run.n_flat]
    f_hat = work[run.local_f + i * run.n_flat : run.local_f + (i + 1) * run.n_flat]
    r = work[run.r + i * run.n_flat : run.r + (i + 1) * run.n_flat]
    x = work[row.vectors : row.vectors + 2 * m * n]
    table = pools.fixed[compliance : compliance + symmetric_size(n, row.plain_response, m)]
    force, half = 0.0, 0.0
    if m < TILED and row.plain_response == 0:  # two rows (2, n) per member
        for j in range(m):
            for e in range(n):
                at = channels[measured[e] * m + j]
                x[e], x[n + e] = area[at] * f_hat[at], 0.5 * area[at] * r[at]
            own, other = two_norms(n, table, x)
            force += own
            half += other
    else:  # all vectors as members of one product (n, 2 m)
        for e in range(n):
            for j in range(m):
                at = channels[measured[e] * m + j]
                x[e * 2 * m + 2 * j], x[e * 2 * m + 2 * j + 1] = area[at] * f_hat[at], 0.5 * area[at] * r[at]
        y = work[row.answers : row.answers + 2 * m * n]
        dense(pools, c, n, table, row.plain_response, 2 * m, x, y)
        for e in range(n * m):
            force += x[2 * e] * y[2 * e]
            half += x[2 * e + 1] * y[2 * e + 1]
    work[row.class_norms + 4 * i + into] += force
    work[row.class_norms + 4 * i + into + 1] += half


@kernel
def _add_swept_norms(pools: Any, c: int, i: int, parts: int) -> None:
    """The same for all parts by forward substitution on the face, x C x = gain |L^-1 T^T x|^2: for each member its
    forces and half residuals, normal and tangential, eight vectors at a time; four one after the other where there are
    no more and the factor is larger than the cache."""
    row, run, work, numbers = pools.classes[c], pools.run[0], pools.moving, pools.fixed_int
    n, m, count = row.n, row.m, 2 * parts * row.m
    channels, normal = numbers[row.channels : row.channels + row.n_channel * m], numbers[row.component :]
    face, starts = numbers[row.face : row.face + row.n_inner], numbers[row.spread_starts :]
    columns, values = pools.fixed_col[row.spread_columns :], pools.fixed[row.spread_values :]
    area = pools.fixed[run.area : run.area + run.n_flat]
    f_hat = work[run.local_f + i * run.n_flat : run.local_f + (i + 1) * run.n_flat]
    r = work[run.r + i * run.n_flat : run.r + (i + 1) * run.n_flat]
    x, tail = work[row.face_vector : row.face_vector + LANES * n], work[row.tile : row.tile + SPARE * LANES]
    gain, four = gain_of(row, run), count <= 4 and row.grouped == 0
    step, apart = (1, n) if four else (LANES, 1)
    for first in range(0, count, LANES):
        x[:] = 0.0
        for lane in range(min(LANES, count - first)):
            part, member = (first + lane) // (2 * m), (first + lane) % m
            half = (first + lane) // m % 2 == 1
            for d in range(row.n_inner):
                total = 0.0
                for e in range(starts[d], starts[d + 1]):
                    if normal[columns[e]] == part:
                        at = channels[np.int64(columns[e]) * m + member]
                        total += values[e] * area[at] * (0.5 * r[at] if half else f_hat[at])
                x[step * face[d] + apart * lane] = total
        forward_on_face(pools, c, four, x, tail)
        for lane in range(min(LANES, count - first)):
            total = 0.0
            for d in range(n):
                total += x[step * d + apart * lane] ** 2
            part, half = (first + lane) // (2 * m), (first + lane) // m % 2
            work[row.class_norms + 4 * i + 2 * part + half] += gain * total


@kernel
def accept(pools: Any, window: int) -> None:
    """Take over the scales of the accepted iterate, and bring the largest indicator of each interface up to date."""
    run, work, state = pools.run[0], pools.moving, pools.moving
    n = run.n_flat
    for e in range(3):
        state[run.scales + e] = work[run.measure + 2 + e]
    state[run.finish] = 1.0 if work[run.course] > 0.0 else 0.0  # steps made (``newton.MADE``)
    share = work[run.shares : run.shares + run.n_interface]
    share[:] = 0.0
    weights, interface = (
        pools.fixed[run.weights : run.weights + n],
        pools.fixed_int[run.interface : run.interface + n],
    )
    for i in range(window):
        r = work[run.r + i * n : run.r + (i + 1) * n]
        for j in range(n):
            share[interface[j]] += weights[j] * r[j] * r[j] / window
    worst, scale = state[run.worst : run.worst + run.n_interface], state[run.scales]
    for e in range(run.n_interface):
        worst[e] = max(worst[e], np.sqrt(share[e] / scale))
