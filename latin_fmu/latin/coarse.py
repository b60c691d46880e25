"""Coarse problem of the quasi-static mode: the two sides of every interface balance in the mean.

Without inertia an iteration carries the resultant of a load from one substructure to the next only, and the number of
iterations grows with the length of a stack. So the linear stage takes, on each interface between two substructures,
one motion W~ common to its sides and affine over it (nine numbers on a plane, three where only the normal is known),

    F = q + k W~ - k W,        with  integral of R^T (F_E + F_E') = 0   for every affine motion R,

which holds for the solution whatever the behaviour of the interface is (action and reaction), so that W~ vanishes
there and the converged answer is the same. Rigid motions alone would balance resultants and moments; the others (the
face stretches and shears) halve the iterations of long stacks again. Where one side cannot move (ground, held
directions) nothing is to be balanced.

The operator, one small dense matrix for the whole assembly, is factorised once per search direction:

    L = sum over substructures of R^T a (k - k Y k) R,    Y the condensed response on k.
"""

from __future__ import annotations

import numpy as np
import scipy.linalg as la
import scipy.sparse as sp

from .assembly import Assembly
from .layout import Array, Index, InterfaceUnit

_SAME = 1e-9  # motions that differ by less than this fraction of their size on the points are one
_SINGULAR = 1e-13


class Coarse:
    """Coarse problem of an assembly bound to the search direction k (n_flat,), Pa s m-1."""

    def __init__(self, assembly: Assembly, k: Array) -> None:
        motions = _motions(assembly, k)
        area = assembly.layout.area
        self._balance = sp.csr_array(motions.T @ sp.diags_array(area))
        self._incoming = sp.csr_array(sp.diags_array(k) @ motions)
        answers = sp.lil_array(motions.shape)
        for propagator, channels in zip(assembly.propagators, assembly.channels, strict=True):
            for member in range(channels.shape[1]):
                own = channels[:, member]
                load = self._incoming[own]
                touched = np.unique(load.indices)
                answers[own[:, None], touched] = propagator.response @ load[:, touched].toarray()
        self._answer = sp.csr_array(answers)
        operator = (self._balance @ (self._incoming - sp.diags_array(k) @ self._answer)).toarray()
        self._inverse = _pseudo_inverse(0.5 * (operator + operator.T))

    @property
    def size(self) -> int:
        """Number of unknowns."""
        return len(self._inverse)

    def fields(self) -> dict[str, Array | sp.csr_array]:
        """What the kernels bring q and the W of the substructures to balance with."""
        return {
            "coarse_inverse": self._inverse,
            "coarse_balance": self._balance,
            "coarse_incoming": self._incoming,
            "coarse_answer": self._answer,
        }


def _motions(assembly: Assembly, k: Array) -> sp.csr_array:
    """Affine motions of each interface on the channels of both its sides, (n_flat, n_coarse)."""
    columns: list[Array] = []
    rows: list[Index] = []
    for i, unit in enumerate(assembly.interfaces):
        first, second = (assembly.layout.channels(i, side).ravel() for side in (0, 1))
        moves = (k[first] > 0) & (k[second] > 0)
        if moves.any():
            basis = affine_motions(unit) * moves[:, None]
            size = np.sqrt(assembly.layout.area[first])[:, None]
            shapes, strength, _ = la.svd(size * basis, full_matrices=False)
            kept = strength > _SAME * strength[0]
            rows.append(np.concatenate([first, second]))
            columns.append(np.tile(shapes[:, kept] / size, (2, 1)))
    n = assembly.layout.n_flat
    starts = np.cumsum([0, *(c.shape[1] for c in columns)])
    blocks = [
        sp.coo_array(
            (c.ravel(), (np.repeat(r, c.shape[1]), np.tile(np.arange(c.shape[1]) + s, len(r)))),
            shape=(n, int(starts[-1])),
        )
        for r, c, s in zip(rows, columns, starts[:-1], strict=True)
    ]
    return sp.csr_array(sum(blocks[1:], blocks[0])) if blocks else sp.csr_array((n, 0))


def affine_motions(unit: InterfaceUnit) -> Array:
    """Velocities (n_point * n_component, 12) of the points of an interface in the motions 1, x, y, z along each axis,
    local frames; some depend on others (12 on 9 where the points lie in a plane)."""
    points = unit.geometry.points - unit.geometry.points.mean(axis=0)
    size = float(np.abs(points).max()) or 1.0
    shapes = np.concatenate([np.ones((len(points), 1)), points / size], axis=1)
    motions = np.einsum("ps,ij->pijs", shapes, np.eye(3)).reshape(len(points), 3, -1)
    frames = unit.geometry.frames[:, : unit.behaviour.n_component]
    local: Array = np.einsum("pci,pim->pcm", frames, motions)
    return local.reshape(-1, local.shape[2])


def _pseudo_inverse(matrix: Array) -> Array:
    """Inverse of a symmetric positive matrix; motions that meet no resistance are left alone."""
    if not len(matrix):
        return matrix
    values, vectors = la.eigh(matrix)
    used = values > _SINGULAR * values[-1]
    inverse: Array = (vectors[:, used] / values[used]) @ vectors[:, used].T
    return inverse
