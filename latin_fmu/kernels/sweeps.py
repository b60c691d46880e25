"""Forward and backward substitution through the panels [L11^-1; L21] of a supernodal factor, row by row, in place.

Vectors are in elimination order, the interface dofs last: forward leaves [L^-1 b_I ; b_G - L_GI L^-1 b_I], backward
turns [y ; x_G] into [L^-T (y - L_GI^T x_G) ; x_G]. One vector, or a tile of eight side by side. Four rows at a time are
faster where the factor is in the cache; one after the other is faster from memory, which is then read in order.
"""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import NDArray

from ..compiled import entry
from .lanes import LANES, four_rows, one_row, subtract_four, subtract_one

Array = NDArray[np.float64]

_SWEEP = "i8[::1], i8[::1], i8[::1], i8[::1]"


@entry(f"b1, {_SWEEP}, f8[::1], f8[::1]", f"b1, {_SWEEP}, f4[::1], f8[::1]")
def forward_one(grouped: bool, first: Any, row_start: Any, rows: Any, panel_start: Any, panels: Any, x: Array) -> None:
    """x (n,) := [L^-1 x_I ; x_G - L_GI L^-1 x_I]; ``grouped``: four rows of a panel at a time."""
    for s in range(len(first) - 1):
        xs = x[first[s] : first[s + 1]]
        own = rows[row_start[s] : row_start[s + 1]]
        panel = panels[panel_start[s] : panel_start[s + 1]]
        width, below = len(xs), len(own)
        for i in range(width - 1, -1, -1):
            line = panel[i * width : i * width + i + 1]
            total = 0.0
            for j in range(i + 1):
                total += line[j] * xs[j]
            xs[i] = total
        at = width * width
        i = 0
        while grouped and i + 4 <= below:
            l0, l1 = panel[at : at + width], panel[at + width : at + 2 * width]
            l2, l3 = panel[at + 2 * width : at + 3 * width], panel[at + 3 * width : at + 4 * width]
            t0 = t1 = t2 = t3 = 0.0
            for j in range(width):
                value = xs[j]
                t0 += l0[j] * value
                t1 += l1[j] * value
                t2 += l2[j] * value
                t3 += l3[j] * value
            x[own[i]] -= t0
            x[own[i + 1]] -= t1
            x[own[i + 2]] -= t2
            x[own[i + 3]] -= t3
            at += 4 * width
            i += 4
        while i < below:
            line = panel[at : at + width]
            total = 0.0
            for j in range(width):
                total += line[j] * xs[j]
            x[own[i]] -= total
            at += width
            i += 1


@entry(f"b1, {_SWEEP}, f8[::1], f8[::1]", f"b1, {_SWEEP}, f4[::1], f8[::1]")
def backward_one(grouped: bool, first: Any, row_start: Any, rows: Any, panel_start: Any, panels: Any, x: Array) -> None:
    """x (n,) := [L^-T (x_I - L_GI^T x_G) ; x_G]."""
    for s in range(len(first) - 2, -1, -1):
        xs = x[first[s] : first[s + 1]]
        own = rows[row_start[s] : row_start[s + 1]]
        panel = panels[panel_start[s] : panel_start[s + 1]]
        width, below = len(xs), len(own)
        at = width * width
        i = 0
        while grouped and i + 4 <= below:
            l0, l1 = panel[at : at + width], panel[at + width : at + 2 * width]
            l2, l3 = panel[at + 2 * width : at + 3 * width], panel[at + 3 * width : at + 4 * width]
            a0, a1, a2, a3 = x[own[i]], x[own[i + 1]], x[own[i + 2]], x[own[i + 3]]
            for j in range(width):
                xs[j] -= (l0[j] * a0 + l1[j] * a1) + (l2[j] * a2 + l3[j] * a3)
            at += 4 * width
            i += 4
        while i < below:
            line = panel[at : at + width]
            a0 = x[own[i]]
            for j in range(width):
                xs[j] -= line[j] * a0
            at += width
            i += 1
        for i in range(width):
            line = panel[i * width : i * width + i + 1]
            a0 = xs[i]
            xs[i] = 0.0
            for j in range(i + 1):
                xs[j] += line[j] * a0


@entry(f"{_SWEEP}, f8[::1], f8[::1], f8[::1]", f"{_SWEEP}, f4[::1], f8[::1], f8[::1]")
def forward_tile(first: Any, row_start: Any, rows: Any, panel_start: Any, panels: Any, x: Array, tail: Array) -> None:
    """Forward substitution of a tile x (n, 8) in elimination order, in place; tail (4, 8) is scratch."""
    for s in range(len(first) - 1):
        width = first[s + 1] - first[s]
        own, panel = x[LANES * first[s] : LANES * first[s + 1]], panels[panel_start[s] : panel_start[s + 1]]
        for i in range(width - 1, -1, -1):
            one_row(panel[width * i :], i + 1, own, tail)
            for j in range(LANES):
                own[LANES * i + j] = tail[j]
        at, i, last = width * width, row_start[s], row_start[s + 1]
        while i < last:
            together = 4 if i + 4 <= last else 1
            if together == 4:
                four_rows(panel[at:], width, own, tail)
            else:
                one_row(panel[at:], width, own, tail)
            for r in range(together):
                line = x[rows[i + r] * LANES : rows[i + r] * LANES + LANES]
                for j in range(LANES):
                    line[j] -= tail[r * LANES + j]
            at += width * together
            i += together


@entry(f"{_SWEEP}, f8[::1], f8[::1], f8[::1]", f"{_SWEEP}, f4[::1], f8[::1], f8[::1]")
def backward_tile(first: Any, row_start: Any, rows: Any, panel_start: Any, panels: Any, x: Array, tail: Array) -> None:
    """Backward substitution of a tile x (n, 8) in elimination order, in place; tail (4, 8) is scratch."""
    for s in range(len(first) - 2, -1, -1):
        width = first[s + 1] - first[s]
        own, panel = x[LANES * first[s] : LANES * first[s + 1]], panels[panel_start[s] : panel_start[s + 1]]
        at, i, last = width * width, row_start[s], row_start[s + 1]
        while i + 4 <= last:
            for r in range(4):
                line = x[rows[i + r] * LANES : rows[i + r] * LANES + LANES]
                for j in range(LANES):
                    tail[r * LANES + j] = line[j]
            subtract_four(panel[at:], width, tail, own)
            at += 4 * width
            i += 4
        while i < last:
            tail[:LANES] = x[rows[i] * LANES : rows[i] * LANES + LANES]
            subtract_one(panel[at:], width, tail, own)
            at += width
            i += 1
        for i in range(width):  # L11^-T in place: row i of L11^-1 brings x_i to the rows above and to itself
            line = own[LANES * i : LANES * i + LANES]
            for j in range(LANES):
                tail[j] = -line[j]
                line[j] = 0.0
            subtract_one(panel[width * i :], i + 1, tail, own)
