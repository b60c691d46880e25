"""Constant operators of a class of identical substructures without inertia.

K alone is singular where a body floats. The factor is that of K with springs k_0 on the interface,

    A = K + T^T a k_0 T

(T from dofs to channels, a their areas, k_0 a stiffness of the body's own size): T reaches the interface dofs only, so
that the inside is eliminated as in K and springs of any other size follow from the dense matrix left on the interface,

    S(k) = S(k_0) + T^T a (k - k_0) T.

Nothing depends on the time step.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import scipy.linalg as la
import scipy.linalg.lapack as lapack
import scipy.sparse as sp

from ..cholesky.factor import InterfaceFactor, interface_factor
from .model import Array, Index, SubstructureModel, reduced_rank


@dataclass(frozen=True)
class StaticOperators:
    """Reduced stiffness, its factor and the compliance seen by the interfaces, for one length of increment.

    Attributes
    ----------
    stiffness : reduced (n, n), N m-1. factor : of K with springs, interface dofs last. dofs : (n_gamma,) interface
        dofs. trace : (n_channel, n_gamma) from interface dofs to channels. area : (n_channel,), m2.
    springs : (n_channel,) k_0, Pa m-1. diagonal : (n_channel,) stiffness per area that each channel sees when the
        others are held, Pa m-1.
    compliance : (n_channel, n_channel) velocities of the channels per unit of nodal force, m s-1 N-1, of the body on
        its springs: D of one instant does not exist for a floating body, (D^-1 + k_0)^-1 always does.
    """

    stiffness: sp.csr_array
    factor: InterfaceFactor
    dofs: Index
    trace: sp.csr_array
    area: Array
    springs: Array
    diagonal: Array
    compliance: Array

    @property
    def massless(self) -> Index:
        """Dofs without mass: none is marked."""
        return np.zeros(0, dtype=np.int64)

    @property
    def admittance(self) -> Array:
        """Velocities of the channels per unit of traction, on the springs, m3 N-1 s-1."""
        return self.compliance * self.area

    def on_springs(self, k: Array) -> Array:
        """(S + T^T a k T)^-1 for springs k (n_channel,), Pa m-1: displacements of the interface dofs, m N-1.

        Raises
        ------
        numpy.linalg.LinAlgError : springs that leave the body free to move.
        """
        if not len(self.dofs):
            return np.zeros((0, 0))
        shift = self.trace.T @ sp.diags_array(self.area * (k - self.springs)) @ self.trace
        root, info = lapack.dpotrf((self.factor.schur + shift.toarray()).T, lower=0, overwrite_a=1)
        if info:
            raise la.LinAlgError("springs that leave the body free to move")
        half, _ = lapack.dpotri(root, lower=0, overwrite_c=1)  # one triangle, zeros in the other
        inverse: Array = half + half.T
        inverse[np.diag_indices_from(inverse)] *= 0.5
        return inverse


def build_static_operators(model: SubstructureModel, springs: Array, dt: float) -> StaticOperators:
    """Reduce, factorise and condense (once per class); ``springs`` (n_channel,), Pa m-1."""
    p = model.expansion
    stiffness = model.reduced_stiffness
    trace = sp.csc_array(model.trace @ p)
    dofs = np.flatnonzero(np.diff(trace.indptr)).astype(np.int64)
    rank = None if model.ordering is None else reduced_rank(p, model.ordering)
    held = sp.csr_array(trace.T @ sp.diags_array(model.channel_area * springs) @ trace)
    factor = interface_factor(sp.csr_array(stiffness + held), dofs, rank)
    local = sp.csr_array(trace[:, dofs])
    own = np.einsum("ij,ij->i", local @ factor.schur, local.toarray()) / model.channel_area
    moves = np.diff(local.indptr) > 0
    diagonal = np.where(moves, np.maximum(own - springs, springs), 0.0)  # a rigid body has none of its own
    compliance = local @ (local @ factor.schur_inverse).T / dt
    return StaticOperators(
        stiffness, factor, dofs, local, model.channel_area, springs, diagonal, 0.5 * (compliance + compliance.T)
    )
