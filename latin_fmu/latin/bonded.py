"""Assemblies whose interfaces are all perfect: one linear solve per instant instead of an iteration.

With v = v_free + D lambda on every side, equal velocities and opposite forces of both sides are the linear system

    S x = v'_free - v_free,    S = D + D' assembled over all interfaces (symmetric, constant),

x the nodal forces on sides E. S is factorised once. Redundant bonds (an edge where four bodies meet) make the system
singular but leave it consistent: a shift of 1e-10 of its diagonal and iterative refinement give a solution of the
original system.
"""

from __future__ import annotations

import numpy as np
import scipy.sparse as sp

from ..interface.behaviour import bonds
from ..propagator.cholesky import interface_factor
from .assembly import Assembly
from .layout import Array

_SHIFT, _PRECISE, _REFINEMENTS, _SOLVED = 1e-10, 1e-13, 8, 1e-8
_DENSE = 1500  # interface unknowns up to which the bonds are one dense operator
LARGEST = 200_000_000
"""Entries of S (an upper bound) up to which it is worth factorising."""


def all_bonded(assembly: Assembly) -> bool:
    """Whether there are interfaces, all of them perfect, and S has at most ``LARGEST`` entries."""
    if assembly.quasi_static or not assembly.interfaces or not all(bonds(u.behaviour) for u in assembly.interfaces):
        return False
    return sum(int(c.shape[0]) ** 2 * int(c.shape[1]) for c in assembly.channels) <= LARGEST


class Bonds:
    """The bonds of an assembly as one linear system, for its present time step."""

    def __init__(self, assembly: Assembly) -> None:
        self.assembly = assembly
        every = range(len(assembly.interfaces))
        self._first, self._second = (
            np.concatenate([assembly.layout.channels(i, side).ravel() for i in every]) for side in (0, 1)
        )
        self._area = assembly.layout.area[self._first]
        self._matrix = self._assemble()
        diagonal = self._matrix.diagonal()
        shift = np.where(diagonal > 0, _SHIFT * diagonal, 1.0)
        none = np.zeros(0, dtype=np.int64)
        self._factor = interface_factor(sp.csr_array(self._matrix + sp.diags_array(shift)), none)

    def _assemble(self) -> sp.csr_array:
        """S: velocities per nodal force, m s-1 N-1."""
        n_flat, n = self.assembly.layout.n_flat, len(self._first)
        row, sign = np.empty(n_flat, dtype=np.int64), np.ones(n_flat)
        row[self._first] = row[self._second] = np.arange(n)
        sign[self._second] = -1.0
        parts: list[tuple[Array, Array, Array]] = []
        for propagator, channels in zip(self.assembly.propagators, self.assembly.channels, strict=True):
            compliance = propagator.operators.compliance
            for member in channels.T:
                block = compliance * sign[member] * sign[member][:, None]
                parts.append((np.repeat(row[member], len(member)), np.tile(row[member], len(member)), block.ravel()))
        rows, columns, values = (np.concatenate(part) for part in zip(*parts, strict=True))
        return sp.coo_array((values, (rows, columns)), shape=(n, n)).tocsr()

    def tractions(self, free: Array) -> tuple[Array, float]:
        """Tractions (n_flat,) that close the jumps of the velocities ``free`` (n_flat,), and the jump left over the
        largest velocity."""
        jump = free[self._second] - free[self._first]
        force, left = np.zeros_like(jump), jump
        largest = float(np.abs(free).max(initial=0.0))
        for _ in range(_REFINEMENTS):
            if np.abs(left).max(initial=0.0) <= _PRECISE * largest:
                break
            force = force + self._factor.solve(left[:, None])[:, 0]
            left = jump - self._matrix @ force
        traction = np.zeros_like(free)
        traction[self._first], traction[self._second] = force / self._area, -force / self._area
        return traction, float(np.abs(left).max(initial=0.0)) / largest if largest > 0 else 0.0

    def incoming(self, k: Array) -> Array | None:
        """Operator (n_flat, n_flat) from the velocities without traction to q = F + k W of the bonds, for the compiled
        march; None where it is too large, or where redundant bonds make it inexact."""
        n_flat = len(k)
        if n_flat > _DENSE:
            return None
        jump = np.zeros((len(self._first), n_flat))
        jump[np.arange(len(self._first)), self._second] = 1.0
        jump[np.arange(len(self._first)), self._first] = -1.0
        force = self._factor.solve(jump)
        force += self._factor.solve(jump - self._matrix @ force)
        if not np.abs(self._matrix @ force - jump).max(initial=0.0) <= _SOLVED:
            return None
        traction = np.zeros((n_flat, n_flat))
        traction[self._first], traction[self._second] = (force / self._area[:, None], -force / self._area[:, None])
        velocity = np.eye(n_flat)
        for propagator, channels in zip(self.assembly.propagators, self.assembly.channels, strict=True):
            for member in channels.T:
                velocity[member] += propagator.operators.admittance @ traction[member]
        return traction + k[:, None] * velocity

    def guess(self, free: Array, k: Array) -> Array:
        """q = F + k W (n_flat,) of the bonds for the velocities ``free`` without tractions."""
        traction, _ = self.tractions(free)
        velocity = free.copy()
        for propagator, channels in zip(self.assembly.propagators, self.assembly.channels, strict=True):
            velocity[channels] += propagator.operators.admittance @ traction[channels]
        q: Array = traction + k * velocity
        return q
