"""Fixed-point iteration on q: relaxation and Anderson acceleration.

LATIN with equal search directions up and down is Peaceman-Rachford splitting; relaxation 1/2 makes it Douglas-Rachford,
the safe fall-back. Anderson acceleration of depth m (Walker and Ni 2011, type II) replaces q + r by

    q + r - (DQ + DR) gamma,   gamma = argmin || r - DR gamma ||

with the last m differences DQ, DR of iterates and residuals, in the norm sum area / k q^2 (a power).
"""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import NDArray

from ..compiled import entry, kernel
from .sums import MEASURES, add_parts, exchange_parts

Array = NDArray[np.float64]

RANK = 1e-12
"""Pivot below which a difference is left out."""


@kernel
def least_squares(gram: Array, depth: int, right: Array, n: int, scratch: Array, x: Array) -> None:
    """x (n,) = solution of gram[:n, :n] x = right by a Cholesky factor of unit diagonal; x is 0 for directions whose
    pivot is below RANK, as they depend on those before. gram (depth, depth), scratch ((depth + 1) depth,)."""
    factor, size = scratch[: depth * depth], scratch[depth * depth : depth * (depth + 1)]
    for a in range(n):
        size[a] = np.sqrt(max(gram[a * depth + a], 1e-300))  # unit diagonal: pivots are relative
        x[a] = 0.0
    for a in range(n):
        for b in range(a + 1):
            total = gram[a * depth + b] / (size[a] * size[b])
            for e in range(b):
                total -= factor[a * depth + e] * factor[b * depth + e]
            if b < a:
                # a direction that was left out couples with no other
                factor[a * depth + b] = total / factor[b * depth + b] if factor[b * depth + b] > 0.0 else 0.0
            else:
                factor[a * depth + a] = np.sqrt(total) if total > RANK else 0.0
    for a in range(n):
        if factor[a * depth + a] > 0.0:
            total = right[a] / size[a]
            for e in range(a):
                total -= factor[a * depth + e] * x[e]
            x[a] = total / factor[a * depth + a]
    for a in range(n - 1, -1, -1):
        if factor[a * depth + a] > 0.0:
            total = x[a]
            for e in range(a + 1, n):
                total -= factor[e * depth + a] * x[e]
            x[a] = total / factor[a * depth + a]
    for a in range(n):
        x[a] /= size[a]


@kernel
def take_differences(q: Array, residual: Array, last_q: Array, last_r: Array, own_q: Array, own_r: Array) -> None:
    """Differences to the last iterate, which this one replaces."""
    for j in range(len(q)):
        own_q[j] = q[j] - last_q[j]
        own_r[j] = residual[j] - last_r[j]
        last_q[j], last_r[j] = q[j], residual[j]


@kernel
def weighted_products(metric: Array, old: Array, new: Array, rest: Array) -> tuple[float, float]:
    """Sums of metric old new and of metric old rest."""
    product, projection = 0.0, 0.0
    for j in range(len(metric)):
        weighted = metric[j] * old[j]
        product += weighted * new[j]
        projection += weighted * rest[j]
    return product, projection


@kernel
def find_weights(depth: int, gram: Array, least: Array, count: int, products: Array) -> int:
    """Weights gamma of the differences, into ``least`` from ``depth`` on, and how many there are; ``products``
    (2 depth,): of the last difference with all, and of r with all."""
    row, n_difference = (count - 1) % depth, min(count, depth)  # a ring: the oldest difference is replaced
    right, gamma = least[:depth], least[depth : 2 * depth]
    for a in range(n_difference):
        # row and column of the difference that is new
        gram[row * depth + a] = products[2 * a]
        gram[a * depth + row] = products[2 * a]
        right[a] = products[2 * a + 1]
    least_squares(gram, depth, right, n_difference, least[2 * depth :], gamma)
    return n_difference


@kernel
def take_step(
    q: Array, residual: Array, relaxation: float, n_difference: int, gamma: Array, dq: Array, dr: Array, stride: int
) -> None:
    """q := next iterate, in a part of it of len(q) numbers; differences ``stride`` numbers apart."""
    n = len(q)
    for j in range(n):
        q[j] += relaxation * residual[j]
    for a in range(n_difference):
        if gamma[a] != 0.0:
            past_q, past_r = dq[a * stride : a * stride + n], dr[a * stride : a * stride + n]
            for j in range(n):
                q[j] -= gamma[a] * (past_q[j] + relaxation * past_r[j])


@kernel
def relax(q: Array, residual: Array, relaxation: float, last_q: Array, last_r: Array) -> None:
    """q := q + relaxation times r, the first step."""
    for j in range(len(q)):
        # before q changes
        last_q[j], last_r[j] = q[j], residual[j]
        q[j] += relaxation * residual[j]


@entry("f8[::1], f8[::1], i8, f8, f8[::1], f8[::1], f8[::1], f8[::1], f8[::1], f8[::1], f8[::1], i8")
def anderson(
    q: Array,
    residual: Array,
    depth: int,
    relaxation: float,
    metric: Array,
    last_q: Array,
    last_r: Array,
    dq: Array,
    dr: Array,
    gram: Array,
    least: Array,
    count: int,
) -> None:
    """q (n,) := next iterate, with ``count`` steps made since the start; a negative count relaxes.

    metric : (n,) squared weights of the norm. dq, dr : (depth, n) ring of differences, gram : (depth, depth) their
    weighted products, least : ((depth + 5) depth,) scratch.
    """
    if depth == 0 or count <= 0:
        relax(q, residual, relaxation, last_q, last_r)
        return
    # behind what ``find_weights`` uses of ``least``: 2 depth and (depth + 1) depth numbers
    n = len(q)
    row = (count - 1) % depth
    products = least[(depth + 3) * depth :]
    own_r = dr[row * n : (row + 1) * n]
    take_differences(q, residual, last_q, last_r, dq[row * n : (row + 1) * n], own_r)
    for a in range(min(count, depth)):
        old = dr[a * n : (a + 1) * n]
        products[2 * a], products[2 * a + 1] = weighted_products(metric, old, own_r, residual)
    n_difference = find_weights(depth, gram, least, count, products)
    take_step(q, residual, relaxation, n_difference, least[depth:], dq, dr, n)


@kernel
def difference_parts(pools: Any, window: int, count: int) -> None:
    """Differences to the last iterate of the window, and their products over each interface, into ``own_parts``, behind
    those of the measures; none at the first of the steps."""
    run, work = pools.run[0], pools.moving
    depth = run.depth
    n_flat = run.n_flat
    wide = run.part_width
    n = window * n_flat
    if depth == 0 or count <= 0:
        return
    row, n_difference = (count - 1) % depth, min(count, depth)
    new_q, new_r = run.dq + row * n, run.dr + row * n
    parts = work[run.own_parts : run.own_parts + run.n_interface * wide]
    # behind the measures: both go with one message
    for e in range(run.n_interface):
        parts[e * wide + MEASURES : e * wide + MEASURES + 2 * n_difference] = 0.0
    for i in range(window):
        for e in range(run.n_interface):
            size = pools.fixed_int[run.segments + 3 * e + 2]
            for side in range(pools.fixed_int[run.sides + e]):
                at = pools.fixed_int[run.segments + 3 * e + side]
                # weights are those of one instant: read before the place moves on to instant i
                metric = pools.fixed[run.metric + at : run.metric + at + size]
                at += i * n_flat
                new, rest = work[new_r + at : new_r + at + size], work[run.r + at : run.r + at + size]
                last_q, last_r = work[run.last_q + at : run.last_q + at + size], work[run.last_r + at :]
                take_differences(work[run.q + at : run.q + at + size], rest, last_q, last_r, work[new_q + at :], new)
                for a in range(n_difference):
                    old = work[run.dr + a * n + at : run.dr + a * n + at + size]
                    product, projection = weighted_products(metric, old, new, rest)
                    parts[e * wide + MEASURES + 2 * a] += product
                    parts[e * wide + MEASURES + 1 + 2 * a] += projection


@kernel
def next_iterate(pools: Any, window: int, count: int) -> None:
    """Next q of the window after ``count`` steps from the ``parts`` of all interfaces; see the head of this file."""
    run, work = pools.run[0], pools.moving
    n = window * run.n_flat
    depth = run.depth
    n_difference = -1
    gram, least = work[run.gram : run.gram + depth * depth], work[run.least : run.least + (depth + 3) * depth]
    if depth > 0 and count > 0:
        add_parts(pools, MEASURES, 2 * min(count, depth))
        n_difference = find_weights(
            depth, gram, least, count, work[run.totals + MEASURES : run.totals + MEASURES + 2 * depth]
        )
    for e in range(run.n_interface):
        size = pools.fixed_int[run.segments + 3 * e + 2]
        for i in range(window):
            # ground takes no part in the linear stage
            for side in range(pools.fixed_int[run.sides + e]):
                at = i * run.n_flat + pools.fixed_int[run.segments + 3 * e + side]
                q, r = work[run.q + at : run.q + at + size], work[run.r + at : run.r + at + size]
                if n_difference < 0:
                    relax(q, r, run.relaxation, work[run.last_q + at :], work[run.last_r + at :])
                    continue
                dq, dr = work[run.dq + at :], work[run.dr + at :]
                take_step(q, r, run.relaxation, n_difference, least[depth : 2 * depth], dq, dr, n)
    if n_difference < 0:
        return
    if run.longest_step < np.inf:  # without a limit no process sends anything
        step_parts(pools, window)
        exchange_parts(pools)
        shorten(pools, window)


@kernel
def step_parts(pools: Any, window: int) -> None:
    """Squared lengths of the step and of the residual over each interface, into ``own_parts``."""
    run, work = pools.run[0], pools.moving
    for e in range(run.n_interface):
        # the first two numbers of a row are free: the measures have been read
        at_part = run.own_parts + e * run.part_width
        work[at_part], work[at_part + 1] = 0.0, 0.0
        size = pools.fixed_int[run.segments + 3 * e + 2]
        for i in range(window):
            for side in range(2):
                at = pools.fixed_int[run.segments + 3 * e + side]
                metric = pools.fixed[run.metric + at : run.metric + at + size]
                at += i * run.n_flat
                q, last = work[run.q + at : run.q + at + size], work[run.last_q + at : run.last_q + at + size]
                r = work[run.r + at : run.r + at + size]
                step = 0.0
                allowed = 0.0
                for j in range(size):
                    moved = q[j] - last[j]
                    step += metric[j] * moved * moved
                    allowed += metric[j] * r[j] * r[j]
                work[at_part] += step
                work[at_part + 1] += allowed


@kernel
def shorten(pools: Any, window: int) -> None:
    """Shorten the step to ``longest_step`` lengths of the residual, by the ``parts`` of all interfaces. A body that
    slides back to where it sticks has the same residual iteration after iteration; with differences of residuals close
    to zero the step would have any length."""
    run, work = pools.run[0], pools.moving
    n = window * run.n_flat
    add_parts(pools, 0, 2)
    step, allowed = work[run.totals], work[run.totals + 1]
    # no step at all: the factor is large, and nothing is shortened
    factor = run.longest_step * np.sqrt(allowed) / max(np.sqrt(step), 1e-300)
    q, last_q = work[run.q : run.q + n], work[run.last_q : run.last_q + n]
    if factor < 1.0:
        for j in range(n):
            q[j] = last_q[j] + factor * (q[j] - last_q[j])


class Anderson:
    """Anderson acceleration of an iteration outside a run.

    Parameters
    ----------
    metric : (n,) squared weights of the norm. depth : differences kept. relaxation : factor on the residual.
    """

    def __init__(self, metric: Array, depth: int, relaxation: float) -> None:
        n = len(metric)
        self._metric = metric
        self._depth = depth
        self._relaxation = relaxation
        self._count = 0
        self._arrays = [np.zeros(size) for size in (n, n, depth * n, depth * n, depth * depth, (depth + 5) * depth)]

    def next(self, q: Array, residual: Array) -> Array:
        """Next iterate (n,) from q and its residual."""
        # a copy: the caller keeps its iterate
        out = np.array(q, dtype=float)
        last_q, last_r, dq, dr, gram, least = self._arrays
        anderson(
            out,
            np.ascontiguousarray(residual, dtype=float),
            self._depth,
            self._relaxation,
            self._metric,
            last_q,
            last_r,
            dq,
            dr,
            gram,
            least,
            self._count,
        )
        self._count += 1
        return out
