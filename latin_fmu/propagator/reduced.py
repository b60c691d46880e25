"""Reduced propagator: a few vibration modes and exact static responses instead of the mesh (``reduction``).

In Ritz coordinates the mass is the unit matrix and the stiffness diagonal, so that one instant is two products with
the dense trace and a few operations on vectors; the time scheme is that of the scene. Prescribed motions are
coordinates of their own: the reduced substructure is a ``SubstructureModel`` with the Ritz vectors for ``nodal``
values, and loads, energies and histories work on it as on any other.

Error estimate: the Ritz vectors beyond the modes are exact in statics and represent, each with a frequency of its own,
all modes left out. Their share in the interface velocity without its rigid part (root mean square over the run) is
what the mesh would spread over many modes. Contact forces follow the strains: beside a velocity that all bodies share,
a wrong force would seem small, and differently small in each frame of reference. Measured on crushed blocks the share
in the whole velocity is 1.4 to 6 times the error of that velocity, and 9 to 100 times that of the contact force; in
short hits of free bodies that of the elastic part is twice the error of the force.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np
import scipy.linalg as la
import scipy.sparse as sp

from ..cholesky.factor import CholeskyFactor, DiagonalFactor, InterfaceFactor
from ..time_scheme import TimeScheme
from .base import Propagator
from .model import Array, Index, LoadTerm, SubstructureModel, closest_reduced, operator_weights, unrelaxed_part
from .reduction import modal_damping, reduce_model


@dataclass(frozen=True)
class ReducedOperators:
    """Operators of one class at one time step, dense; the mass is the unit matrix.

    Attributes
    ----------
    diagonal : (m,) of the stiffness. damp : (m, m) damping or None. dofs : all. trace : (n_channel, m). The others :
    see ``Operators``.
    """

    diagonal: Array
    damp: Array | None
    mass: sp.csr_array
    damping: sp.csr_array | None
    stiffness: sp.csr_array
    factor: InterfaceFactor
    dofs: Index
    trace: Array
    area: Array
    compliance: Array
    massless: Index

    @property
    def spread(self) -> Array:
        """Transpose of the trace."""
        return self.trace.T

    @property
    def admittance(self) -> Array:
        """Velocities of the channels per traction, T D T^T diag(area), m3 N-1 s-1."""
        return self.compliance * self.area


class _Unit:
    """Solver with the unit matrix."""

    def solve(self, b: Array) -> Array:
        """The right-hand side b itself."""
        return b


class ReducedPropagator(Propagator):
    """March of a class of identical substructures in Ritz coordinates (module docstring).

    Parameters
    ----------
    members : models with equal matrices and traces. scheme, dt : time scheme and step, s. energy : whether to account
        for energies. n_mode : elastic modes of the basis. twin : propagator of substructures with the same matrices,
        scheme, step and number of modes, to share them where loads and initial values are the same.
    """

    operators: ReducedOperators
    n_mode: int

    def __init__(
        self,
        members: Sequence[SubstructureModel],
        scheme: TimeScheme,
        dt: float,
        energy: bool,
        n_mode: int,
        twin: ReducedPropagator | None = None,
    ) -> None:
        self._full_members = list(members)
        if twin is not None and _same_basis(twin._full_members, members):
            reduced = twin.members
            self.n_mode = twin.n_mode
            operators = twin._operators_by_step
        else:
            (reduced, self.n_mode), operators = reduced_members(members, n_mode), None
        super().__init__(reduced, scheme, dt, energy, operators)

    def _build(self, dt: float) -> ReducedOperators:
        model, scheme = self.members[0], self.scheme
        mass, damping, stiffness = model.reduced
        diagonal = stiffness.diagonal()
        c_mass, c_damping, c_stiffness = operator_weights(model, scheme, dt)
        # coordinates are orthonormal in the mass
        a = c_mass + c_stiffness * diagonal
        damp, unrelaxed = None if damping is None else damping.toarray(), unrelaxed_part(model)
        coupling = None if damp is None else c_damping * damp
        if unrelaxed is not None:
            # it has no branches
            without = (scheme.operator(dt)[2] - c_stiffness) * unrelaxed.toarray()
            coupling = without if coupling is None else coupling + without
        trace: Array = (model.trace @ model.expansion).toarray()
        if coupling is None:
            scaled = (1.0 / a)[:, None] * trace.T
        else:
            # of the coordinates
            scaled = la.inv(np.diag(a) + coupling) @ trace.T
        compliance = scheme.interface_gain(dt) * scheme.traction_weight * (trace @ scaled)
        dofs = np.arange(len(diagonal))
        # products of rounded factors: symmetric to round-off
        symmetric = 0.5 * (compliance + compliance.T)
        factor: InterfaceFactor = DiagonalFactor(a)
        if coupling is not None:
            factor = CholeskyFactor(sp.csr_array(np.diag(a) + coupling), dofs)
        return ReducedOperators(
            diagonal,
            damp,
            mass,
            damping,
            stiffness,
            factor,
            dofs,
            trace,
            model.channel_area,
            symmetric,
            np.zeros(0, dtype=np.int64),
        )

    # -- start ------------------------------------------------------------------------------------------------
    def internal_forces(self) -> tuple[Array, Array]:
        """K u and C v of the modes, (n_mode, n_member), N kg-1/2."""
        ops, state = self.operators, self.state
        if ops.damp is None:
            viscous = np.zeros_like(state.v)
        else:
            viscous = ops.damp @ state.v
        return ops.diagonal[:, None] * state.u, viscous

    def mass_factor(self) -> _Unit:
        """Solver with the mass matrix, the unit matrix here."""
        return _Unit()

    def sample(self) -> None:
        """Add the share of what is not a mode in the interface velocity (see the module docstring)."""
        ops, v = self.operators, self.state.v
        # rigid motions, then elastic modes, then static responses
        rigid = int((ops.diagonal == 0.0).sum())
        first = rigid + self.n_mode
        # squares of interface velocities, summed over instants: of what is no mode, of all but the rigid motions
        self.sampled[0] += float(np.square(ops.trace[:, first:] @ v[first:]).sum())
        self.sampled[1] += float(np.square(ops.trace[:, rigid:] @ v[rigid:]).sum())

    def remarks(self) -> list[str]:
        """The error that the reduction brings."""
        beyond, every = self.sampled
        if every == 0.0:
            return []
        share = float(np.sqrt(beyond / every))
        return [
            f"reduced to {self.n_mode} modes, {', '.join(self.names)}: estimated error of the interface velocities "
            f"{100 * share:.2g} % of their elastic part (root mean square over the run); that of contact forces is "
            "smaller"
        ]


def _same_basis(first: Sequence[SubstructureModel], second: Sequence[SubstructureModel]) -> bool:
    """Whether models with equal matrices have equal loads and initial values, which the Ritz vectors depend on."""

    def data(model: SubstructureModel) -> list[Array]:
        if model.imposed_speed is None:
            speed = np.zeros(0)
        else:
            speed = model.imposed_speed
        return [model.displacement, model.velocity, model.imposed_start, speed, *(load.pattern for load in model.loads)]

    names = [[(m.name, [load.name for load in m.loads]) for m in models] for models in (first, second)]
    return names[0] == names[1] and all(
        np.array_equal(a, b) for m, n in zip(first, second, strict=True) for a, b in zip(data(m), data(n), strict=True)
    )


def reduced_members(members: Sequence[SubstructureModel], n_mode: int) -> tuple[list[SubstructureModel], int]:
    """Members of a class in Ritz coordinates (m of them, then one per prescribed motion), one basis for all, and the
    number of its elastic modes.

    Raises
    ------
    ValueError : a mass that is not positive definite.
    """
    model = members[0]
    reduction = reduce_model(_together(members), n_mode)
    basis = reduction.basis
    shapes = np.column_stack([basis, model.imposed_pattern])
    m, n_motion = basis.shape[1], model.imposed_pattern.shape[1]

    def projected(matrix: sp.csr_array) -> Array:
        product: Array = shapes.T @ (matrix @ shapes)
        return 0.5 * (product + product.T)

    mass, stiffness = projected(model.inertia), projected(model.stiffness)
    mass[:m, :m] = np.eye(m)  # but for round-off
    stiffness[:m, :m] = np.diag(reduction.eigenvalues)
    damping = None
    if model.damping is not None:
        damping = sp.csr_array(projected(model.damping))
    if model.modal is not None:
        modal = sp.csr_array(_modal_damping(model, reduction.eigenvalues, stiffness))
        if damping is None:
            damping = modal
        else:
            damping = sp.csr_array(damping + modal)
    common = replace(
        model,
        mass=sp.csr_array(mass),
        damping=damping,
        stiffness=sp.csr_array(stiffness),
        unrelaxed=None if model.unrelaxed is None else sp.csr_array(projected(model.unrelaxed)),
        geometric=None if model.geometric is None else sp.csr_array(projected(model.geometric)),
        expansion=sp.csr_array(np.eye(m + n_motion)[:, :m]),
        trace=sp.csr_array(model.trace @ shapes),
        imposed_pattern=np.eye(m + n_motion)[:, m:],
        ordering=None,
        positions=None,
        nodal=shapes,
        modal=None,
    )
    weighted = model.inertia @ basis

    def projection(member: SubstructureModel) -> SubstructureModel:
        # q = R^T M u of what the conditions leave of u, as R is orthonormal in the mass
        p = model.expansion
        fields = member.displacement, member.velocity
        start = [weighted.T @ np.asarray(p @ closest_reduced(p, field[:, None]))[:, 0] for field in fields]
        # prescribed motions enter by ``imposed_start``
        rest = np.zeros(n_motion)
        return replace(
            common,
            name=member.name,
            loads=[LoadTerm(t.name, shapes.T @ t.pattern) for t in member.loads],
            displacement=np.concatenate([start[0], rest]),
            velocity=np.concatenate([start[1], rest]),
            imposed_start=member.imposed_start,
            imposed_speed=member.imposed_speed,
        )

    return [projection(member) for member in members], reduction.n_mode


def _modal_damping(model: SubstructureModel, eigenvalues: Array, stiffness: Array) -> Array:
    """Modal damping on Ritz coordinates and prescribed motions (n, n), from their stiffness (n, n): the rate of a mode
    counts from its static response to the prescribed motions, -lambda^-1 phi^T K D."""
    factors = modal_damping(model, eigenvalues)
    rows = np.flatnonzero(factors)
    # 1 at the mode itself, its static response to each prescribed motion beside it
    relative = stiffness[rows] / eigenvalues[rows, None]
    damping: Array = relative.T @ (factors[rows, None] * relative)
    return damping


def _together(members: Sequence[SubstructureModel]) -> SubstructureModel:
    """One model with the loads of all members, and initial values that excite whatever one of theirs does."""
    weights = 1.0 + np.arange(len(members)) / np.pi  # such that they do not cancel
    return replace(
        members[0],
        loads=[load for member in members for load in member.loads],
        displacement=sum((w * m.displacement for w, m in zip(weights, members, strict=True)), np.zeros(1)),
        velocity=sum((w * m.velocity for w, m in zip(weights, members, strict=True)), np.zeros(1)),
    )
