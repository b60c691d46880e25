"""Error indicator (24), force residual and work of the error: when to stop.

    eta = ||s - s_hat||^2 / (||s||^2 + ||s_hat||^2),  ||s||^2 = sum of int (F - F_0) Z^-1 (F - F_0) + int [W] Z_r [W]

over interfaces, sides and the instants of the window, Z the material impedance of the side whatever k is used;
``error_indicator`` is sqrt(eta). The size of the fields is that of what moves: the change of the tractions since the
equilibrium F_0 that the motion starts from (static start, preload), and the velocities of the sides relative to their
common motion, which are [W] = W' - W with Z_r = Z Z' / (Z + Z'), Z where the other side is ground. Neither a preload
nor a ride of the whole assembly loosens the measure. Without inertia the denominator leaves out the velocities: a body
may travel far under next to no force. By E+, F_hat - F = r/2 and W_hat - W = r/(2k) with the residual
r = (F_hat + k W_hat) - q. Changes below STILL of the tractions are resolved as one of that size; a residual below
NOTHING of the whole tractions and velocities is round-off.

The indicator alone weights shear and the soft side of a contrast too little. A window has converged when the indicator,
the force residual and the work of the error are within their limits. The force residual is the norm sqrt(f . C f) of
the nodal forces f of F - F_hat, with the admittance C of one instant: the velocity error that these forces would cause.
Normal and tangential parts are each relative to their own largest value so far, in the share of the tractions that
changes, at least to a tenth of the size of the fields.

The work of the error is that of the tractions on the velocities that the laws do not allow. Tractions F_hat act at the
end of a window of one instant, with which the channels move at W + C (F_hat - F), where the laws say W_hat:

    power = sum of area F_hat . (W - W_hat) + f_hat . C (f_hat - f)

In windows of several F acts: power = sum of area (F . W - F_hat . W_hat). It may be a share of BUDGET times the energy
put in so far, OF_LONG times that in long steps and windows.
"""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import NDArray

from ..cholesky.substitution import LANES, SPARE, TILED
from ..compiled import kernel
from .energy_parts import LARGEST, N_WORK, NET, OF_DRIFT, OF_GROUND, PUT_IN, STORED, WORK_OF_LOADS
from .half_solves import forward_on_face, gain_of
from .patched import memory_for, patched_norms
from .products import symmetric_size, two_norms
from .sparse_response import add_table_norms
from .splits import dense, tile_of
from .sums import MEASURES, add_parts

Array = NDArray[np.float64]

TANGENTIAL_FLOOR = 1e-2
"""Smallest scale of tangential forces over that of normal ones."""
FLYING_FLOOR = 0.1
"""Smallest scale of normal forces over the root of the size of the fields (both are roots of a power)."""
BUDGET, OF_LONG = 2e-5, 1e-4
"""Share of the energy put in that errors may do as work, a fifth of what a run promises, since to make them up later
takes as many times the work as the pressure has risen; where time steps are longer than waves take through an element,
and in windows of several instants: there the scheme dissipates more than that, and an iteration gains less."""
SHARE = 0.15
SHARE_OF_LONG = 0.03
SHARE_OF_WINDOW = 0.5
"""Share of what is left of it for an instant, for one of long steps (as much work), for a window of several."""
LEAST = 0.1
"""Share of this that an instant may always do."""
STILL, NOTHING = 1e-9, 1e-12
"""Change of the tractions over these up to which a joint is at rest: smaller motions are resolved as one of this size.
Residual over the whole tractions and velocities, preload and ride included, that is round-off."""


@kernel
def error_indicator(pools: Any, window: int) -> float:
    """Residual r of q and sqrt(eta) over the window; ``measure[2]``: largest norm of the fields with this iterate."""
    residual_parts(pools, window)
    return set_error(pools, window)


@kernel
def residual_parts(pools: Any, window: int) -> None:
    """Residual r of q over the window, and the sums of ``set_error`` over each interface, into ``own_parts``."""
    run, work = pools.run[0], pools.moving
    for e in range(run.n_interface):
        at = run.own_parts + e * run.part_width
        work[at : at + MEASURES] = 0.0
        for i in range(window):
            _add_parts(pools, e, i, window, work[at : at + MEASURES])


@kernel
def _add_parts(pools: Any, e: int, i: int, window: int, parts: Array) -> None:
    """Residual r of q of an interface at instant i of the window; adds to its sums."""
    run = pools.run[0]
    work = pools.moving
    fixed = pools.fixed
    n = pools.run[0].n_flat
    size, alone = pools.fixed_int[run.segments + 3 * e + 2], window == 1
    difference = 0.0
    changed = 0.0
    tractions = 0.0
    whole = 0.0
    power = 0.0
    for side in range(pools.fixed_int[run.sides + e]):  # ground weighs nothing, and moves as the law says
        at = pools.fixed_int[run.segments + 3 * e + side]
        k, still = fixed[run.k + at : run.k + at + size], fixed[run.still + at : run.still + at + size]
        of_r, area = fixed[run.weights + at : run.weights + at + size], fixed[run.area + at : run.area + at + size]
        of_f = fixed[run.weights + n + at : run.weights + n + at + size]
        of_w = fixed[run.weights + 2 * n + at : run.weights + 2 * n + at + size]
        at += i * n
        q, r = work[run.q + at : run.q + at + size], work[run.r + at : run.r + at + size]
        f, w = work[run.f + at : run.f + at + size], work[run.w + at : run.w + at + size]
        f_hat = work[run.local_f + at : run.local_f + at + size]
        w_hat = work[run.local_w + at : run.local_w + at + size]
        for j in range(size):
            rest = f_hat[j] + k[j] * w_hat[j] - q[j]
            r[j] = rest
            difference += of_r[j] * rest * rest
            changed += of_f[j] * ((f[j] - still[j]) ** 2 + (f_hat[j] - still[j]) ** 2)
            tractions += of_f[j] * (f[j] * f[j] + f_hat[j] * f_hat[j])
            whole += of_w[j] * (w[j] * w[j] + w_hat[j] * w_hat[j])
            # F_hat acts at the end of a window of one instant, in longer ones F; ground (k = 0) moves as it is driven
            acting = f_hat[j] if alone or k[j] == 0.0 else f[j]
            power += area[j] * (acting * w[j] - f_hat[j] * w_hat[j])
    near, far = pools.fixed_int[run.segments + 3 * e], pools.fixed_int[run.segments + 3 * e + 1]
    # the same at both sides: read at side E
    of_w = fixed[run.weights + 3 * n + near :][:size]
    near, far = near + i * n, far + i * n
    first, second = work[run.w + near :][:size], work[run.w + far :][:size]
    first_hat, second_hat = work[run.local_w + near :][:size], work[run.local_w + far :][:size]
    relative = 0.0
    for j in range(size):
        relative += of_w[j] * ((second[j] - first[j]) ** 2 + (second_hat[j] - first_hat[j]) ** 2)
    parts[0] += difference
    parts[1] += changed + relative
    parts[2] += tractions
    parts[3] += changed
    parts[4] += tractions + whole
    parts[5] += power


@kernel
def set_error(pools: Any, window: int) -> float:
    """sqrt(eta) over the window from the ``parts`` of all interfaces: sums of weighted squares of r; of the change of
    the tractions and the relative velocities; of the tractions; of their change; of tractions and velocities; power."""
    run, work = pools.run[0], pools.moving
    add_parts(pools, 0, MEASURES)
    totals = work[run.totals : run.totals + MEASURES]
    measure, scales = work[run.measure : run.measure + 9], pools.moving[run.scales : run.scales + 3]
    # share of the tractions that changes, in the norm of the indicator
    measure[7] = min(1.0, max(STILL, np.sqrt(totals[3] / totals[2]))) if totals[2] > 0.0 else 1.0
    measure[2] = max(scales[0], max(totals[1], STILL * STILL * totals[2]) / window)
    # numbers out of range are no round-off
    nothing = np.isfinite(totals[4]) and totals[0] <= min(NOTHING, run.tolerance) ** 2 * totals[4]
    measure[0] = 0.0 if nothing else np.sqrt(totals[0] / window / measure[2])
    measure[1] = np.nan
    measure[3], measure[4] = scales[1], scales[2]
    return float(measure[0])


@kernel
def class_norms(pools: Any, c: int, window: int) -> None:
    """Squared norms of the forces and of their half residuals of a class at the instants of the window, into
    ``class_norms``; powers of these forces on the velocities that the half residuals give, into ``cross``."""
    parts, row = 1 + pools.run[0].tangential, pools.classes[c]
    pools.moving[row.class_norms : row.class_norms + 4 * window] = 0.0
    pools.moving[row.cross : row.cross + window] = 0.0
    for i in range(window):
        start, at = 0, 0
        # by the tables of C, by substitution on the face, or by dense C
        if row.swept == 1 and row.normal_points > 0:
            for part in range(parts):
                add_table_norms(pools, c, i, part, gain_of(row, pools.run[0]))
            continue
        if row.swept == 1:
            _add_swept_norms(pools, c, i, parts)
            continue
        if row.patched == 1:
            _add_patched_norms(pools, c, i, parts)
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
    work[run.norms + 4 * window] = cross_of_classes(pools, window)


@kernel
def own_norms(pools: Any, window: int) -> None:
    """Of this process, for those of all: norms of its classes, whether a traction acts at the end of the window, energy
    put in, work of the drift, power of the forces (``cross``)."""
    run, work = pools.run[0], pools.moving
    to = run.own_norms
    for c in range(len(pools.classes)):
        for e in range(4 * window):
            work[to] = work[pools.classes[c].class_norms + e]
            to += 1
    # at the last instant of the window
    f_hat, acts = work[run.local_f + (window - 1) * run.n_flat : run.local_f + window * run.n_flat], 0.0
    for j in range(run.n_flat):
        if f_hat[j] != 0.0:
            acts = 1.0
            break
    work[to], work[to + 1], work[to + 2] = acts, own_put_in(pools), pools.moving[run.works + OF_DRIFT]
    work[to + 3] = cross_of_classes(pools, window)


@kernel
def add_all_norms(pools: Any, window: int) -> None:
    """``add_class_norms`` and ``take_works`` from the ``own_norms`` of all processes."""
    run, work = pools.run[0], pools.moving
    for e in range(4 * window):
        total = 0.0
        # rows of classes first, then one of each process
        for r in range(run.n_norm - run.n_process):
            total += work[run.all_norms + pools.fixed_int[run.norm_order + r] * 4 * window + e]
        work[run.norms + e] = total
    acts = 0.0
    put_in = 0.0
    drift = 0.0
    complete = True
    cross = 0.0
    for r in range(run.n_norm - run.n_process, run.n_norm):
        at = run.all_norms + pools.fixed_int[run.norm_order + r] * 4 * window
        acts = max(acts, work[at])
        put_in = put_in + work[at + 1]
        drift = drift + work[at + 2]
        complete, cross = complete and work[at + 1] >= 0.0, cross + work[at + 3]
    work[run.norms + 4 * window] = cross
    work[run.acting] = acts
    take_works(pools, put_in if complete else -1.0, drift)


@kernel
def cross_of_classes(pools: Any, window: int) -> float:
    """Sum of ``cross`` over the classes here and the instants of the window."""
    total = 0.0
    for c in range(len(pools.classes)):
        for i in range(window):
            total += pools.moving[pools.classes[c].cross + i]
    return float(total)


@kernel
def relative_forces(pools: Any, window: int) -> float:
    """Largest relative force residual over the instants of the window by the ``norms`` of all substructures;
    ``measure[3:5]``: largest norms of normal and tangential forces with this iterate."""
    run, work = pools.run[0], pools.moving
    measure = work[run.measure : run.measure + 8]
    parts = 1 + run.tangential
    error_n = 0.0
    error_t = 0.0
    for i in range(window):
        total = work[run.norms + 4 * i : run.norms + 4 * i + 4]
        for part in range(parts):
            # the largest so far is of what changes: the norm is that of the whole tractions
            measure[3 + part] = max(measure[3 + part], measure[7] * np.sqrt(max(total[2 * part], 0.0)))
        # of forces that stay as they are the tolerance is below their round-off; without inertia parts of the forces
        # alone are not in balance, and their norm on weak dashpots is no size
        least = 0.0 if run.static == 1 else NOTHING**2 * max(total[0], total[2] if parts == 2 else 0.0)
        error_n = max(error_n, 0.0 if total[1] <= least else np.sqrt(total[1]))
        if parts == 2:
            error_t = max(error_t, 0.0 if total[3] <= least else np.sqrt(total[3]))
    # what moves at open interfaces counts, too: beside a body in flight a joint at rest is resolved as far as that
    measure[3] = max(measure[3], FLYING_FLOOR * np.sqrt(measure[2]))
    measure[4] = max(measure[4], TANGENTIAL_FLOOR * measure[3])
    measure[1] = max(error_n / measure[3], error_t / measure[4] if parts == 2 else 0.0)
    power = work[run.totals + 5]
    if window == 1:  # F_hat acts, not F
        power += work[run.norms + 4 * window]
    if run.shared == 0:
        take_works(pools, own_put_in(pools), work[run.works + OF_DRIFT])
    work[run.measure + 8] = work_of_error(pools, window, power)
    if measure[0] == 0.0:  # nothing moves
        measure[1] = work[run.measure + 8] = 0.0
    return float(measure[1])


@kernel
def own_put_in(pools: Any) -> float:
    """Energy put in so far, J: kinetic and elastic energy of the classes here at the start, work of loads, of
    prescribed motions and of moving ground. Negative where a class has no account of energies."""
    run, state = pools.run[0], pools.moving
    total = state[run.works + STORED] + state[run.works + OF_GROUND]
    for c in range(len(pools.classes)):
        row = pools.classes[c]
        if row.accounted == 0:  # not known
            return -1.0
        for j in range(row.m):
            total += state[row.totals + WORK_OF_LOADS * row.m + j]
    return float(total)


@kernel
def take_works(pools: Any, put_in: float, drift: float) -> None:
    """Largest energy put in so far, and work of the drift, of all processes."""
    works = pools.moving[pools.run[0].works : pools.run[0].works + N_WORK]
    # never falls: what was put in counts when it is taken out again; -1: not known
    works[PUT_IN], works[NET] = max(works[PUT_IN], put_in) if put_in >= 0.0 else -1.0, drift
    works[LARGEST] = max(works[LARGEST], abs(drift))


@kernel
def work_of_error(pools: Any, window: int, power: float) -> float:
    """Work that an error of this power does over the window, relative to what it may do; 0 without inertia and where
    energies are not accounted for.

    All instants together may do BUDGET (OF_LONG) of the energy put in, each of them a share of what is left.
    """
    run, work = pools.run[0], pools.moving
    put_in, net = work[run.works + PUT_IN], work[run.works + NET]
    if run.static == 1 or put_in < 0.0:
        return 0.0
    # what passes the interfaces in the window: of that much the loads put in what is not known yet
    put_in = max(put_in, work[run.measure + 2] * window * run.dt)
    if put_in <= 0.0:
        return 0.0
    share, budget = (SHARE, BUDGET) if run.from_last == 1 else (SHARE_OF_LONG, OF_LONG)
    share = share if window == 1 else SHARE_OF_WINDOW
    # a share of what the drift has left of the budget, but never less than LEAST of the whole
    allowed = share * budget * put_in * max(1.0 - abs(net) / (budget * put_in), LEAST)
    return float(abs(power) * run.dt / allowed) if allowed > 0.0 else 0.0


@kernel
def _add_norms(pools: Any, c: int, i: int, start: int, n: int, compliance: int, into: int) -> None:
    """Add x C x of the nodal forces and of their half residuals on the n channels ``measured`` from ``start`` on."""
    row = pools.classes[c]
    run = pools.run[0]
    work = pools.moving
    m = row.m
    channels = pools.fixed_int[row.channels : row.channels + row.n_channel * m]
    measured = pools.fixed_int[row.measured + start : row.measured + start + n]
    area = pools.fixed[run.area : run.area + run.n_flat]
    f_hat = work[run.local_f + i * run.n_flat : run.local_f + (i + 1) * run.n_flat]
    r = work[run.r + i * run.n_flat : run.r + (i + 1) * run.n_flat]
    x = work[row.vectors : row.vectors + 2 * m * n]
    size = symmetric_size(n, row.plain_response, m)
    single = pools.fixed_single[compliance : compliance + (size if row.halved_norms == 1 else 0)]
    table = pools.fixed[compliance : compliance + (0 if row.halved_norms == 1 else size)]
    force = 0.0
    half = 0.0
    cross = 0.0
    if m < TILED and row.plain_response == 0:  # two rows (2, n) per member
        for j in range(m):
            for e in range(n):
                at = channels[measured[e] * m + j]
                x[e], x[n + e] = area[at] * f_hat[at], 0.5 * area[at] * r[at]
            of_force, of_half, both = two_norms(n, single, x) if row.halved_norms == 1 else two_norms(n, table, x)
            force += of_force
            half += of_half
            cross += both
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
            cross += x[2 * e + 1] * y[2 * e]  # half residual . C force
    work[row.class_norms + 4 * i + into] += force
    work[row.class_norms + 4 * i + into + 1] += half
    work[row.cross + i] += cross


@kernel
def _add_patched_norms(pools: Any, c: int, i: int, parts: int) -> None:
    """``_add_norms`` of all parts of a class in patches, C being the gain of the scheme times S^-1."""
    row = pools.classes[c]
    run = pools.run[0]
    work = pools.moving
    n = row.n_live
    measured = pools.fixed_int[row.measured :]
    place = pools.fixed_int[row.measured_place :]
    x = work[row.vectors : row.vectors + 4 * n]
    sums = work[row.answers : row.answers + 6]
    gain = gain_of(row, run)
    x[:] = 0.0
    for e in range(n):
        at, to = pools.fixed_int[row.channels + measured[e]], place[e] + (0 if e < row.n_normal else 2 * n)
        x[to] = pools.fixed[run.area + at] * work[run.local_f + i * run.n_flat + at]
        x[n + to] = 0.5 * pools.fixed[run.area + at] * work[run.r + i * run.n_flat + at]
    header, numbers = pools.fixed_int[row.inverse_header :], pools.fixed_single[row.schur_inverse :]
    patched_norms(header, numbers, x, parts, memory_for(tile_of(row, work), numbers), sums)
    for part in range(parts):
        work[row.class_norms + 4 * i + 2 * part] += gain * sums[3 * part]
        work[row.class_norms + 4 * i + 2 * part + 1] += gain * sums[3 * part + 1]
        work[row.cross + i] += gain * sums[3 * part + 2]


@kernel
def _add_swept_norms(pools: Any, c: int, i: int, parts: int) -> None:
    """The same for all parts by forward substitution on the face, x C x = gain |L^-1 T^T x|^2: for each member its
    forces and half residuals in turn, normal, then tangential, eight vectors at a time; four one after the other where
    there are no more and the factor is larger than the cache."""
    row = pools.classes[c]
    run = pools.run[0]
    work = pools.moving
    numbers = pools.fixed_int
    n = row.n
    m = row.m
    count = 2 * parts * row.m
    channels, normal = numbers[row.channels : row.channels + row.n_channel * m], numbers[row.component :]
    face, starts = numbers[row.face : row.face + row.n_inner], numbers[row.spread_starts :]
    columns, values = pools.fixed_col[row.spread_columns :], pools.fixed[row.spread_values :]
    area = pools.fixed[run.area : run.area + run.n_flat]
    f_hat = work[run.local_f + i * run.n_flat : run.local_f + (i + 1) * run.n_flat]
    r = work[run.r + i * run.n_flat : run.r + (i + 1) * run.n_flat]
    x, tail = work[row.face_vector : row.face_vector + LANES * n], work[row.tile : row.tile + SPARE * LANES]
    gain, four = gain_of(row, run), count <= 4 and row.grouped == 0
    # entry d of vector l at step d + apart l: tiles, or vectors one after the other
    step, apart = (1, n) if four else (LANES, 1)
    for first in range(0, count, LANES):
        x[:] = 0.0
        for lane in range(min(LANES, count - first)):
            part = (first + lane) // (2 * m)
            member = (first + lane) // 2 % m
            half = (first + lane) % 2 == 1
            for d in range(row.n_inner):
                total = 0.0
                for e in range(starts[d], starts[d + 1]):
                    if normal[columns[e]] == part:  # normal or tangential
                        at = channels[np.int64(columns[e]) * m + member]
                        total += values[e] * area[at] * (0.5 * r[at] if half else f_hat[at])
                x[step * face[d] + apart * lane] = total
        forward_on_face(pools, c, four, x, tail)
        for lane in range(min(LANES, count - first)):
            part = (first + lane) // (2 * m)
            odd = lane % 2
            offset = apart * lane
            total = 0.0
            cross = 0.0
            # forces stand in even lanes, their half residuals next to them
            other = apart * (lane - odd)  # the force of this half residual
            for d in range(n):
                total += x[step * d + offset] ** 2
                cross += x[step * d + offset] * x[step * d + other]
            work[row.class_norms + 4 * i + 2 * part + odd] += gain * total
            work[row.cross + i] += odd * gain * cross
