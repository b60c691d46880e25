"""Forward and backward substitution through the panels [L11^-1; L21] of a supernodal factor, row by row, in place.

Vectors are in elimination order, the interface dofs last: forward leaves [L^-1 b_I ; b_G - L_GI L^-1 b_I], backward
turns [y ; x_G] into [L^-T (y - L_GI^T x_G) ; x_G]. One vector, or a tile of eight side by side. Four rows at a time are
faster where the factor is in the cache; one after the other is faster from memory, which is then read in order.

Not ``whole``, a substitution is that of a face alone (``Symbolic.face_start``): forward for vectors that are zero
elsewhere, backward for the values on the face. It reads the columns of the supernodes from ``face_start`` on.
"""

from __future__ import annotations

from typing import Any, Final

import numpy as np
from numpy.typing import NDArray

from ..compiled import entry, ordered_kernel

Array = NDArray[np.float64]

LANES: Final = 8
TILED: Final = 3
"""Number of members from which on eight at a time cost less than one after the other."""
SPARE: Final = 4
"""Rows of eight that scratch has beyond those of the dofs."""
SLOT = 0
RANGES = 1
CLEARED = 3
CHILDREN = 5
FRONT = 7
STRIDE = 9
"""Numbers of a piece of a factor in its table (``pieces``): its vector, then place and length of its lists."""

_FACE = "i8[::1], i8[::1], i8[::1], i8[::1], i8[::1]"
_SWEEP = f"b1, {_FACE}"


@entry(f"b1, {_SWEEP}, f8[::1], f8[::1]", f"b1, {_SWEEP}, f4[::1], f8[::1]")
def forward_one(
    grouped: bool,
    whole: bool,
    first: Any,
    row_start: Any,
    rows: Any,
    panel_start: Any,
    face_start: Any,
    panels: Any,
    x: Array,
) -> None:
    """x (n,) := [L^-1 x_I ; x_G - L_GI L^-1 x_I]; ``grouped``: four rows of a panel at a time."""
    for s in range(len(first) - 1):
        width, c = first[s + 1] - first[s], 0 if whole else face_start[s]
        if c >= width:
            continue
        xs = x[first[s] + c : first[s + 1]]
        indices = rows[row_start[s] : row_start[s + 1]]
        # from column c on: entry j of a row is that of xs, while rows stay ``width`` apart
        panel = panels[panel_start[s] + c : panel_start[s + 1]]
        used, below = len(xs), len(indices)
        # from the last row up: a row of L11^-1 takes the entries before it as they were
        for i in range(used - 1, -1, -1):
            line = panel[(i + c) * width : (i + c) * width + i + 1]
            total = 0.0
            for j in range(i + 1):
                total += line[j] * xs[j]
            xs[i] = total
        at = width * width  # of L21, behind L11^-1
        i = 0
        while grouped and i + 4 <= below:
            l0, l1 = panel[at : at + used], panel[at + width : at + width + used]
            l2, l3 = panel[at + 2 * width : at + 2 * width + used], panel[at + 3 * width : at + 3 * width + used]
            t0 = t1 = t2 = t3 = 0.0
            for j in range(used):
                value = xs[j]
                t0 += l0[j] * value
                t1 += l1[j] * value
                t2 += l2[j] * value
                t3 += l3[j] * value
            x[indices[i]] -= t0
            x[indices[i + 1]] -= t1
            x[indices[i + 2]] -= t2
            x[indices[i + 3]] -= t3
            at += 4 * width
            i += 4
        while i < below:
            line = panel[at : at + used]
            total = 0.0
            for j in range(used):
                total += line[j] * xs[j]
            x[indices[i]] -= total
            at += width
            i += 1


@entry(f"{_FACE}, f8[::1], f8[::1]", f"{_FACE}, f4[::1], f8[::1]")
def forward_four(
    first: Any, row_start: Any, rows: Any, panel_start: Any, face_start: Any, panels: Any, x: Array
) -> None:
    """Forward substitution on the face of four vectors x (4, n), one after the other in memory: the factor, where it is
    larger than the cache, is read once for all."""
    n = first[len(first) - 1]
    x0 = x[:n]
    x1 = x[n : 2 * n]
    x2 = x[2 * n : 3 * n]
    x3 = x[3 * n : 4 * n]
    for s in range(len(first) - 1):
        width, c = first[s + 1] - first[s], face_start[s]
        if c >= width:  # the face is not coupled with this supernode
            continue
        begin, end = first[s] + c, first[s + 1]
        used, at = width - c, width * width  # rows of L21 begin behind L11^-1
        s0 = x0[begin:end]
        s1 = x1[begin:end]
        s2 = x2[begin:end]
        s3 = x3[begin:end]
        indices = rows[row_start[s] : row_start[s + 1]]
        panel = panels[panel_start[s] + c : panel_start[s + 1]]
        # from the last row on: row i of a lower triangle reads entries up to i, which are still the old ones
        for i in range(used - 1, -1, -1):
            line = panel[(i + c) * width : (i + c) * width + i + 1]
            t0 = t1 = t2 = t3 = 0.0
            for j in range(i + 1):
                t0 += line[j] * s0[j]
                t1 += line[j] * s1[j]
                t2 += line[j] * s2[j]
                t3 += line[j] * s3[j]
            s0[i] = t0
            s1[i] = t1
            s2[i] = t2
            s3[i] = t3
        for i in range(len(indices)):
            line = panel[at + i * width : at + i * width + used]
            t0 = t1 = t2 = t3 = 0.0
            for j in range(used):
                t0 += line[j] * s0[j]
                t1 += line[j] * s1[j]
                t2 += line[j] * s2[j]
                t3 += line[j] * s3[j]
            x0[indices[i]] -= t0
            x1[indices[i]] -= t1
            x2[indices[i]] -= t2
            x3[indices[i]] -= t3


@entry(f"b1, {_SWEEP}, f8[::1], f8[::1]", f"b1, {_SWEEP}, f4[::1], f8[::1]")
def backward_one(
    grouped: bool,
    whole: bool,
    first: Any,
    row_start: Any,
    rows: Any,
    panel_start: Any,
    face_start: Any,
    panels: Any,
    x: Array,
) -> None:
    """x (n,) := [L^-T (x_I - L_GI^T x_G) ; x_G]."""
    for s in range(len(first) - 2, -1, -1):
        width, c = first[s + 1] - first[s], 0 if whole else face_start[s]
        if c >= width:
            continue
        xs = x[first[s] + c : first[s + 1]]
        indices = rows[row_start[s] : row_start[s + 1]]
        panel = panels[panel_start[s] + c : panel_start[s + 1]]
        used, below = len(xs), len(indices)
        at = width * width
        i = 0
        while grouped and i + 4 <= below:
            l0, l1 = panel[at : at + used], panel[at + width : at + width + used]
            l2, l3 = panel[at + 2 * width : at + 2 * width + used], panel[at + 3 * width : at + 3 * width + used]
            a0 = x[indices[i]]
            a1 = x[indices[i + 1]]
            a2 = x[indices[i + 2]]
            a3 = x[indices[i + 3]]
            for j in range(used):
                xs[j] -= (l0[j] * a0 + l1[j] * a1) + (l2[j] * a2 + l3[j] * a3)
            at += 4 * width
            i += 4
        while i < below:
            line = panel[at : at + used]
            a0 = x[indices[i]]
            for j in range(used):
                xs[j] -= line[j] * a0
            at += width
            i += 1
        for i in range(used):
            line = panel[(i + c) * width : (i + c) * width + i + 1]
            # entries beyond i - 1 are untouched so far: row k of L11^-1 reaches those up to k
            a0 = xs[i]
            xs[i] = 0.0
            for j in range(i + 1):
                xs[j] += line[j] * a0


@entry(f"{_SWEEP}, f8[::1], f8[::1], f8[::1]", f"{_SWEEP}, f4[::1], f8[::1], f8[::1]")
def forward_tile(
    whole: bool,
    first: Any,
    row_start: Any,
    rows: Any,
    panel_start: Any,
    face_start: Any,
    panels: Any,
    x: Array,
    tail: Array,
) -> None:
    """Forward substitution of a tile x (n, 8) in elimination order, in place; tail (4, 8) is scratch."""
    for s in range(len(first) - 1):
        width, c = first[s + 1] - first[s], 0 if whole else face_start[s]
        if c >= width:
            continue
        used = width - c
        xs = x[LANES * (first[s] + c) : LANES * first[s + 1]]
        panel = panels[panel_start[s] + c : panel_start[s + 1]]
        # from the last row up: row i of L11^-1 reads the rows before it, which are still the old ones
        i = used - 1
        while i >= 0:
            if not whole and i >= 3:
                # all four are computed before one of them is written
                _four_corner_rows(panel[width * (i - 3 + c) :], width, i - 2, xs, tail)
                for j in range(4 * LANES):
                    xs[LANES * (i - 3) + j] = tail[j]
                i -= 4
                continue
            one_row(panel[width * (i + c) :], i + 1, xs, tail)
            for j in range(LANES):
                xs[LANES * i + j] = tail[j]
            i -= 1
        at = width * width
        i = row_start[s]
        last = row_start[s + 1]
        while i < last:
            together = 4 if i + 4 <= last else 1
            if together == 4:
                four_rows(panel[at:], width, used, xs, tail)
            else:
                one_row(panel[at:], used, xs, tail)
            for r in range(together):
                line = x[rows[i + r] * LANES : rows[i + r] * LANES + LANES]
                for j in range(LANES):
                    line[j] -= tail[r * LANES + j]
            at += width * together
            i += together


@entry(f"{_SWEEP}, f8[::1], f8[::1], f8[::1]", f"{_SWEEP}, f4[::1], f8[::1], f8[::1]")
def backward_tile(
    whole: bool,
    first: Any,
    row_start: Any,
    rows: Any,
    panel_start: Any,
    face_start: Any,
    panels: Any,
    x: Array,
    tail: Array,
) -> None:
    """Backward substitution of a tile x (n, 8) in elimination order, in place; tail (4, 8) is scratch."""
    for s in range(len(first) - 2, -1, -1):
        width, c = first[s + 1] - first[s], 0 if whole else face_start[s]
        if c >= width:
            continue
        used = width - c
        xs = x[LANES * (first[s] + c) : LANES * first[s + 1]]
        panel = panels[panel_start[s] + c : panel_start[s + 1]]
        at = width * width
        i = row_start[s]
        last = row_start[s + 1]
        while i + 4 <= last:
            for r in range(4):
                line = x[rows[i + r] * LANES : rows[i + r] * LANES + LANES]
                for j in range(LANES):
                    tail[r * LANES + j] = line[j]
            subtract_four(panel[at:], width, used, tail, xs)
            at += 4 * width
            i += 4
        while i < last:
            # fewer than four rows are left
            tail[:LANES] = x[rows[i] * LANES : rows[i] * LANES + LANES]
            subtract_one(panel[at:], used, tail, xs)
            at += width
            i += 1
        for i in range(used):  # L11^-T in place: row i of L11^-1 brings x_i to the rows above and to itself
            line = xs[LANES * i : LANES * i + LANES]
            for j in range(LANES):
                # with the sign turned, for a kernel that subtracts
                tail[j] = -line[j]
                line[j] = 0.0
            subtract_one(panel[width * (i + c) :], i + 1, tail, xs)


@ordered_kernel
def one_row(a: Array, n: int, x: Array, out: Array) -> None:
    """out (8,) = the row a (n,) times x (n, 8)."""
    s0 = s1 = s2 = s3 = s4 = s5 = s6 = s7 = 0.0
    for k in range(n):
        v, at = a[k], LANES * k
        s0 += v * x[at]
        s1 += v * x[at + 1]
        s2 += v * x[at + 2]
        s3 += v * x[at + 3]
        s4 += v * x[at + 4]
        s5 += v * x[at + 5]
        s6 += v * x[at + 6]
        s7 += v * x[at + 7]
    out[0] = s0
    out[1] = s1
    out[2] = s2
    out[3] = s3
    out[4] = s4
    out[5] = s5
    out[6] = s6
    out[7] = s7


@ordered_kernel
def four_rows(a: Array, width: int, n: int, x: Array, out: Array) -> None:
    """out (4, 8) = four rows, ``width`` apart in a, times x (n, 8)."""
    s0 = s1 = s2 = s3 = s4 = s5 = s6 = s7 = 0.0
    t0 = t1 = t2 = t3 = t4 = t5 = t6 = t7 = 0.0
    p0 = p1 = p2 = p3 = p4 = p5 = p6 = p7 = 0.0
    q0 = q1 = q2 = q3 = q4 = q5 = q6 = q7 = 0.0
    b, c, d = a[width:], a[2 * width :], a[3 * width :]
    for k in range(n):
        at = LANES * k
        x0, x1, x2, x3 = x[at], x[at + 1], x[at + 2], x[at + 3]
        x4, x5, x6, x7 = x[at + 4], x[at + 5], x[at + 6], x[at + 7]
        v = a[k]
        s0 += v * x0
        s1 += v * x1
        s2 += v * x2
        s3 += v * x3
        s4 += v * x4
        s5 += v * x5
        s6 += v * x6
        s7 += v * x7
        v = b[k]
        t0 += v * x0
        t1 += v * x1
        t2 += v * x2
        t3 += v * x3
        t4 += v * x4
        t5 += v * x5
        t6 += v * x6
        t7 += v * x7
        v = c[k]
        p0 += v * x0
        p1 += v * x1
        p2 += v * x2
        p3 += v * x3
        p4 += v * x4
        p5 += v * x5
        p6 += v * x6
        p7 += v * x7
        v = d[k]
        q0 += v * x0
        q1 += v * x1
        q2 += v * x2
        q3 += v * x3
        q4 += v * x4
        q5 += v * x5
        q6 += v * x6
        q7 += v * x7
    out[0], out[1], out[2], out[3] = s0, s1, s2, s3
    out[4], out[5], out[6], out[7] = s4, s5, s6, s7
    out[8], out[9], out[10], out[11] = t0, t1, t2, t3
    out[12], out[13], out[14], out[15] = t4, t5, t6, t7
    out[16], out[17], out[18], out[19] = p0, p1, p2, p3
    out[20], out[21], out[22], out[23] = p4, p5, p6, p7
    out[24], out[25], out[26], out[27] = q0, q1, q2, q3
    out[28], out[29], out[30], out[31] = q4, q5, q6, q7


@ordered_kernel
def _four_corner_rows(a: Array, width: int, n: int, x: Array, out: Array) -> None:
    """out (4, 8) = the last four rows of a lower triangle, n to n + 3 entries long and ``width`` apart in a, times
    x (n + 3, 8)."""
    # what the four rows have in common, then the corner that grows by one entry a row
    four_rows(a, width, n, x, out)
    for r in range(1, 4):
        for k in range(n, n + r):
            v = a[r * width + k]
            for j in range(LANES):
                out[LANES * r + j] += v * x[LANES * k + j]


@ordered_kernel
def subtract_four(a: Array, width: int, n: int, t: Array, x: Array) -> None:
    """x (n, 8) -= A^T t for four rows of A, ``width`` apart in a, and t (4, 8)."""
    a0 = t[0]
    a1 = t[1]
    a2 = t[2]
    a3 = t[3]
    a4 = t[4]
    a5 = t[5]
    a6 = t[6]
    a7 = t[7]
    b0 = t[8]
    b1 = t[9]
    b2 = t[10]
    b3 = t[11]
    b4 = t[12]
    b5 = t[13]
    b6 = t[14]
    b7 = t[15]
    c0 = t[16]
    c1 = t[17]
    c2 = t[18]
    c3 = t[19]
    c4 = t[20]
    c5 = t[21]
    c6 = t[22]
    c7 = t[23]
    d0 = t[24]
    d1 = t[25]
    d2 = t[26]
    d3 = t[27]
    d4 = t[28]
    d5 = t[29]
    d6 = t[30]
    d7 = t[31]
    b = a[width:]
    c = a[2 * width :]
    d = a[3 * width :]
    for k in range(n):
        v0 = a[k]
        v1 = b[k]
        v2 = c[k]
        v3 = d[k]
        row = x[LANES * k : LANES * (k + 1)]
        row[0] -= v0 * a0 + v1 * b0 + v2 * c0 + v3 * d0
        row[1] -= v0 * a1 + v1 * b1 + v2 * c1 + v3 * d1
        row[2] -= v0 * a2 + v1 * b2 + v2 * c2 + v3 * d2
        row[3] -= v0 * a3 + v1 * b3 + v2 * c3 + v3 * d3
        row[4] -= v0 * a4 + v1 * b4 + v2 * c4 + v3 * d4
        row[5] -= v0 * a5 + v1 * b5 + v2 * c5 + v3 * d5
        row[6] -= v0 * a6 + v1 * b6 + v2 * c6 + v3 * d6
        row[7] -= v0 * a7 + v1 * b7 + v2 * c7 + v3 * d7


@ordered_kernel
def subtract_one(a: Array, n: int, t: Array, x: Array) -> None:
    """x (n, 8) -= a (n,) times t (8,)."""
    a0 = t[0]
    a1 = t[1]
    a2 = t[2]
    a3 = t[3]
    a4 = t[4]
    a5 = t[5]
    a6 = t[6]
    a7 = t[7]
    for k in range(n):
        v = a[k]
        row = x[LANES * k : LANES * (k + 1)]
        row[0] -= v * a0
        row[1] -= v * a1
        row[2] -= v * a2
        row[3] -= v * a3
        row[4] -= v * a4
        row[5] -= v * a5
        row[6] -= v * a6
        row[7] -= v * a7
