"""Compiled passes over the flat channel vectors: what one iteration does besides the products with Y.

Each follows its NumPy twin, which says what it computes and serves where compilation is off; tests compare them.
"""

from __future__ import annotations

import numpy as np

from ..compiled import compiled
from ..march.least_squares import least_squares, least_squares_numpy
from .layout import Array, Index


def respond_numpy(response: Array, w_0: Array, channels: Index, q: Array, w: Array) -> None:
    """Answer of one class at its channels (n_channel, n_member); q, w (n_flat,)."""
    w[channels] = w_0 + response @ q[channels]


def outgoing_numpy(q: Array, w: Array, k: Array, z: Array, f: Array, s: Array) -> None:
    """Traction F = q - k W and outgoing quantity s = W - z F; q, w, f, s (n, n_flat), k, z (n_flat,)."""
    np.subtract(q, k * w, out=f)
    np.subtract(w, z * f, out=s)


def close_numpy(
    q: Array, k: Array, f_hat: Array, w_hat: Array, f: Array, w: Array, weights: Array, residual: Array
) -> tuple[float, float]:
    """Residual of q and the two sums of the indicator; fields (n, n_flat), ``weights`` (3, n_flat) of the residual,
    of tractions and of velocities."""
    np.subtract(f_hat + k * w_hat, q, out=residual)
    difference = float(np.vdot(weights[0] * residual, residual))
    size = float(np.vdot(weights[1] * f, f) + np.vdot(weights[1] * f_hat, f_hat))
    size += float(np.vdot(weights[2] * w, w) + np.vdot(weights[2] * w_hat, w_hat))
    return difference, size


def anderson_numpy(
    weight: Array, q: Array, residual: Array, last_q: Array, last_r: Array, dq: Array, dr: Array, gram: Array,
    count: int, relaxation: float, rank: float, out: Array,
) -> None:  # fmt: skip
    """One step of Anderson acceleration on fields (n, n_flat); see ``acceleration``.

    dq, dr : (depth, n, n_flat) ring of differences, gram : (depth, depth) their weighted products, brought up to
    date with the difference number ``count``; weight : (n_flat,) squared weights; differences whose pivot in the
    Cholesky factor of the Gram matrix (unit diagonal) is below ``rank`` are left out. The result goes to ``out``.
    """
    row, kept = count % len(dq), min(count + 1, len(dq))
    np.subtract(q, last_q, out=dq[row])
    np.subtract(residual, last_r, out=dr[row])
    known = dr[:kept].reshape(kept, -1)
    gram[row, :kept] = gram[:kept, row] = known @ (weight * dr[row]).ravel()
    gamma = least_squares_numpy(gram, known @ (weight * residual).ravel(), kept, rank)
    out[...] = q + relaxation * residual - np.einsum("a,aij->ij", gamma, dq[:kept] + relaxation * dr[:kept])


@compiled(respond_numpy, "f8[:, ::1], f8[:, ::1], i8[:, ::1], f8[::1], f8[::1]")
def respond(response: Array, w_0: Array, channels: Index, q: Array, w: Array) -> None:
    """See ``respond_numpy``."""
    n, members = channels.shape
    incoming = np.empty((n, members))
    for i in range(n):
        for j in range(members):
            incoming[i, j] = q[channels[i, j]]
    answer = np.dot(response, incoming)
    for i in range(n):
        for j in range(members):
            w[channels[i, j]] = w_0[i, j] + answer[i, j]


@compiled(outgoing_numpy, "f8[:, ::1], f8[:, ::1], f8[::1], f8[::1], f8[:, ::1], f8[:, ::1]")
def outgoing(q: Array, w: Array, k: Array, z: Array, f: Array, s: Array) -> None:
    """See ``outgoing_numpy``."""
    for i in range(q.shape[0]):
        for j in range(q.shape[1]):
            traction = q[i, j] - k[j] * w[i, j]
            f[i, j] = traction
            s[i, j] = w[i, j] - z[j] * traction


@compiled(close_numpy)
def close(
    q: Array, k: Array, f_hat: Array, w_hat: Array, f: Array, w: Array, weights: Array, residual: Array
) -> tuple[float, float]:
    """See ``close_numpy``."""
    difference, size = 0.0, 0.0
    for i in range(q.shape[0]):
        for j in range(q.shape[1]):
            r = f_hat[i, j] + k[j] * w_hat[i, j] - q[i, j]
            residual[i, j] = r
            difference += weights[0, j] * r * r
            size += weights[1, j] * (f[i, j] * f[i, j] + f_hat[i, j] * f_hat[i, j])
            size += weights[2, j] * (w[i, j] * w[i, j] + w_hat[i, j] * w_hat[i, j])
    return difference, size


@compiled(
    anderson_numpy,
    "f8[::1], f8[:, ::1], f8[:, ::1], f8[:, ::1], f8[:, ::1], f8[:, :, ::1], f8[:, :, ::1], f8[:, ::1], "
    "i8, f8, f8, f8[:, ::1]",
)
def anderson(
    weight: Array, q: Array, residual: Array, last_q: Array, last_r: Array, dq: Array, dr: Array, gram: Array,
    count: int, relaxation: float, rank: float, out: Array,
) -> None:  # fmt: skip
    """See ``anderson_numpy``."""
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
    gamma = least_squares(gram, right, kept, rank)
    for i in range(n):
        for j in range(n_flat):
            step = relaxation * residual[i, j]
            for a in range(kept):
                step -= gamma[a] * (dq[a, i, j] + relaxation * dr[a, i, j])
            out[i, j] = q[i, j] + step
