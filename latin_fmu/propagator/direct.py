"""Direct implicit propagator: one forward and one backward substitution per instant, contact in between.

The operator A = M + (1 + alpha)(gamma dt C + beta dt^2 K) is factorised once per class and step, interface dofs last;
identical substructures are members of one class and are solved together.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
import scipy.sparse as sp
import scipy.sparse.linalg as spla

from ..cholesky.factor import CholeskyFactor, InterfaceFactor, interface_factor
from ..time_scheme import TimeScheme
from .base import MassFactor, Propagator
from .conjugate_gradients import ConjugateGradients, IterativeFactor
from .interface_matrices import projected, with_dashpots
from .interface_sweeps import DashpotPattern, InterfaceCompliance
from .model import Array, Operators, SubstructureModel


@dataclass(frozen=True)
class ImplicitOperators(Operators):
    """Operators of one class at one time step; ``factor`` : of A.

    gain : velocities of the interface dofs per S^-1 times force, of the time scheme. with_dashpots : of a swept class
    its factor for dashpots (n_channel,), N s m-1, in the numbers of a type.
    """

    gain: float
    with_dashpots: Callable[[Array, Any], CholeskyFactor] | None = None


def build_operators(model: SubstructureModel, scheme: TimeScheme, dt: float) -> ImplicitOperators:
    """Factorise and condense (once per class and time step)."""
    mass, damping, stiffness = model.reduced
    dofs, trace, rank = model.at_interface
    c_mass, c_damping, c_stiffness = scheme.operator(dt)
    factors, matrices = [c_mass, c_stiffness], [mass, stiffness]
    if damping is not None:
        factors, matrices = [*factors, c_damping], [*matrices, damping]
    gain = scheme.interface_gain(dt) * scheme.traction_weight
    if model.swept:
        pattern = DashpotPattern(model)
        swept = pattern.factor(factors, np.zeros(len(model.channel_area)), model.factor)
        return ImplicitOperators(
            mass,
            damping,
            stiffness,
            swept,
            dofs,
            trace,
            model.spread,
            model.channel_area,
            InterfaceCompliance(swept, dofs, trace, gain, pattern.on_interface),
            model.massless,
            gain,
            lambda dashpots, dtype: pattern.factor(factors, gain * dashpots, dtype),
        )
    matrix = model.operator_pattern.sum(factors, matrices)
    factor: InterfaceFactor
    if model.factor == "cg":
        factor = IterativeFactor(matrix, dofs)
    else:
        factor = interface_factor(matrix, dofs, rank, np.dtype(model.factor))
    return ImplicitOperators(
        mass,
        damping,
        stiffness,
        factor,
        dofs,
        trace,
        model.spread,
        model.channel_area,
        projected(trace, gain, factor.schur_inverse),
        model.massless,
        gain,
    )


_HEAVY = 1e30


class DirectPropagator(Propagator):
    """March of a class of identical substructures (``base``).

    Parameters
    ----------
    twin : propagator of other substructures with the same operators and scheme, to share them; the others as for
        ``Propagator``.
    """

    operators: ImplicitOperators

    def __init__(
        self,
        members: Sequence[SubstructureModel],
        scheme: TimeScheme,
        dt: float,
        energy: bool,
        twin: DirectPropagator | None = None,
    ) -> None:
        super().__init__(members, scheme, dt, energy, None if twin is None else twin._kept)

    def _build(self, dt: float) -> ImplicitOperators:
        return build_operators(self.members[0], self.scheme, dt)

    def initial_unbalance(self, traction: Array) -> Array:
        """M a of the free dofs at t = 0 under tractions (n_channel, n_member); (n_dof, n_member), N."""
        ops, state = self.operators, self.state
        unbalance: Array = self.forcing.at(0)
        if state.u.any():
            unbalance -= ops.stiffness @ state.u
        if traction.any():
            unbalance += self._nodal(traction)
        if ops.damping is not None and state.v.any():
            unbalance -= ops.damping @ state.v
        inertia = self.forcing.inertia(0)
        return unbalance if inertia is None else unbalance - inertia

    def mass_factor(self) -> MassFactor:
        """Factor of M: needed once, where the start is not balanced."""
        mass = self.operators.mass
        if self.operators.massless.size:  # they start without acceleration
            heavy = np.zeros(self.n_dof)
            heavy[self.operators.massless] = _HEAVY * mass.diagonal().max()
            mass = mass + sp.diags_array(heavy)
        return spla.splu(sp.csc_matrix(mass), permc_spec="MMD_AT_PLUS_A", options={"SymmetricMode": True})

    def _condense(self, k: Array) -> Array | CholeskyFactor:
        ops = self.operators
        if ops.with_dashpots is not None:
            return ops.with_dashpots(ops.area * k, "float32" if self.single else self.members[0].factor)
        return with_dashpots(ops.trace, ops.gain, ops.factor.schur, ops.area * k)


class CgPropagator(DirectPropagator):
    """March of a class of identical substructures; every solution by conjugate gradients (``conjugate_gradients``)."""

    def __init__(self, members: Sequence[SubstructureModel], scheme: TimeScheme, dt: float, energy: bool) -> None:
        super().__init__([m.with_factor("cg") for m in members], scheme, dt, energy)

    def mass_factor(self) -> ConjugateGradients:
        """Solver with the mass matrix, by conjugate gradients."""
        mass = self.operators.mass
        if self.operators.massless.size:  # they start without acceleration
            heavy = mass.diagonal().max() * 1e30
            mass = sp.csr_array(mass + sp.diags_array(heavy * (mass.diagonal() <= 0.0)))
        return ConjugateGradients(mass)
