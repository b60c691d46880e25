"""What a propagator is built from: the constant matrices and the histories of one substructure.

The places of the entries of M, C and K in the operator of a march, c_M M + c_C C + c_K K, are determined once per
pattern; the operator of a time step is then a sum of numbers, without sparse arithmetic. Lumping takes row sums, so
that rigid translations give the same forces before and after.
"""

from __future__ import annotations

import copy
from collections.abc import Sequence
from dataclasses import dataclass, field, replace
from functools import cached_property
from typing import Any, Literal

import numpy as np
import scipy.sparse as sp
import scipy.sparse.linalg as spla
from numpy.typing import NDArray

from ..cholesky.factor import InterfaceFactor
from ..errors import Problem, SceneError
from ..operator_store import NO_STORE, OperatorStore
from ..time_scheme import NO_BRANCHES, MaxwellBranches, TimeScheme
from .vibration import Vibration

Array = NDArray[np.float64]
Index = NDArray[np.int64]
# what depends neither on the way a model is factorised nor on its initial values
_KEPT = frozenset(
    (
        "reduced",
        "reduced_stiffness",
        "_unrelaxed",
        "modal_rows",
        "reduced_landing",
        "stiffness_by_nodes",
        "_alike",
        "reduced_loads",
        "reduced_trace",
        "reduced_spread",
        "at_interface",
        "spread",
        "operator_pattern",
        "reduced_parts",
        "massless",
        "with_lumped_mass",
    )
)
_OF_MASS = frozenset(("reduced", "modal_rows", "operator_pattern", "massless", "with_lumped_mass"))

MOST_MODES = 300
"""Modes of a substructure in modal damping: each is a vector of its dofs, that the march reads three times."""
_ROUND_OFF = 1e-14  # of a trace: share of a unit direction
_BY_NODES = 500_000  # entries up to which zeros are added: larger matrices are read from memory, zeros too
_MOST_ADDED = 1.5  # entries with zeros over those without, at most

FactorKind = Literal["float64", "float32", "cg"]


def lumped(matrix: sp.csr_array, nodal: bool) -> sp.csr_array:
    """Row sums over the nodes: (3 n_node, 3 n_node) -> the same shape, diagonal, or ``nodal`` 3 x 3 blocks.

    Blocks keep what couples the components of one node (oblique dashpots). Rigid translations give the same forces
    before and after; a stiffness-proportional damping gives none.
    """
    rows = np.repeat(np.arange(matrix.shape[0]), np.diff(matrix.indptr))
    columns, data = matrix.indices, matrix.data
    if not nodal:
        same = rows % 3 == columns % 3  # mass and stiffness of one component; consistent masses have no other
        sums: Array = np.bincount(rows[same], data[same], minlength=matrix.shape[0]).astype(np.float64)
        return diagonal_matrix(_cleared(sums))
    # onto the column of the same component in the row's own node
    onto = 3 * (rows // 3) + columns % 3
    summed = sp.csr_array(sp.coo_array((data, (rows, onto)), shape=matrix.shape))
    summed.data = _cleared(summed.data)
    summed.eliminate_zeros()
    return summed


def diagonal_matrix(values: Array) -> sp.csr_array:
    """Diagonal matrix (n, n) of values (n,), zeros left out."""
    n, places = len(values), np.flatnonzero(values)
    starts = np.searchsorted(places, np.arange(n + 1))
    return sp.csr_array((values[places], places, starts), shape=(n, n))


def reduced_diagonal(expansion: sp.csr_array, values: Array) -> Array:
    """Diagonal (n,) of P^T diag(values) P for a selection P (n_full, n), at most one entry per row."""
    rows = np.repeat(np.arange(expansion.shape[0]), np.diff(expansion.indptr))
    weights = expansion.data**2 * values[rows]
    sums: Array = np.bincount(expansion.indices, weights, expansion.shape[1]).astype(np.float64)
    return sums


def _cleared(values: Array) -> Array:
    """Round-off of the largest becomes zero."""
    return np.where(np.abs(values) <= 1e-12 * np.abs(values).max(initial=0.0), 0.0, values)


class OperatorPattern:
    """Common pattern of square matrices of one size.

    Parameters
    ----------
    matrices : (n, n) each, rows sorted, no entry twice.
    """

    def __init__(self, matrices: Sequence[sp.csr_array]) -> None:
        self._matrices = list(matrices)

    @cached_property
    def _found(self) -> tuple[sp.csr_array, list[Index | None]]:
        """Matrix of zeros with the common pattern; where the entries of each matrix are, None where they are all."""
        filled = [with_data(m, np.ones(m.nnz)) for m in self._matrices]
        # often the stiffness has all entries, and no union is made
        largest = max(filled, key=lambda m: m.nnz)
        found = self._within(largest, filled)
        if any(at is not None and len(at) < m.nnz for at, m in zip(found[1], filled, strict=True)):
            numbers: sp.csr_array = sum(filled[1:], filled[0])
            numbers.sort_indices()
            found = self._within(numbers, filled)
        return found

    @staticmethod
    def _within(pattern: sp.csr_array, matrices: Sequence[sp.csr_array]) -> tuple[sp.csr_array, list[Index | None]]:
        """Zeros with a pattern, and the places of the entries of each matrix in it, None where they are all of it."""
        numbers = with_data(pattern, np.arange(1.0, pattern.nnz + 1))
        places = [None if _equal_patterns(m, numbers) else _picked(numbers, m) for m in matrices]
        return with_data(pattern, np.zeros(pattern.nnz)), places

    def sum(self, factors: Sequence[float], matrices: Sequence[sp.csr_array]) -> sp.csr_array:
        """Sum of factors times matrices, which have the patterns of those given at first, in their order."""
        empty, where = self._found
        data = np.zeros(empty.nnz)
        for factor, matrix, places in zip(factors, matrices, where, strict=True):
            if places is None:
                data += factor * matrix.data
            else:
                data[places] += factor * matrix.data
        return with_data(empty, data)


def _equal_patterns(first: sp.csr_array, second: sp.csr_array) -> bool:
    """Whether two matrices have their entries at the same places."""
    if first.nnz != second.nnz or first.indices is second.indices:
        return first.nnz == second.nnz
    return np.array_equal(first.indices, second.indices) and np.array_equal(first.indptr, second.indptr)


def _picked(numbers: sp.csr_array, pattern: sp.csr_array) -> Index:
    """Where the entries of a pattern are among those of a larger one, which holds 1, 2, 3, ..."""
    # counted from 1: an entry 0 would not be in the product
    places: Index = numbers.multiply(pattern).tocsr().data.astype(np.int64) - 1
    return places


def with_data(matrix: sp.csr_array, data: Array) -> sp.csr_array:
    """A matrix of the same pattern, which it shares: nothing is checked or sorted again."""
    other = copy.copy(matrix)
    other.data = data
    return other


@dataclass(frozen=True)
class LoadTerm:
    """One load: a nodal force pattern times a scalar history (``Histories``).

    Attributes
    ----------
    name : of its law in the scene ("" for what has none: the balance of a preload).
    pattern : (n_full,) nodal forces for amplitude 1, N.
    """

    name: str
    pattern: Array


@dataclass(frozen=True)
class Histories:
    """What drives one substructure at the instants of a run or segment.

    Attributes
    ----------
    time : (n_time,), s. amplitudes : per load term of the model, (n_time,).
    imposed : (n_time, n_motion) what drives the prescribed motions, for each as ``motion_kinds`` says: "velocity" at
        the instants, m s-1; "displacement" the rate of the displacement over the step that begins at an instant,
        m s-1; "acceleration" at the instants, m s-2.
    """

    time: Array
    amplitudes: list[Array]
    imposed: Array
    motion_kinds: tuple[str, ...] = ()


@dataclass(frozen=True)
class FaceStiffness:
    """Stiffness of a model beside its sparse matrix: dense among interface dofs, and of squares of modes.

    K has S on the interface dofs and E^T E more, C has b S more. Maxwell branches act on both, each row and S with a
    share of their strength. The last rows are inertia in steps dt, N / dt for a mass N^T N of interface dofs, in kg0.5
    s-1. Each of these dofs is a channel of its own, and there is one substructure like it.

    Attributes
    ----------
    matrix : S (g, g), N m-1, in the order of the interface dofs. viscosity : b, s. rows : E (k, n), N0.5 m-0.5.
    patches : rows of S, patch by patch (``patches``). branches : with row_shares (k,) for the rows, share for S.
    n_inertial : how many of the rows are inertia.
    """

    matrix: Array
    viscosity: float
    rows: Array
    patches: list[Index]
    row_shares: Array
    branches: MaxwellBranches = NO_BRANCHES
    share: float = 1.0
    n_inertial: int = 0

    def stiffening(self, scheme: TimeScheme, dt: float) -> tuple[Array, float]:
        """Factors of the squares of the rows (k,), and of S, in the operator of the march."""
        rise = self.branches.stiffening(scheme, dt) - 1.0
        return 1.0 + rise * self.row_shares, 1.0 + rise * self.share

    def stiffness(self, u: Array, dofs: Index) -> Array:
        """S u and E^T E u for u (n, m), N."""
        elastic = self.rows[: len(self.rows) - self.n_inertial]
        force: Array = elastic.T @ (elastic @ u)
        force[dofs] += self.matrix @ u[dofs]
        return force

    def damping(self, v: Array, dofs: Index) -> Array:
        """b S v for v (n, m), N."""
        force = np.zeros_like(v)
        force[dofs] = self.viscosity * (self.matrix @ v[dofs])
        return force


@dataclass(frozen=True)
class SubstructureModel:
    """Matrices and histories of one substructure.

    Full dofs are 3 * node + component. Reduced dofs are what is left after fixed directions are removed and
    tied ones merged: ``u_full = expansion @ u + imposed``. A rigid body has its free and its prescribed motions for
    full dofs (``nodal``).

    Attributes
    ----------
    name : name in the scene.
    mass, damping, stiffness : (n_full, n_full), kg, N s m-1, N m-1; mass None without inertia, damping None where
        there is none.
    expansion : (n_full, n) selection matrix.
    trace : (n_channel, n_full) from full velocities to interface channels (local frames, all interfaces).
    channel_area : (n_channel,) area carried by each channel, m2.
    loads : load terms. displacement, velocity : (n_full,) initial values.
    imposed_pattern : (n_full, n_motion) shapes of prescribed motions.
    imposed_start : (n_motion,) displacement amplitudes at the start, m.
    imposed_speed : (n_motion,) velocities at the start of the motions given by accelerations, m s-1; None: from rest.
    """

    name: str
    mass: sp.csr_array | None
    damping: sp.csr_array | None
    stiffness: sp.csr_array
    expansion: sp.csr_array
    trace: sp.csr_array
    channel_area: Array
    loads: list[LoadTerm]
    displacement: Array
    velocity: Array
    imposed_pattern: Array
    imposed_start: Array
    imposed_speed: Array | None = field(default=None)
    ordering: Array | None = field(default=None)
    """(n_full,) elimination rank of each full dof (nested dissection of the mesh), or None."""
    parts: Array | None = field(default=None)
    """(n_full,) rank behind the leaf or separator that each full dof belongs to, given with ``ordering``, or None."""
    positions: Array | None = field(default=None)
    """(n_full / 3, 3) positions of the nodes, m, given with ``ordering``, or None."""
    factor: FactorKind = "float64"
    """How the operator of the march is factorised: Cholesky stored in that precision, or not ("cg")."""
    swept: bool = field(default=False)
    """Whether interfaces are solved with by substitution (``interface_sweeps``), not by dense matrices."""
    lumped_mass: Array | None = field(default=None)
    """(n_full,) masses > 0, kg, of explicit schemes where the row sums of ``mass`` are not positive, else None."""
    lumped_damping: sp.csr_array | None = field(default=None)
    """(n_full, n_full) what explicit schemes take of the damping at the new instant, given with ``lumped_mass``."""
    landing: sp.csr_array | None = field(default=None)
    """(n_full, n_full) part of ``damping`` that is the viscosity of the contact layer, or None."""
    nodal: Array | None = field(default=None)
    """(3 n_node, n_full) displacements of the nodes per full dof, None where the full dofs are those of the nodes."""

    branches: MaxwellBranches = field(default=NO_BRANCHES)
    """Maxwell branches of the damping by strain, springs of the stiffness K times their strengths."""

    unrelaxed: sp.csr_array | None = field(default=None)
    """(n_full, n_full) part of the stiffness whose springs have no branches: the geometric one, and in groups that of
    bodies that do not relax; None where all have."""

    geometric: sp.csr_array | None = field(default=None)
    """(n_full, n_full) part of the stiffness that is geometric, with a term of its own among the energies; None where
    there is none."""

    modal: tuple[float, float] | None = field(default=None)
    """Damping ratio of the elastic modes of a reduced basis, and the frequency up to which they have it, Hz."""

    viscous_rows: Array | None = field(default=None)
    """Rows A (k, n_full) of a damping A^T A beside ``damping``, N0.5 s0.5 m-0.5; with these there is no ``modal``."""

    face: FaceStiffness | None = field(default=None)
    """Stiffness and damping beside the matrices, with reduced dofs as full ones; None where there are none."""

    store: OperatorStore = NO_STORE
    """Where operators are looked for, and kept."""

    @cached_property
    def modal_rows(self) -> Array | None:
        """R (k, n_full) of modal damping R^T R up to a frequency, beside ``damping``; None where there is none, or no
        such limit.

        The rows are sqrt(2 zeta omega) lambda^-1 phi^T K of the elastic modes, K phi = lambda M phi on the free dofs:
        sqrt(2 zeta omega) phi^T M on these, and on prescribed motions less the static response to them.

        Raises
        ------
        SceneError : more modes than ``MOST_MODES``.
        """
        return _modal_rows(self)

    @property
    def n_full(self) -> int:
        """Number of full dofs."""
        return int(self.expansion.shape[0])

    @cached_property
    def reduced(self) -> tuple[sp.csr_array, sp.csr_array | None, sp.csr_array]:
        """Mass, damping and stiffness of the reduced dofs (n, n): P^T A P, P the expansion."""
        damping = None
        if self.damping is not None:
            damping = _reduced(self.expansion, self.damping)
        return _reduced(self.expansion, self.inertia), damping, self.reduced_stiffness

    @cached_property
    def reduced_stiffness(self) -> sp.csr_array:
        """P^T K P alone, (n, n)."""
        return _reduced(self.expansion, self.stiffness)

    @cached_property
    def reduced_landing(self) -> tuple[sp.csr_array, bool]:
        """P^T A P (n, n) of the viscosity of the contact layer, and whether it is not all of the damping."""
        assert self.landing is not None
        assert self.damping is not None
        return _reduced(self.expansion, self.landing), bool(abs(self.damping - self.landing).max() > 0)

    @cached_property
    def stiffness_by_nodes(self) -> sp.csr_array:
        """``reduced_stiffness`` with zeros where two nodes are coupled in some directions only. The rows of a node have
        the same columns then, and are taken together (``kernels.products.half_product``)."""
        matrix, alike = self.reduced_stiffness, self.__dict__.get("_alike")
        if matrix.nnz > _BY_NODES:
            return matrix
        by_nodes = _reduced(self.expansion, self.stiffness, zeros=True)
        if not matrix.nnz < by_nodes.nnz <= _MOST_ADDED * matrix.nnz:
            return matrix
        if alike is None:
            first = by_nodes
        else:
            first = alike.stiffness_by_nodes
        if first is not by_nodes and _same_patterns([first], [by_nodes]):
            # the same arrays, not equal ones: ``class_record`` finds patterns that it has by identity
            by_nodes.indices, by_nodes.indptr = first.indices, first.indptr
        return by_nodes

    @cached_property
    def operator_pattern(self) -> OperatorPattern:
        """Pattern of ``operator_matrices``."""
        return OperatorPattern(operator_matrices(self))

    @cached_property
    def massless(self) -> NDArray[np.int64]:
        """Reduced dofs without mass."""
        return np.flatnonzero(self.reduced[0].diagonal() <= 0.0).astype(np.int64)

    @cached_property
    def reduced_loads(self) -> list[Array]:
        """Load patterns on the reduced dofs, (n,) each, N."""
        return [np.asarray(self.expansion.T @ load.pattern) for load in self.loads]

    @property
    def inertia(self) -> sp.csr_array:
        """The mass matrix, of a model that has one."""
        assert self.mass is not None, "a model without inertia has no mass"
        return self.mass

    @cached_property
    def reduced_trace(self) -> sp.csr_array:
        """Trace from all reduced dofs to the channels, (n_channel, n)."""
        trace = sp.csr_array(self.trace @ self.expansion)
        if not is_selection(self.expansion):  # what a channel cannot move along is round-off
            trace.data[np.abs(trace.data) < _ROUND_OFF] = 0.0
            trace.eliminate_zeros()
        return trace

    @cached_property
    def reduced_spread(self) -> sp.csr_array:
        """Transpose of ``reduced_trace``, (n, n_channel)."""
        return sp.csr_array(self.reduced_trace.T)

    @cached_property
    def at_interface(self) -> tuple[NDArray[np.int64], sp.csr_array, Array | None]:
        """Reduced dofs on the interfaces (n_gamma,), the trace from them (n_channel, n_gamma), and the elimination
        rank of the reduced dofs (n,) where the ordering is known."""
        trace = sp.csc_array(self.reduced_trace)
        dofs = np.flatnonzero(np.diff(trace.indptr)).astype(np.int64)
        return dofs, sp.csr_array(trace[:, dofs]), reduced_ordering(self)

    @cached_property
    def spread(self) -> sp.csr_array:
        """Transpose of the trace: forces on the interface dofs (n_gamma, n_channel) from forces on the channels."""
        return sp.csr_array(self.at_interface[1].T)

    @cached_property
    def reduced_parts(self) -> Array | None:
        """``parts`` of the reduced dofs, (n,)."""
        if self.parts is None:
            return None
        return reduced_rank(self.expansion, self.parts)

    def with_sweeps(self) -> SubstructureModel:
        """The same model without dense matrices of its interfaces; what was reduced already is kept."""
        return _sharing(self, replace(self, swept=True))

    def with_factor(self, kind: FactorKind) -> SubstructureModel:
        """The same model, factorised in another way; what was reduced already is kept."""
        return _sharing(self, replace(self, factor=kind))

    def displaced(self, displacement: Array) -> SubstructureModel:
        """The same model with other initial displacements (n_full,), m; what was reduced already is kept."""
        return _sharing(self, replace(self, displacement=displacement))

    def with_mass(self, mass: sp.csr_array) -> SubstructureModel:
        """The same model with another mass (n_full, n_full), kg; what was reduced already is kept but for the mass."""
        return _sharing(self, replace(self, mass=mass), _KEPT - _OF_MASS)

    @cached_property
    def with_lumped_mass(self) -> SubstructureModel:
        """The same model with a lumped mass, made once; its matrices need not be reduced again."""
        if self.lumped_mass is None:
            other = self.with_mass(lumped(self.inertia, nodal=False))
        else:
            other = self.with_mass(diagonal_matrix(self.lumped_mass))
        mass = reduced_diagonal(self.expansion, other.inertia.diagonal())
        # what the cached property would compute, from the lumped diagonal
        other.__dict__["reduced"] = (diagonal_matrix(mass), *self.reduced[1:])
        return other


def _modal_rows(model: SubstructureModel) -> Array | None:
    """``SubstructureModel.modal_rows``, determined."""
    if model.viscous_rows is not None:
        return model.viscous_rows
    if model.modal is None or model.mass is None or not np.isfinite(model.modal[1]):
        return None
    (ratio, below), e = model.modal, model.expansion
    mass, _, stiffness = model.reduced
    found = Vibration(stiffness, mass, reduced_ordering(model)).below((2 * np.pi * below) ** 2, MOST_MODES)
    if found is None:
        where, what = f"substructure.{model.name}.modal_damping.below", f"more than {MOST_MODES} modes are below"
        remedy = 'lower it, or take solver.propagator = "reduced", or damp the material'
        raise SceneError([Problem(where, what, f"{below:g} Hz", remedy=remedy)], "the scene cannot be built")
    values, modes = found
    rows: Array = np.sqrt(2 * ratio * values**-1.5)[:, None] * (model.stiffness @ (e @ modes)).T
    return rows


def operator_weights(model: SubstructureModel, scheme: TimeScheme, dt: float) -> tuple[float, float, float]:
    """Factors of M, C and K in the operator of the march of a scheme; that of K with its Maxwell branches."""
    mass, damping, stiffness = scheme.operator(dt)
    return mass, damping, stiffness * model.branches.marched(scheme).stiffening(scheme, dt)


def unrelaxed_part(model: SubstructureModel) -> sp.csr_array | None:
    """The part of the stiffness of the reduced dofs that has no branches, (n, n); None where all has, and where there
    are no branches."""
    if not len(model.branches):
        return None
    if model.unrelaxed is not None and "_unrelaxed" not in model.__dict__:
        model.__dict__["_unrelaxed"] = _reduced(model.expansion, model.unrelaxed)
    matrix: sp.csr_array | None = model.__dict__.get("_unrelaxed")
    return matrix


def geometric_part(model: SubstructureModel) -> sp.csr_array | None:
    """The geometric stiffness of the reduced dofs, (n, n); None where there is none."""
    return None if model.geometric is None else _reduced(model.expansion, model.geometric)


def relaxing_part(model: SubstructureModel) -> sp.csr_array:
    """The part (n_full, n_full) of the stiffness that strains have, and on whose springs branches act."""
    if model.unrelaxed is None:
        return model.stiffness
    return sp.csr_array(model.stiffness - model.unrelaxed)


def operator_factors(model: SubstructureModel, scheme: TimeScheme, dt: float) -> list[float]:
    """Factors of ``operator_matrices`` in the operator of the march of a scheme."""
    mass, damping, stiffness = operator_weights(model, scheme, dt)
    if model.reduced[1] is None:
        factors = [mass, stiffness]
    else:
        factors = [mass, stiffness, damping]
    if unrelaxed_part(model) is not None:
        factors.append(scheme.operator(dt)[2] - stiffness)  # it has no branches
    return factors


def operator_matrices(model: SubstructureModel) -> list[sp.csr_array]:
    """Matrices (n, n) of the operator of a march: M, K, and where there are, C and the part of K
    without branches."""
    mass, damping, stiffness = model.reduced
    if damping is None:
        matrices = [mass, stiffness]
    else:
        matrices = [mass, stiffness, damping]
    unrelaxed = unrelaxed_part(model)
    if unrelaxed is None:
        return matrices
    return [*matrices, unrelaxed]


def _reduced(p: sp.csr_array, matrix: sp.csr_array, zeros: bool = False) -> sp.csr_array:
    """P^T A P for an expansion P, with the ``zeros`` of A where they are wanted and P is a selection."""
    if not _selects(p) or not matrix.has_sorted_indices:
        return sp.csr_array(p.T @ matrix @ p)
    free = np.diff(p.indptr) > 0
    entries = free[matrix.indices] & np.repeat(free, np.diff(matrix.indptr))
    if not zeros:
        entries &= matrix.data != 0.0
    counts, rows = np.zeros(len(free), dtype=np.int64), np.flatnonzero(np.diff(matrix.indptr))
    # rows without entries left out: reduceat would give them one of the next
    counts[rows] = np.add.reduceat(entries, matrix.indptr[rows], dtype=np.int64)
    indptr = np.concatenate([np.zeros(1, dtype=np.int64), np.cumsum(counts[free])])
    indices = (np.cumsum(free) - 1)[matrix.indices[entries]]
    return sp.csr_array((matrix.data[entries], indices, indptr), shape=(p.shape[1], p.shape[1]))


def _sharing(model: SubstructureModel, other: SubstructureModel, names: frozenset[str] = _KEPT) -> SubstructureModel:
    """``other`` with what was reduced so far of ``model`` under these names, which is its own too."""
    for key in names:
        if key in model.__dict__:
            other.__dict__[key] = model.__dict__[key]
    return other


def node_values(model: SubstructureModel, full: Array) -> Array:
    """Vectors at the nodes (n_node, 3) of full dofs (n_full,)."""
    if model.nodal is None:
        values = full
    else:
        values = model.nodal @ full
    return values.reshape(-1, 3)


def damping_forces(model: SubstructureModel, velocities: Array) -> Array | None:
    """C v (n_full, k), N, modal damping included; None where there is no damping."""
    forces = None
    if model.damping is not None:
        forces = model.damping @ velocities
    if model.modal_rows is None:
        return forces
    modal = model.modal_rows.T @ (model.modal_rows @ velocities)
    if forces is None:
        return modal
    return forces + modal


def resting(model: SubstructureModel) -> SubstructureModel:
    """The same model, undisplaced and at rest at t = 0; what was reduced already is kept."""
    zero = np.zeros_like(model.displacement)
    return _sharing(model, replace(model, displacement=zero, velocity=zero))


def with_load(model: SubstructureModel, load: LoadTerm) -> SubstructureModel:
    """The same model with one load more; what was reduced already is kept but for the loads."""
    other = replace(model, loads=[*model.loads, load])
    return _sharing(model, other, _KEPT - {"reduced_loads", "with_lumped_mass"})


def share_operators(model: SubstructureModel, other: SubstructureModel) -> None:
    """Give ``other``, with equal matrices, what of ``model`` was reduced already (loads may differ)."""
    _sharing(model, other, _KEPT - {"reduced_loads", "with_lumped_mass"})


def is_selection(expansion: sp.csr_array) -> bool:
    """Whether every full dof is a copy of one reduced dof at most."""
    return bool(np.diff(expansion.indptr).max(initial=0) <= 1 and (expansion.data == 1.0).all())


def closest_reduced(expansion: sp.csr_array, full: Array) -> Array:
    """Reduced dofs (n, k) closest to full ones (n_full, k): means over the copies of each, where they are copies; least
    squares where full dofs are sums of several (rigid faces)."""
    if is_selection(expansion):
        means: Array = (expansion.T @ full) / np.maximum(expansion.sum(axis=0), 1)[:, None]  # a dof without copies: 0
        return means
    if not full.any():
        # most bodies start undisplaced, and the factors below fill up where faces are bonded
        return np.zeros((expansion.shape[1], *full.shape[1:]))
    gram = sp.csc_array(expansion.T @ expansion)
    solved: Array = spla.splu(gram).solve(np.asarray(expansion.T @ full))
    return solved


def reduced_ordering(model: SubstructureModel) -> Array | None:
    """Elimination rank of the reduced dofs (n,) of a model; None where its ordering is not known."""
    if model.ordering is None:
        return None
    return reduced_rank(model.expansion, model.ordering)


def reduced_rank(expansion: sp.csr_array, rank: Array) -> Array:
    """Elimination rank of the reduced dofs: the last of the full dofs that they stand for."""
    coo = expansion.tocoo()
    reduced = np.zeros(expansion.shape[1])
    # a dof whose copies are in two parts is eliminated behind both
    np.maximum.at(reduced, coo.coords[1], rank[coo.coords[0]])
    return reduced


def _selects(expansion: sp.csr_array) -> bool:
    """Whether reduced dofs are some of the full dofs, in their order: P^T A P takes rows and columns of A then."""
    one_each = np.array_equal(expansion.indices, np.arange(expansion.shape[1]))
    return bool(one_each and np.diff(expansion.indptr).max(initial=0) <= 1 and (expansion.data == 1.0).all())


def share_patterns(models: Sequence[SubstructureModel]) -> None:
    """Make models whose reduced matrices have equal patterns share these (values stay their own)."""
    groups: dict[tuple[int, ...], list[SubstructureModel]] = {}
    for model in models:
        matrices = operator_matrices(model)
        like = groups.setdefault(tuple(m.nnz for m in matrices), [])
        same = next((k for k in like if _same_patterns(operator_matrices(k), matrices)), None)
        if same is None:
            like.append(model)
            continue
        for matrix, first in zip(matrices, operator_matrices(same), strict=True):
            matrix.indptr, matrix.indices = first.indptr, first.indices
        model.__dict__["operator_pattern"], model.__dict__["_alike"] = same.operator_pattern, same


def _same_patterns(first: Sequence[sp.csr_array], second: Sequence[sp.csr_array]) -> bool:
    return all(
        np.array_equal(a.indptr, b.indptr) and np.array_equal(a.indices, b.indices)
        for a, b in zip(first, second, strict=True)
    )


@dataclass(frozen=True)
class Operators:
    """Reduced matrices, factor and interface admittance of one class at one time step.

    Attributes
    ----------
    mass, damping, stiffness : reduced matrices (n, n).
    factor : of the operator of the march, interface dofs last. dofs : (n_gamma,) interface dofs.
    trace : (n_channel, n_gamma) from interface dofs to channels. spread : its transpose. area : (n_channel,).
    compliance : (n_channel, n_channel) velocities of the channels at the new instant per unit of nodal force
        on the channels, m s-1 N-1, symmetric: T D T^T; of a swept class an ``InterfaceCompliance``.
    massless : dofs without mass.
    """

    mass: sp.csr_array
    damping: sp.csr_array | None
    stiffness: sp.csr_array
    factor: InterfaceFactor
    dofs: Index
    trace: sp.csr_array
    spread: sp.csr_array
    area: Array
    compliance: Any
    massless: Index

    @property
    def admittance(self) -> Array:
        """Velocities of the channels per unit of traction, m3 N-1 s-1: T D T^T diag(area)."""
        admittance: Array = self.compliance * self.area
        return admittance
