"""Propagator without inertia: one equilibrium per increment of load, on the springs of the search direction.

With W = T (u_{n+1} - u_n) / dt and the linear stage F = q - k W, (12)-(14) without mass read

    (K + T^T a k/dt T) (u_{n+1} - u_n) = f_{n+1} - K u_n + T^T a q

whose operator is regular for a floating body too. The whole load f_{n+1} is balanced at every increment, so that what
one increment leaves unbalanced is not carried on. An instant ends with the incoming quantity q: tractions alone do not
tell where a floating body stands. The steps stand in ``kernels.substructure``.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from typing import NoReturn

import numpy as np

from ..time_scheme import QuasiStatic
from .base import Propagator
from .model import Array, SubstructureModel
from .static_operators import StaticOperators, build_static_operators


class StaticPropagator(Propagator):
    """Equilibria of a class of identical substructures (module docstring).

    Parameters
    ----------
    members : models with equal matrices and traces. dt : length of the increments, s (``begin`` may change it).
    energy : whether to account for energies. springs : (n_channel,) stiffness per area of the body's own size, Pa m-1.

    Attributes
    ----------
    spring_inverse : (S + T^T a k/dt T)^-1 for the k of the last ``bind``, (n_gamma, n_gamma), m N-1.
    """

    operators: StaticOperators

    def __init__(self, members: Sequence[SubstructureModel], dt: float, energy: bool, springs: Array) -> None:
        self._springs = springs
        super().__init__(members, QuasiStatic(), dt, energy)
        self.spring_inverse = self.operators.factor.schur_inverse  # on the springs, until ``bind``

    def _build(self, dt: float) -> StaticOperators:
        """One factor serves every length of increment."""
        if not self._kept:
            return build_static_operators(self.members[0], self._springs, dt)
        known, operators = self._kept[-1]
        assert isinstance(operators, StaticOperators)
        return replace(operators, compliance=operators.compliance * (known / dt))

    def initial_unbalance(self, traction: Array) -> Array:  # noqa: ARG002, as other propagators
        """Zeros: nothing acts at t = 0 but what is in equilibrium."""
        return np.zeros_like(self.state.u)

    def start(self, traction: Array, factor: object) -> None:
        """Equilibrium at t = 0: displacements as they are, no velocity."""

    def mass_factor(self) -> NoReturn:
        """There is no mass."""
        raise TypeError("no inertia: a quasi-static substructure has no mass")

    def initial_channels(self, factor: object, unbalance: Array) -> NoReturn:  # noqa: ARG002
        """There are no accelerations."""
        raise TypeError("no inertia: a quasi-static substructure has no accelerations")

    def _condense(self, k: Array) -> Array:
        """Y = T (S + T^T a k/dt T)^-1 T^T / dt."""
        trace = self.operators.trace
        self.spring_inverse = self.operators.on_springs(k / self.dt)
        condensed: Array = trace @ (trace @ self.spring_inverse).T / self.dt
        return 0.5 * (condensed + condensed.T)
