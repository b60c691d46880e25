"""Mean stress of each element, on demand."""

from __future__ import annotations

import numpy as np
import skfem

from .elasticity import lame
from .mesh import Array

_ROWS, _COLUMNS = (0, 1, 2, 1, 0, 0), (0, 1, 2, 2, 2, 1)


class MeanStress:
    """Stress recovery for one mesh and material; the mean gradients are computed once.

    Parameters
    ----------
    basis : from ``element_basis``. young_modulus : Pa. poisson_ratio : 1.
    """

    def __init__(self, basis: skfem.Basis, young_modulus: float, poisson_ratio: float) -> None:
        gradient = np.stack([phi[0].grad for phi in basis.basis])
        self._mean = np.einsum("aieq,eq->eai", gradient, basis.dx) / basis.dx.sum(axis=1)[:, None, None]
        self._nodes = basis.element_dofs.T
        self._lame = lame(young_modulus, poisson_ratio)

    def __call__(self, displacement: Array) -> Array:
        """Mean stress (n_cell, 6), Pa, order xx yy zz yz xz xy, of displacements (n_node, 3), m."""
        first, shear = self._lame
        slope = np.swapaxes(self._mean, 1, 2) @ displacement[self._nodes]
        stress = shear * (slope + np.swapaxes(slope, 1, 2))
        stress += first * np.trace(slope, axis1=1, axis2=2)[:, None, None] * np.eye(3)
        picked: Array = stress[:, _ROWS, _COLUMNS]
        return picked
