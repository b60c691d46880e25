"""The direct propagator without a factor: conjugate gradients where the factor does not fit in memory."""

from __future__ import annotations

from collections.abc import Sequence

import scipy.sparse as sp

from ..time_scheme import TimeScheme
from .conjugate_gradients import ConjugateGradients
from .direct import DirectPropagator
from .model import SubstructureModel


class CgPropagator(DirectPropagator):
    """March of a class of identical substructures; every solution by conjugate gradients (``conjugate_gradients``)."""

    def __init__(self, members: Sequence[SubstructureModel], scheme: TimeScheme, dt: float, energy: bool) -> None:
        super().__init__([m.with_factor("cg") for m in members], scheme, dt, energy)

    def mass_factor(self) -> ConjugateGradients:
        """Solver with M."""
        mass = self.operators.mass
        if self.operators.massless.size:  # they start without acceleration
            heavy = mass.diagonal().max() * 1e30
            mass = sp.csr_array(mass + sp.diags_array(heavy * (mass.diagonal() <= 0.0)))
        return ConjugateGradients(mass)
