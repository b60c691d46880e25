"""Newton-Krylov steps on the fixed point of the iteration, where the acceleration stalls (quasi-static mode).

A front of slip that runs along a slender body moves a few points per iteration, and every point that changes its state
spoils the memory of the acceleration. The residual r(q) = F_hat + k W_hat - q of one iteration is piecewise smooth, so
that Newton's method settles stick, slip and opening in about ten steps,

    J dq = -r(q),   J x by the difference of two iterations,   GMRES in the norm of the iteration,

with the step halved until the residual falls. Every product with J is one iteration: nothing is factorised, and any
interface behaviour will do.
"""

from __future__ import annotations

from collections.abc import Callable

import numpy as np
import scipy.sparse.linalg as spla
from numpy.typing import NDArray

from .layout import Array

Evaluate = Callable[[Array], tuple[Array, Array]]
"""q (1, n_flat) -> q as it acts, and its residual."""

_STEPS, _KRYLOV, _HALVINGS = 25, 60, 6
_LINEAR, _DIFFERENCE = 1e-2, 1e-7
_FALLS, _STUCK = (
    0.1,
    0.98,
)  # part of the linear decrease asked for; residual over the one before that ends the attempt
_ENOUGH = 0.01  # residual over the size of q, in units of the tolerance


def newton(evaluate: Evaluate, q: Array, weight: Array, tolerance: float, budget: int) -> Array:
    """The q with the smallest residual that was found.

    Parameters
    ----------
    q : (1, n_flat) first iterate. weight : (n_flat,) square root of area / k, 0 where there is nothing to find.
    tolerance : of the window. budget : iterations after which no new step is begun.
    """
    free = weight > 0
    spent = 0

    def at(trial: Array) -> tuple[Array, Array]:
        nonlocal spent
        spent += 1
        return evaluate(trial)

    def size(x: Array) -> float:
        return float(np.linalg.norm(weight * x))

    q, r = at(q)
    for _ in range(_STEPS):
        before = size(r)
        if before <= _ENOUGH * tolerance * size(q) or not np.isfinite(before) or spent > budget:
            break
        step = np.zeros_like(q)
        step[0, free] = _linear(at, q, r, weight, free)
        best: tuple[float, Array, Array] | None = None
        for halving in range(_HALVINGS):
            length = 0.5**halving
            trial, rest = at(q + length * step)
            if best is None or size(rest) < best[0]:
                best = size(rest), trial, rest
            if size(rest) <= (1 - _FALLS * length) * before:
                break
        assert best is not None
        if best[0] < before:
            q, r = best[1], best[2]
        if best[0] > _STUCK * before:
            break
    return q


def _linear(at: Evaluate, q: Array, r: Array, weight: Array, free: NDArray[np.bool_]) -> Array:
    """Newton's step on the free unknowns."""
    scale, image = weight[free], q + r
    reference = float(np.linalg.norm(weight * q))

    def product(x: Array) -> Array:
        length = float(np.linalg.norm(x))
        if length == 0.0:
            return np.zeros_like(x)
        step = np.zeros_like(q)
        epsilon = _DIFFERENCE * max(reference, np.finfo(float).tiny) / length
        step[0, free] = epsilon * x / scale
        moved, rest = at(q + step)
        change: Array = scale * ((moved + rest) - image)[0, free] / epsilon - x
        return change

    n = len(scale)
    operator = spla.LinearOperator((n, n), matvec=product, dtype=float)
    x, _ = spla.gmres(operator, -scale * r[0, free], rtol=_LINEAR, restart=_KRYLOV, maxiter=1)
    found: Array = x / scale
    return found
