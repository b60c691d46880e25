"""The LATIN loop over one instant: kernel twin to ``latin.solver`` up to the point where a fall-back is called for."""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import NDArray

from ..compiled import kernel
from .groups import local_stage
from .least_squares import least_squares
from .substructure import respond
from .views import floats, integers, table_of_floats

Array = NDArray[np.float64]


@kernel
def mismatch(classes: Any, flat: Any, work: Any, limits: Any, reached: Array) -> float:
    """Largest relative force mismatch; ``reached`` (3,) scales that the iterate would leave (its last two here).

    Norms with C of tractions and half residuals, normal and (where there are any) tangential: the blocks of C between
    normal channels and between tangential ones.
    """
    reached[1], reached[2] = work.scales[1], work.scales[2]
    parts = 1 + limits.tangential
    total = work.norms
    total[:] = 0.0
    for c in range(len(classes)):
        row = classes[c]
        start, at = 0, 0
        for part in range(parts):
            n = row.n_normal if part == 0 else row.n_live - row.n_normal
            if n > 0:
                total[2 * part], total[2 * part + 1] = add_norms(
                    row, flat, work, start, n, at, total[2 * part], total[2 * part + 1]
                )
            start += n
            at += compliance_size(row, n)
    for part in range(parts):
        reached[1 + part] = max(reached[1 + part], np.sqrt(max(total[2 * part], 0.0)))
    reached[2] = max(reached[2], limits.tangential_floor * reached[1])
    worst = 0.0
    for part in range(parts):
        worst = max(worst, np.sqrt(max(total[2 * part + 1], 0.0)) / reached[1 + part])
    return worst


@kernel
def compliance_size(row: Any, n: int) -> int:
    """Numbers of a block of C between n channels (see ``classes``)."""
    if row.plain_response == 1:
        return int(n)
    return int(n * (n + 1) // 2 if row.m == 1 else n * n)


@kernel
def add_norms(
    row: Any, flat: Any, work: Any, start: int, n: int, block: int, force: float, half: float
) -> tuple[float, float]:
    """``force`` and ``half`` with x C x of the tractions and of the half residuals of n channels added.

    The channels are ``measured`` from ``start`` on, their block of C begins ``block`` numbers into it.
    """
    m = row.m
    channels, measured = integers(row.channels, row.n_channel * m), integers(row.measured + 8 * start, n)
    vectors = table_of_floats(row.vectors, 2 * m, n)
    for i in range(n):
        for j in range(m):
            at = channels[measured[i] * m + j]
            vectors[2 * j, i] = flat.area[at] * work.f_hat[at]
            vectors[2 * j + 1, i] = 0.5 * flat.area[at] * work.residual[at]
    compliance = row.compliance + 8 * block
    if row.plain_response == 1:
        diagonal = floats(compliance, n)
        for j in range(m):
            for i in range(n):
                force += diagonal[i] * vectors[2 * j, i] * vectors[2 * j, i]
                half += diagonal[i] * vectors[2 * j + 1, i] * vectors[2 * j + 1, i]
        return force, half
    if m == 1:
        own, other = two_norms(n, floats(compliance, n * (n + 1) // 2), vectors)
        return force + own, half + other
    answer = table_of_floats(row.answers, 2 * m, n)
    np.dot(vectors, table_of_floats(compliance, n, n), answer)
    for j in range(m):
        for i in range(n):
            force += vectors[2 * j, i] * answer[2 * j, i]
            half += vectors[2 * j + 1, i] * answer[2 * j + 1, i]
    return force, half


@kernel
def two_norms(n: int, a: Array, x: Array) -> tuple[float, float]:
    """x A x of the two rows of x (2, n), A packed (see ``products.packed_product``)."""
    x0, x1 = x[0], x[1]
    first, second, at = 0.0, 0.0, 0
    for i in range(n):
        line = a[at : at + i]
        t0 = t1 = 0.0
        for j in range(i):
            t0 += line[j] * x0[j]
            t1 += line[j] * x1[j]
        corner = a[at + i]
        first += x0[i] * (2.0 * t0 + corner * x0[i])
        second += x1[i] * (2.0 * t1 + corner * x1[i])
        at += i + 1
    return first, second


@kernel
def next_iterate(flat: Any, work: Any, limits: Any, count: int) -> None:
    """q of the next iteration: relaxation, or Anderson acceleration with ``count`` differences seen before.

    The least-squares problem is solved through the Cholesky factor of its scaled Gram matrix; directions whose pivot
    is below ``limits.rank`` are dropped (twin: ``latin.kernels.anderson``).
    """
    depth, n_flat = len(work.dq), len(work.q)
    q, residual = work.q, work.residual
    if depth == 0 or count < 0:
        for j in range(n_flat):
            work.last_q[j], work.last_residual[j] = q[j], residual[j]
            q[j] += limits.relaxation * residual[j]
        return
    row, kept = count % depth, min(count + 1, depth)
    dq, dr = work.dq[:, 0], work.dr[:, 0]
    for j in range(n_flat):
        dq[row, j] = q[j] - work.last_q[j]
        dr[row, j] = residual[j] - work.last_residual[j]
        work.last_q[j], work.last_residual[j] = q[j], residual[j]
    right = np.empty(kept)
    new = dr[row]
    for a in range(kept):
        product, projection = 0.0, 0.0
        old = dr[a]
        for j in range(n_flat):
            weighted = flat.acceleration[j] * old[j]
            product += weighted * new[j]
            projection += weighted * residual[j]
        work.gram[row, a] = product
        work.gram[a, row] = product
        right[a] = projection
    gamma = least_squares(work.gram, right, kept, limits.rank)
    for j in range(n_flat):
        q[j] += limits.relaxation * residual[j]
    for a in range(kept):
        if gamma[a] != 0.0:
            past_q, past_r = dq[a], dr[a]
            for j in range(n_flat):
                q[j] -= gamma[a] * (past_q[j] + limits.relaxation * past_r[j])


@kernel
def close(flat: Any, work: Any) -> tuple[float, float]:
    """Residual of q and the two sums of the indicator; twin of ``latin.kernels.close`` for one instant."""
    difference, size = 0.0, 0.0
    weights = flat.weights
    for j in range(len(work.q)):
        r = work.f_hat[j] + flat.k[j] * work.w_hat[j] - work.q[j]
        work.residual[j] = r
        difference += weights[0, j] * r * r
        size += weights[1, j] * (work.f[j] * work.f[j] + work.f_hat[j] * work.f_hat[j])
        size += weights[2, j] * (work.w[j] * work.w[j] + work.w_hat[j] * work.w_hat[j])
    return difference, size


@kernel
def stalled(errors: Array, known: Array, ratio: float, n: int, limits: Any) -> bool:
    """Whether the merits of the first n iterates have stopped falling (see ``latin.solver``)."""
    if n < limits.patience:
        return False
    before, recent = np.inf, np.inf
    for i in range(n):
        merit = known[i] if np.isfinite(known[i]) else ratio * errors[i] / limits.tolerance
        if i < n - limits.recent:
            before = min(before, merit)
        else:
            recent = min(recent, merit)
    return bool(recent > limits.stall * before)


@kernel
def iterate(
    classes: Any, groups: Any, flat: Any, work: Any, limits: Any, scheme: Any, instant: int, errors: Array,
    mismatches: Array,
) -> int:  # fmt: skip
    """Iterate from ``work.q``; iterations used where it converged, else minus that number.

    On success ``work`` holds the accepted iterate and ``work.scales`` what it leaves.
    """
    reached, ratio, count = np.empty(3), 1.0, -1
    enough = limits.unchanged * work.scales[0] / len(classes)
    for iteration in range(limits.max_iterations):
        for c in range(len(classes)):
            work.marched[1] += respond(
                classes[c],
                work.q,
                work.w,
                limits.rest_traction,
                flat.weights[0],
                enough if iteration > 0 else -1.0,
            )
        for g in range(len(flat.ground)):
            work.w[flat.ground[g]] = flat.ground_velocity[instant, g]
        for j in range(len(work.q)):
            traction = work.q[j] - flat.k[j] * work.w[j]
            work.f[j] = traction
            work.s[j] = work.w[j] - flat.z[j] * traction
        local_stage(groups, scheme, work.s, flat.z, work.f_hat, work.w_hat)
        difference, size = close(flat, work)
        reached[0], reached[1], reached[2] = max(work.scales[0], size), work.scales[1], work.scales[2]
        error = np.sqrt(difference / reached[0])
        forces = np.nan
        if error <= limits.tolerance:
            forces = mismatch(classes, flat, work, limits, reached)
        errors[iteration], mismatches[iteration] = error, forces
        merit, known = error / limits.tolerance, np.nan
        if np.isfinite(forces):
            known = max(merit, forces / limits.force_tolerance)
            if merit > 0.0:
                ratio = known / merit
        work.known[iteration] = known
        met = error <= limits.tolerance and forces <= limits.force_tolerance
        if met and (iteration > 0 or error <= limits.at_rest * limits.tolerance):
            work.scales[:] = reached
            return iteration + 1
        if not np.isfinite(error) or stalled(errors, work.known, ratio, iteration + 1, limits):
            return -(iteration + 1)
        next_iterate(flat, work, limits, count)
        count += 1
    return -int(limits.max_iterations)
