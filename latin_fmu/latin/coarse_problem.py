"""Coarse problem of the quasi-static mode.

The two sides of every interface balance in the mean. Without inertia an
iteration carries the resultant of a load from one substructure to the next only, and the number of iterations grows
with the length of a stack. So the linear stage takes, on each interface between two substructures, one motion W~ common
to its sides and affine over it (nine numbers on a plane, three where only the normal is known),

    F = q + k W~ - k W,        with  integral of R^T (F_E + F_E') = 0   for every affine motion R,

which holds for the solution with every behaviour (action and reaction), so that W~ vanishes there and the converged
solution is the same. Rigid motions alone would balance resultants and moments; the others (the face stretches and
shears) halve the iterations of long stacks again. Where one side cannot move (ground, held directions) there is no
balance. The operator, one small dense matrix for the whole assembly, is factorised once per search direction:

    L = sum over substructures of R^T a (k - k Y k) R,    Y the condensed response on k.
"""

from __future__ import annotations

import copy
from collections.abc import Sequence

import numpy as np
import scipy.linalg as la
import scipy.sparse as sp

from ..propagator import Propagator
from ..propagator.interface_sweeps import applied
from .assembly import Array, Assembly, Index, InterfaceUnit

_SAME = 1e-9  # motions that differ by less than this fraction of their size on the points are one
_SINGULAR = 1e-13


class CoarseProblem:
    """Coarse problem of an assembly bound to the search direction k (n_flat,), Pa s m-1.

    shares : of one that several processes hold, the sums of forces that each of them has.
    """

    shares: Sequence[int] = ()

    def __init__(self, assembly: Assembly, k: Array) -> None:
        motions, self._interface = _motions(assembly, k)
        n, layout = motions.shape[1], assembly.layout
        second = np.zeros(layout.n_flat)
        for group in layout.groups:
            group.block(second)[1] = 1.0
        # the sides E of all motions, then the sides E': in a distributed run each process has the sums of its own sides
        sides = [sp.diags_array(layout.area * of_side) for of_side in (1.0 - second, second)]
        self._balance = sp.csr_array(sp.vstack([motions.T @ side for side in sides]))
        self._balance.eliminate_zeros()
        self._order = np.arange(2 * n)
        self._incoming = sp.csr_array(sp.diags_array(k) @ motions)
        responses = sp.lil_array(motions.shape)
        for propagator, channels in zip(assembly.propagators, assembly.channels, strict=True):
            for member in range(channels.shape[1]):
                rows = channels[:, member]
                load = self._incoming[rows]
                # only columns of the interfaces of this substructure
                touched = np.unique(load.indices)
                responses[rows[:, None], touched] = _responses(propagator, load[:, touched].toarray())
        self._response = sp.csr_array(responses)
        operator = (self._balance @ (self._incoming - sp.diags_array(k) @ self._response)).toarray()
        # the balance is that of both sides together
        operator = operator[:n] + operator[n:]
        self._inverse = _pseudo_inverse(0.5 * (operator + operator.T))

    def of_part(
        self, channels: Index, interfaces: Sequence[int], sides: Sequence[Sequence[int]], rank: int
    ) -> CoarseProblem:
        """The coarse problem as process ``rank`` holds it, with these channels and interfaces; ``sides`` : per
        interface of the assembly the processes of its sides."""
        part, here = copy.copy(self), np.flatnonzero(np.isin(self._interface, interfaces))
        # in the order of ``_balance``: all first sides, then all second ones
        processes = np.array(sides, dtype=np.int64).reshape(-1, 2)[self._interface].T.ravel()
        shares = [np.flatnonzero(processes == r) for r in range(int(np.max(sides)) + 1)]
        part.shares, part._order = [len(s) for s in shares], np.argsort(np.concatenate(shares))
        part._balance = self._balance[shares[rank]][:, channels]
        part._incoming, part._response = (m[channels][:, here] for m in (self._incoming, self._response))
        part._inverse = self._inverse[here]
        return part

    @property
    def sizes(self) -> dict[str, int]:
        """Numbers of its unknowns, of those here, and of sums of forces here."""
        here, size = self._inverse.shape
        return {"n_coarse": size, "n_coarse_here": here, "n_coarse_own": self._balance.shape[0]}

    def fields(self) -> dict[str, Array | Index | sp.csr_array]:
        """Fields with which the kernels balance q and the W of the substructures."""
        return {
            "coarse_inverse": self._inverse,
            "coarse_order": self._order,
            "coarse_balance": self._balance,
            "coarse_incoming": self._incoming,
            "coarse_answer": self._response,
        }


def _responses(propagator: Propagator, traction: Array) -> Array:
    """Y times tractions (n_channel, m) for the k that the propagator is bound to, m s-1."""
    ops = propagator.operators
    if not propagator.swept:
        return np.asarray((propagator.condensed * ops.area) @ traction)
    return applied(propagator.condensed, ops.trace, ops.compliance.gain, ops.area[:, None] * traction)


def _motions(assembly: Assembly, k: Array) -> tuple[sp.csr_array, Index]:
    """Affine motions of each interface on the channels of both its sides, (n_flat, n_coarse), and the interface of
    each."""
    columns, numbers = list[Array](), list[int]()
    rows: list[Index] = []
    for i, unit in enumerate(assembly.interfaces):
        first, second = (assembly.layout.channels(i, side).ravel() for side in (0, 1))
        moves = (k[first] > 0) & (k[second] > 0)  # where a side is rigid nothing balances
        if moves.any():
            basis = affine_motions(unit) * moves[:, None]
            size = np.sqrt(assembly.layout.area[first])[:, None]
            # orthonormal in the area of the points; dependent motions have no strength
            shapes, strength, _ = la.svd(size * basis, full_matrices=False)
            modes = strength > _SAME * strength[0]
            rows.append(np.concatenate([first, second]))
            columns.append(np.tile(shapes[:, modes] / size, (2, 1)))
            numbers += [i] * int(modes.sum())
    n = assembly.layout.n_flat
    starts = np.cumsum([0, *(c.shape[1] for c in columns)])
    blocks = [
        sp.coo_array(
            (c.ravel(), (np.repeat(r, c.shape[1]), np.tile(np.arange(c.shape[1]) + s, len(r)))),
            shape=(n, int(starts[-1])),
        )
        for r, c, s in zip(rows, columns, starts[:-1], strict=True)
    ]
    if blocks:
        motions = sp.csr_array(sum(blocks[1:], blocks[0]))
    else:
        motions = sp.csr_array((n, 0))
    return motions, np.array(numbers, dtype=np.int64)


def affine_motions(unit: InterfaceUnit) -> Array:
    """Velocities (n_point * n_component, 12) of the points of an interface in the motions 1, x, y, z along each axis,
    local frames; some depend on others (12 on 9 where the points lie in a plane)."""
    points = unit.geometry.points - unit.geometry.points.mean(axis=0)
    size = float(np.abs(points).max()) or 1.0  # of one point
    shapes = np.concatenate([np.ones((len(points), 1)), points / size], axis=1)
    motions = np.einsum("ps,ij->pijs", shapes, np.eye(3)).reshape(len(points), 3, -1)
    frames = unit.geometry.frames[:, : unit.behaviour.n_component]
    local: Array = np.einsum("pci,pim->pcm", frames, motions)
    return local.reshape(-1, local.shape[2])


def _pseudo_inverse(matrix: Array) -> Array:
    """Inverse of a symmetric positive matrix, zero on motions without resistance."""
    if not len(matrix):
        return matrix
    values, vectors = la.eigh(matrix)
    used = values > _SINGULAR * values[-1]
    inverse: Array = (vectors[:, used] / values[used]) @ vectors[:, used].T
    return inverse
