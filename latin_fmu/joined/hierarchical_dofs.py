"""Dofs of contact faces of second order: the middle of an edge by its distance from the line between the corners.

Where the corners of facets alone are points, the motion of a point of the owner is, with the dual functions psi,

    T u = u_corner + int psi phi_middle (u_middle - (u_1 + u_2) / 2)

With d_middle = u_middle - (u_1 + u_2) / 2 in the place of u_middle, a hierarchical basis, every point has one corner
dof that belongs to no other point: what keeps the sides together, or makes relative motions dofs, is solved point by
point. With the values at the nodes it is the inverse of a matrix over the whole face, and all its dofs depend on each
other (``examples/benchmarks/contact_dofs.py`` measures both).
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np
import scipy.sparse as sp

from ..assembly.body import body_sides
from ..latin.assembly import Array, InterfaceUnit


@dataclass(frozen=True)
class HierarchicalDofs:
    """x = y + linear y: reduced dofs x of all bodies by hierarchical ones y.

    Attributes
    ----------
    linear : (n, n) of the dofs at inner nodes by those at corners, with linear^2 = 0; None where all dofs are those of
        the nodes.
    """

    linear: sp.csr_array | None

    @staticmethod
    def of(units: Sequence[InterfaceUnit], where: Mapping[str, slice], expansion: sp.csr_array) -> HierarchicalDofs:
        """Of the owners of interfaces; ``where`` : slices of the full dofs of the bodies among those of all,
        ``expansion`` : (n_full, n)."""
        n_full, n = expansion.shape
        every = sp.csr_array((n_full, n_full))
        for i, side, name in body_sides(units):
            geometry = units[i].geometry
            part = where.get(name)
            if geometry.linear is None or side != geometry.owner or part is None:
                continue
            of_vectors = sp.kron(geometry.linear, sp.eye_array(3), format="coo")
            # rigid bodies, and bodies that were joined to one, have other dofs
            if of_vectors.shape[0] == part.stop - part.start:
                places = tuple(index + part.start for index in of_vectors.coords)
                one = sp.csr_array(sp.coo_array((of_vectors.data, places), shape=every.shape))
                # an edge of two interfaces counts once
                every = sp.csr_array(every.maximum(one))
        # a full dof that is a reduced one, and nothing else is
        entries = np.diff(sp.csc_array(expansion).indptr)
        single = np.flatnonzero((np.diff(expansion.indptr) == 1) & (np.diff(every.indptr) > 0))
        columns = expansion.indices[expansion.indptr[single]]
        alone = (entries[columns] == 1) & (expansion.data[expansion.indptr[single]] == 1.0)
        rows, columns = single[alone], columns[alone]
        if not len(rows):
            return HierarchicalDofs(None)
        to_columns = sp.csr_array(sp.coo_array((np.ones(len(rows)), (columns, rows)), shape=(n, n_full)))
        return HierarchicalDofs(sp.csr_array(to_columns @ (every @ expansion)))

    def expanded(self, expansion: sp.csr_array) -> sp.csr_array:
        """Expansion (n_full, n) of the hierarchical dofs from that of the reduced ones."""
        if self.linear is None:
            return expansion
        return sp.csr_array(expansion + expansion @ self.linear)

    def congruent(self, matrix: sp.csr_array) -> sp.csr_array:
        """A matrix (n, n) of the reduced dofs as one of the hierarchical dofs."""
        if self.linear is None:
            return matrix
        both = sp.csr_array(sp.eye_array(matrix.shape[0]) + self.linear)
        return sp.csr_array(both.T @ matrix @ both)

    def reduced(self, y: sp.csr_array) -> sp.csr_array:
        """x (n, k) of hierarchical dofs y."""
        return y if self.linear is None else sp.csr_array(y + self.linear @ y)

    def of_reduced(self, x: Array) -> Array:
        """y (n,) or (n, k) of reduced dofs x."""
        return x if self.linear is None else x - self.linear @ x
