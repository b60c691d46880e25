"""Tractions of bonds that are no unknowns, from the equilibrium of the bodies that they join.

With the internal forces, inertia, loads and forces of the other interfaces in g, at the free dofs of the bodies,

    T^T area F = g

in the least-squares sense over the dofs at bonded faces, as each bond is met from both sides. What goes round in closed
loops of bonds is not determined by it, and becomes zero.
"""

from __future__ import annotations

from collections.abc import Sequence
from functools import cached_property
from typing import Final

import numpy as np
import scipy.sparse as sp
import scipy.sparse.linalg as spla

from ..latin.assembly import Array, Layout
from .tied_assembly import jump_rows

_REGULAR: Final = 1e-12  # of the diagonal of the system of the bonds: what goes round in loops becomes zero


class BondForces:
    """Tractions of the bonds of an assembly (module docstring).

    Parameters
    ----------
    bonded : numbers of the interfaces. layout : of all. trace : (n_flat, n_full) from the full dofs of all bodies to
    the channels. expansion : (n_full, n) of all bodies.
    """

    def __init__(self, bonded: Sequence[int], layout: Layout, trace: sp.csr_array, expansion: sp.csr_array) -> None:
        self._bonded, self._expansion = tuple(bonded), expansion
        forces, self._counts = list[sp.csr_array](), list[int]()
        for i in bonded:
            areas = layout.area[layout.channels(i, 0).ravel()]
            rows = sp.diags_array(areas) @ jump_rows(layout, trace, i)
            forces.append(sp.csr_array(rows @ expansion))
            self._counts.append(len(areas))
        matrix = sp.csr_array(sp.vstack(forces))
        self._dofs = np.unique(matrix.indices)
        matrix = sp.csr_array(matrix[:, self._dofs])
        # each dof by the area that it carries
        weight = np.asarray(abs(matrix).sum(axis=0)).ravel()
        self._weighted = sp.csr_array(matrix @ sp.diags_array(1.0 / np.maximum(weight, np.finfo(float).tiny)))
        system = sp.csc_array(self._weighted @ matrix.T)
        diagonal = system.diagonal()
        system = sp.csc_array(system + sp.diags_array(_REGULAR * diagonal + np.where(diagonal > 0.0, 0.0, 1.0)))
        self._factor = spla.splu(system)

    @cached_property
    def rows(self) -> sp.csr_array:
        """From forces (n_full,) on the bodies to those on the dofs at bonded faces."""
        return sp.csr_array(sp.csc_array(self._expansion)[:, self._dofs].T)

    def tractions(self, forces: Array) -> dict[int, Array]:
        """Tractions (k, n_channel) on side E of each bond, local frames, Pa, for forces g (n_full, k), N."""
        return self.carried(np.asarray(self.rows @ forces))

    def sums(self, weights: dict[int, Array]) -> sp.csr_array:
        """Rows (k, n_full) that give sums of tractions of all bonds by forces g: of the bond ``i`` with the weights
        (k, n_channel) of ``weights[i]``, by the transpose of what gives the tractions, whose system is symmetric."""
        wanted = np.hstack([weights[i] for i in self._bonded])
        solved = self._factor.solve(np.ascontiguousarray(wanted.T))
        return sp.csr_array(sp.csr_array(np.asarray(self._weighted.T @ solved).T) @ self.rows)

    def carried(self, wanted: Array) -> dict[int, Array]:
        """The same for forces that are taken to ``rows`` already."""
        loads = (self._weighted @ wanted).T
        # an instant at a time: for many columns at once BLAS rounds by their number, and a run that is continued has
        # blocks of other lengths
        solved = np.stack([self._factor.solve(np.ascontiguousarray(load)) for load in loads], axis=1)
        ends = np.cumsum(self._counts)
        parts = zip(self._bonded, self._counts, ends.tolist(), strict=True)
        return {i: solved[end - count : end].T for i, count, end in parts}
