"""Constant operators shared by every member of a class of identical substructures."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import scipy.sparse as sp

from ..cholesky.factor import InterfaceFactor, interface_factor
from ..time_scheme import TimeScheme
from .conjugate_gradients import IterativeFactor
from .interface_matrices import seen_by_channels
from .model import Array, Index, SubstructureModel


@dataclass(frozen=True)
class Operators:
    """Reduced matrices, factor and interface admittance of one class at one time step.

    Attributes
    ----------
    mass, damping, stiffness : reduced matrices (n, n).
    factor : factor of A, interface dofs last. dofs : (n_gamma,) interface dofs.
    trace : (n_channel, n_gamma) from interface dofs to channels. spread : its transpose. area : (n_channel,).
    compliance : (n_channel, n_channel) velocities of the channels at the new instant per unit of nodal force
        on the channels, m s-1 N-1, symmetric: T D T^T.
    massless : dofs without mass. gain : velocities of the interface dofs per S^-1 times force, of the time scheme.
    """

    mass: sp.csr_array
    damping: sp.csr_array | None
    stiffness: sp.csr_array
    factor: InterfaceFactor
    dofs: Index
    trace: sp.csr_array
    spread: sp.csr_array
    area: Array
    compliance: Array
    massless: Index
    gain: float

    @property
    def admittance(self) -> Array:
        """Velocities of the channels per unit of traction, m3 N-1 s-1: T D T^T diag(area)."""
        return self.compliance * self.area


def build_operators(model: SubstructureModel, scheme: TimeScheme, dt: float) -> Operators:
    """Factorise and condense (once per class and time step)."""
    mass, damping, stiffness = model.reduced
    dofs, trace, rank = model.at_interface
    c_mass, c_damping, c_stiffness = scheme.operator(dt)
    factors, matrices = [c_mass, c_stiffness], [mass, stiffness]
    if damping is not None:
        factors, matrices = [*factors, c_damping], [*matrices, damping]
    pattern = model.operator_pattern
    matrix = pattern.sum(factors, matrices)
    factor: InterfaceFactor
    if model.factor == "cg":
        factor = IterativeFactor(matrix, dofs)
    else:
        factor = interface_factor(matrix, dofs, rank, np.dtype(model.factor), pattern.analyses)
    gain = scheme.interface_gain(dt) * scheme.force_weight
    return Operators(
        mass,
        damping,
        stiffness,
        factor,
        dofs,
        trace,
        model.spread,
        model.channel_area,
        seen_by_channels(trace, gain, factor.schur_inverse),
        model.massless,
        gain,
    )
