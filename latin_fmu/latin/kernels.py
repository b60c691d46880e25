"""Compiled passes over the flat channel vectors: what one iteration does besides the products with Y.

Each has the NumPy expression it stands for in its docstring; tests compare them.
"""

from __future__ import annotations

import numpy as np

from ..compiled import compiled
from .layout import Array, Index


@compiled
def respond(response: Array, w_0: Array, channels: Index, q: Array, w: Array) -> None:
    """``w[channels] = w_0 + response @ q[channels]`` for one class, channels (n_channel, n_member)."""
    n, members = channels.shape
    incoming = np.empty((n, members))
    for i in range(n):
        for j in range(members):
            incoming[i, j] = q[channels[i, j]]
    answer = np.dot(response, incoming)
    for i in range(n):
        for j in range(members):
            w[channels[i, j]] = w_0[i, j] + answer[i, j]


@compiled
def outgoing(q: Array, w: Array, k: Array, z: Array, f: Array, s: Array) -> None:
    """``f = q - k * w; s = w - z * f`` for q, w (n, n_flat)."""
    for i in range(q.shape[0]):
        for j in range(q.shape[1]):
            traction = q[i, j] - k[j] * w[i, j]
            f[i, j] = traction
            s[i, j] = w[i, j] - z[j] * traction


@compiled
def close(
    q: Array, k: Array, f_hat: Array, w_hat: Array, f: Array, w: Array, weights: Array, residual: Array
) -> tuple[float, float]:
    """``residual = f_hat + k * w_hat - q`` and the two sums of the indicator, all (n, n_flat):

    sum of r_weight residual^2, and of f_weight (f^2 + f_hat^2) + w_weight (w^2 + w_hat^2), ``weights`` their rows.
    """
    difference, size = 0.0, 0.0
    for i in range(q.shape[0]):
        for j in range(q.shape[1]):
            r = f_hat[i, j] + k[j] * w_hat[i, j] - q[i, j]
            residual[i, j] = r
            difference += weights[0, j] * r * r
            size += weights[1, j] * (f[i, j] * f[i, j] + f_hat[i, j] * f_hat[i, j])
            size += weights[2, j] * (w[i, j] * w[i, j] + w_hat[i, j] * w_hat[i, j])
    return difference, size


@compiled
def anderson(
    weight: Array, q: Array, residual: Array, last_q: Array, last_r: Array, dq: Array, dr: Array, gram: Array,
    count: int, relaxation: float, rank: float, out: Array,
) -> None:  # fmt: skip
    """One step of Anderson acceleration on vectors of (n, n_flat); see ``acceleration``.

    dq, dr : (depth, n, n_flat) ring of differences, gram : (depth, depth) their weighted products, brought up to
    date with the difference number ``count``; weight : (n_flat,) squared weights. The result goes to ``out``.
    """
    depth = dq.shape[0]
    row = count % depth
    n, n_flat = q.shape
    kept = min(count + 1, depth)
    for i in range(n):
        for j in range(n_flat):
            dq[row, i, j] = q[i, j] - last_q[i, j]
            dr[row, i, j] = residual[i, j] - last_r[i, j]
    right = np.empty(kept)
    for a in range(kept):
        product, projection = 0.0, 0.0
        for i in range(n):
            for j in range(n_flat):
                weighted = weight[j] * dr[a, i, j]
                product += weighted * dr[row, i, j]
                projection += weighted * residual[i, j]
        gram[row, a] = product
        gram[a, row] = product
        right[a] = projection
    size = np.empty(kept)
    for a in range(kept):
        size[a] = np.sqrt(max(gram[a, a], 1e-300))
    scaled = np.empty((kept, kept))
    for a in range(kept):
        right[a] /= size[a]
        for b in range(kept):
            scaled[a, b] = gram[a, b] / (size[a] * size[b])
    values, vectors = np.linalg.eigh(scaled)
    gamma = np.zeros(kept)
    for e in range(kept):
        if values[e] > rank * values[kept - 1]:
            share = 0.0
            for a in range(kept):
                share += vectors[a, e] * right[a]
            share /= values[e]
            for a in range(kept):
                gamma[a] += vectors[a, e] * share
    for i in range(n):
        for j in range(n_flat):
            step = relaxation * residual[i, j]
            for a in range(kept):
                step -= gamma[a] / size[a] * (dq[a, i, j] + relaxation * dr[a, i, j])
            out[i, j] = q[i, j] + step
