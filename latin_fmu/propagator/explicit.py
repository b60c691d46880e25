"""Explicit propagator: central differences with a lumped mass; no factor, D diagonal but for damping and ties.

One instant is one product with K. The interface velocity is v_{n+1}, D = dt T (M + dt/2 C_d)^-1 T^T with C_d the
lumped part of the damping, so that with k = 1 / D_ii the iteration needs one pass (``time_scheme.scheme``
has the equations, ``stable_step`` the longest step).
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
import scipy.sparse as sp
import scipy.sparse.linalg as spla

from ..cholesky.factor import CholeskyFactor, DiagonalFactor
from ..errors import SolverError
from ..time_scheme import TimeScheme
from .base import MassFactor, Propagator
from .interface_matrices import projected, projected_diagonal
from .model import Array, Histories, Operators, SubstructureModel, lumped
from .stable_step import StableStep

_NONE = np.zeros(0, dtype=np.int64)


def _lumped_damping(model: SubstructureModel, damping: sp.csr_array) -> sp.csr_array:
    """Row sums of the damping over the nodes, unless the model has better ones."""
    if model.lumped_damping is None:
        return lumped(damping, nodal=True)
    return model.lumped_damping


class ExplicitPropagator(Propagator):
    """March of a class of identical substructures by central differences (module docstring).

    Parameters
    ----------
    members : models with equal matrices and traces. scheme : central differences. dt : step, s. energy : whether to
        account for energies.

    Attributes
    ----------
    stability : which steps are stable.
    """

    operators: Operators

    def __init__(self, members: Sequence[SubstructureModel], scheme: TimeScheme, dt: float, energy: bool) -> None:
        rigid = members[0].nodal is not None  # a few unknowns, no stiffness: taken as they are
        if not rigid:
            # one object for all members: what is lumped and reduced is shared
            first = members[0].with_lumped_mass
            members = [first, *(m.with_mass(first.inertia) for m in members[1:])]
        model, p = members[0], members[0].expansion
        self._mass, self._damping, self._stiffness = model.reduced
        lagged: sp.csr_array | None = None
        if model.damping is not None and self._damping is not None:
            if rigid:
                self.dashpots = model.damping
            else:
                self.dashpots = _lumped_damping(model, model.damping)
            # the rest of C acts at the old instant, so that the operator stays diagonal
            lagged = sp.csr_array(self._damping - p.T @ self.dashpots @ p)
        stiffness = model.branches.instantaneous * self._stiffness
        if rigid:  # without stiffness
            self.stability = StableStep(np.zeros(0), stiffness, None)
        else:
            self.stability = StableStep(self._mass.diagonal(), stiffness, lagged)
        super().__init__(members, scheme, dt, energy)

    def begin(self, histories: Sequence[Histories], dt: float) -> None:
        """As ``Propagator.begin``, after a check of the step.

        Raises
        ------
        SolverError : the step is not stable.
        """
        if not self.stability.allows(dt):
            raise SolverError(
                f"explicit propagator, {', '.join(self.names)}: step {dt:.6g} s; allowed: at most "
                f"{self.stability.longest:.6g} s, the stable one; use smaller steps, or an implicit propagator"
            )
        super().begin(histories, dt)

    def _build(self, dt: float) -> Operators:
        model, mass = self.members[0], self._mass
        if self.dashpots is not None:
            p = model.expansion
            mass = sp.csr_array(mass + 0.5 * dt * (p.T @ self.dashpots @ p))
            mass.eliminate_zeros()
        same = (self._mass, self._damping, self._stiffness)
        # every entry on the diagonal, once zeros are gone
        if mass.nnz == mass.shape[0]:
            factor = DiagonalFactor(mass.diagonal())
            trace, spread = model.reduced_trace, model.reduced_spread
            compliance = projected_diagonal(trace, dt, factor.inverse)
            return Operators(*same, factor, factor.last, trace, spread, model.channel_area, compliance, _NONE)
        dofs, trace, _ = model.at_interface
        # blocks of nodes with oblique dashpots, or a rigid body: the inverse has no more entries than these blocks
        full = sp.csr_array(spla.inv(sp.csc_matrix(mass)))
        compliance = projected(trace, dt, full[dofs][:, dofs].toarray())
        return Operators(
            *same, CholeskyFactor(mass, dofs), dofs, trace, model.spread, model.channel_area, compliance, _NONE
        )

    # -- start ------------------------------------------------------------------------------------------------
    def internal_forces(self) -> tuple[Array, Array]:
        """K u and C v of the free dofs, (n_dof, n_member), N."""
        state, damping = self.state, self._damping
        if state.u.any():
            elastic = self._stiffness @ state.u
        else:
            elastic = np.zeros_like(state.u)
        if damping is None or not state.v.any():
            viscous = np.zeros_like(state.v)
        else:
            viscous = damping @ state.v
        return elastic, viscous

    def mass_factor(self) -> MassFactor:
        """Solver with the lumped mass."""
        return spla.splu(sp.csc_matrix(self._mass))
