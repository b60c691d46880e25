"""Component mode synthesis of one substructure: a few vibration modes, and exact static responses at the interfaces.

The basis holds (Rubin 1975, Craig and Bampton 1968 in the free-interface form)

    R      the rigid motions the conditions leave, K R = 0
    Phi    the lowest elastic modes of the substructure with free interfaces, K phi = lambda M phi
    X      the static response to every traction shape and every load, K x = b - M R R^T b (inertia relief), and to
           the forces by which dashpots couple the modes, b = C phi - M (all phi, R)(all phi, R)^T C phi

and is turned into Ritz vectors: mass-orthonormal, stiffness diagonal. Modes that no shape, no load, no initial value
and no dashpot can excite are left out: they stay at rest. Damping in proportion to M and K couples no modes. Groups of
equal eigenvalues are kept whole. A constraint mode of an interface dof is a sum of static responses and rigid motions,
so that with one shape per channel the span holds that of Craig and Bampton's constraint modes.

With a geometric stiffness K_sigma the motions R, Phi and X are those of K alone, as a body that others hold may be
unstable by itself, X has the responses to K_sigma R and K_sigma Phi as well, and the stiffness in their span is that of
K + K_sigma.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass

import numpy as np
import scipy.linalg as la
import scipy.sparse as sp

from .model import Array, SubstructureModel, closest_reduced, geometric_part, reduced_ordering
from .vibration import Vibration

_EXCITED = 1e-9  # cosine between a mode and a force, below which the mode stays at rest
_EQUAL = 1e-6  # relative difference of eigenvalues of one group
_CHOICE = 4  # low modes among which the strongest are chosen, times their number
_COUPLES = 1e-6  # force of a dashpot beyond the modes, over all of it, below which it is round-off
_ROUNDS = 3  # of modes that excite others by dashpots: all dofs of a face are reached in the second
_DEPENDENT = 1e-9  # squared norm of what a static response adds to the basis, against its own


def lowest_modes(body: Vibration, n_mode: int, excited: Array) -> tuple[Array, Array]:
    """Rigid motions and the lowest elastic modes that can be excited, mass-orthonormal.

    A group of equal eigenvalues is taken whole, because its eigenvectors are an arbitrary basis of one subspace: a cut
    through it would make the result depend on the axes, the units and the rounding. The modes may be a few more than
    ``n_mode``.

    excited : (n, n_force) columns of length 1.
    """
    requested = n_mode + 6  # the rigid motions, six at most
    while True:
        rigid, values, elastic = body.modes(requested)
        complete = rigid.shape[1] + len(values) == body.n
        columns, count = [elastic[:, :0]], 0
        for group in _equal_values(values, complete):
            if count >= n_mode:
                break
            columns.append(_excitable(elastic[:, group], excited))
            count += columns[-1].shape[1]
        if count >= n_mode or complete:
            return rigid, np.column_stack(columns)
        requested *= 2


def strongest_modes(body: Vibration, n_mode: int, forces: Array) -> tuple[Array, Array]:
    """Rigid motions and the low elastic modes with the largest share in the static response to any of the forces.

    forces : (n, n_force). The share of a group of equal eigenvalues lambda is the sum of (phi . b)^2 / lambda over its
    modes phi, against that over all low modes; groups are taken whole (``lowest_modes``).
    """
    rigid, values, elastic = body.modes(_CHOICE * (n_mode + 6))
    shares = (elastic.T @ forces) ** 2 / values[:, None]
    total = shares.sum(axis=0)
    shares = shares[:, total > 0.0] / total[total > 0.0]
    groups = list(_equal_values(values, rigid.shape[1] + len(values) == body.n))
    strength = np.array([shares[group].sum(axis=0).max(initial=0.0) for group in groups])
    chosen, count = list[int](), 0
    for i in np.argsort(-strength, kind="stable").tolist():
        if count >= n_mode or strength[i] <= _EXCITED**2:  # shares are squares of cosines
            break
        chosen.append(i)
        count += _excitable(elastic[:, groups[i]], forces).shape[1]
    return rigid, np.column_stack(
        [elastic[:, :0], *(_excitable(elastic[:, groups[i]], forces) for i in sorted(chosen))]  # ascending again
    )


def _equal_values(values: Array, complete: bool) -> Iterator[slice]:
    """Groups of equal values among ascending ones; the last group may be cut where they are not ``complete``."""
    ends = np.append(np.flatnonzero(np.diff(values) > _EQUAL * values[1:]) + 1, len(values))
    first = 0
    for end in ends if complete else ends[:-1]:
        yield slice(first, int(end))
        first = int(end)


@dataclass(frozen=True)
class ReducedModel:
    """A substructure in m Ritz coordinates q: ``u_full = basis @ q`` (+ prescribed motions, if there are any).

        q'' + damping q' + eigenvalues * q = trace^T (area * tractions) + loads @ amplitudes

    Attributes
    ----------
    basis : (n_full, m), mass-orthonormal: the reduced mass is the unit matrix. kg-1/2.
    eigenvalues : (m,) diagonal of the reduced stiffness, ascending, exactly 0 for rigid motions that no geometric
        stiffness acts on, s-2.
    damping : (m, m) s-1, None where the model has none.
    trace : (n_channel, m) from q' to the velocities of the interface channels.
    area : (n_channel,) of the channels, m2.
    loads : (m, n_load) nodal forces of the load terms for amplitude 1.
    n_mode : elastic modes; the Ritz vectors after the rigid motions and these are static responses.
    displacement, velocity : (m,) initial values; the nearest ones, in the norm of the mass, where modes are missing.
    """

    basis: Array
    eigenvalues: Array
    damping: Array | None
    trace: Array
    area: Array
    loads: Array
    n_mode: int
    displacement: Array
    velocity: Array

    @property
    def n_rigid(self) -> int:
        """Number of rigid motions."""
        return int((self.eigenvalues == 0.0).sum())


def reduce_model(
    model: SubstructureModel, n_mode: int, shapes: Array | None = None, exciting: Array | None = None
) -> ReducedModel:
    """Reduced model of a substructure.

    Parameters
    ----------
    model : every free direction must carry mass.
    n_mode : number of elastic modes, >= 0; fewer where the mesh has fewer, a few more where the last of them has the
        eigenvalue of further ones.
    shapes : (n_channel, n_shape) tractions on the channels, Pa, whose static responses are exact; None: one shape per
        channel, all of them.
    exciting : (n_channel, n_shape) tractions, Pa; given, the modes are those of the low ones that these and the loads
        excite most, None: the lowest that can be excited at all. A slender bar hit at its end has many bending modes
        below the axial ones that matter.

    Raises
    ------
    ValueError : a negative number of modes, shapes of another size, a direction without mass, nothing free to move.
    """
    if n_mode < 0:
        raise ValueError(f"the number of modes must be >= 0, not {n_mode}")
    for tractions in (shapes, exciting):
        if tractions is not None and (tractions.ndim != 2 or tractions.shape[0] != model.channel_area.size):
            raise ValueError(f"shapes must be ({model.channel_area.size}, n_shape), not {tractions.shape}")
    e = model.expansion
    mass, stiffness = (sp.csr_array(e.T @ m @ e) for m in (model.inertia, model.stiffness))
    if (mass.diagonal() <= 0.0).any():
        raise ValueError("some free directions carry no mass")
    if not mass.shape[0]:
        raise ValueError("nothing is free to move")
    geometric = geometric_part(model)
    # with its geometric stiffness a body that others hold may be unstable, and turns of it have a stiffness
    elastic_part = stiffness if geometric is None else sp.csr_array(stiffness - geometric)
    body = Vibration(elastic_part, mass, reduced_ordering(model))
    # the closest start that the conditions allow
    start = closest_reduced(e, np.column_stack([model.displacement, model.velocity]))
    forces = _forces(model, shapes)
    # initial values excite modes as forces do
    excited = _unit(np.column_stack([forces, mass @ start]))
    damping = None
    if model.damping is not None:
        damping = sp.csr_array(e.T @ model.damping @ e)
    for _ in range(_ROUNDS):
        if exciting is None:
            rigid, modes = lowest_modes(body, n_mode, excited)
        else:
            rigid, modes = strongest_modes(body, n_mode, _forces(model, exciting))
        coupling = _coupling(damping, np.column_stack([_excitable(rigid, excited), modes]), mass)
        if not coupling.shape[1]:
            break
        # what moves others is moved by them
        excited = np.column_stack([excited, coupling])
    if geometric is not None:
        # what its forces do to first order
        coupling = np.column_stack([coupling, _unit(np.asarray(geometric @ np.column_stack([rigid, modes])))])
    eigenvalues, elastic = ritz_vectors(body, rigid, modes, np.column_stack([forces, coupling]))
    q = np.column_stack([_excitable(rigid, excited), elastic])
    # 0 to the bit for rigid motions
    values = np.concatenate([np.zeros(q.shape[1] - len(eigenvalues)), eigenvalues])
    if geometric is not None:
        values, turn = la.eigh(q.T @ (stiffness @ q))
        q = q @ turn
    # signs by a rule: eigenvectors of two machines may differ in theirs
    q = q * _signs(q)
    full = e @ q
    return ReducedModel(
        basis=full,
        eigenvalues=values,
        damping=_damping(model, full, values),
        trace=model.trace @ full,
        area=model.channel_area,
        loads=np.column_stack([np.zeros((q.shape[1], 0)), *(full.T @ load.pattern for load in model.loads)]),
        n_mode=modes.shape[1],
        # M-orthonormal basis: q = B^T M u
        displacement=q.T @ (mass @ start[:, 0]),
        velocity=q.T @ (mass @ start[:, 1]),
    )


def orthonormal_to(vectors: Array, basis: Array, mass: sp.csr_array, stiffness: sp.csr_array) -> tuple[Array, Array]:
    """What vectors (n, k) add to a mass-orthonormal basis: mass-orthonormal, with diagonal stiffness; this diagonal."""
    added = _added(vectors, basis, mass)
    squares, turn = la.eigh(added.T @ (stiffness @ added))
    return added @ turn, squares


def ritz_vectors(body: Vibration, rigid: Array, modes: Array, forces: Array) -> tuple[Array, Array]:
    """Eigenvalues (m,), s-2, and Ritz vectors (n, m), mass-orthonormal, of elastic modes and of the static responses to
    forces (n, n_force), as far as these are not in the span of modes and rigid motions."""
    basis = np.column_stack([rigid, modes])
    elastic = np.column_stack([modes, _added(body.static(rigid, forces), basis, body.mass)])
    # orthonormal in the mass already: an ordinary eigenproblem
    eigenvalues, turn = la.eigh(elastic.T @ (body.stiffness @ elastic))
    return eigenvalues, elastic @ turn


def modal_damping(model: SubstructureModel, eigenvalues: Array) -> Array:
    """2 zeta omega (m,), s-1, of Ritz vectors with these eigenvalues, s-2; 0 for rigid motions and above the limit."""
    ratio, below = model.modal or (0.0, 0.0)
    omega = np.sqrt(np.maximum(eigenvalues, 0.0))
    return np.where(omega <= 2.0 * np.pi * below, 2.0 * ratio * omega, 0.0)


def _damping(model: SubstructureModel, basis: Array, eigenvalues: Array) -> Array | None:
    """Damping in Ritz coordinates (m, m), s-1, None where the model has none."""
    if model.damping is None and model.modal is None:
        return None
    modal = np.diag(modal_damping(model, eigenvalues))
    if model.damping is None:
        return modal
    return np.asarray(basis.T @ (model.damping @ basis) + modal)


def _coupling(damping: sp.csr_array | None, modes: Array, mass: sp.csr_array) -> Array:
    """Forces of dashpots (n, k), of length 1, by which mass-orthonormal motions (n, n_mode) excite others."""
    if damping is None:
        return np.zeros((len(modes), 0))
    forces = np.asarray(damping @ modes)
    beyond = forces - mass @ (modes @ (modes.T @ forces))
    return _unit(beyond[:, np.linalg.norm(beyond, axis=0) > _COUPLES * np.linalg.norm(forces, axis=0)])


def _forces(model: SubstructureModel, shapes: Array | None) -> Array:
    """Forces on the free dofs whose static responses the basis holds, (n, n_force)."""
    if shapes is None:
        tractions = np.eye(model.channel_area.size)
    else:
        tractions = shapes
    columns = model.trace.T @ (model.channel_area[:, None] * tractions)
    # forces that prescribed motions exert through K and M
    moved = [matrix @ model.imposed_pattern for matrix in (model.stiffness, model.inertia)]
    forces: Array = model.expansion.T @ np.column_stack([columns, *moved, *(t.pattern for t in model.loads)])
    return _unit(forces)


def _unit(columns: Array) -> Array:
    """Columns of length 1; those that are zero are left out."""
    size = np.linalg.norm(columns, axis=0)
    directions: Array = columns[:, size > 0.0] / size[size > 0.0]
    return directions


def _excitable(modes: Array, excited: Array) -> Array:
    """Combinations of modes of one eigenvalue that can be excited, mass-orthonormal as these are."""
    if not modes.shape[1] or not excited.shape[1]:
        return modes[:, :0]
    turned, strength, _ = la.svd(modes.T @ excited, full_matrices=False)
    excitable: Array = modes @ turned[:, strength > _EXCITED * np.linalg.norm(modes, axis=0).max()]
    return excitable


def _added(static: Array, basis: Array, mass: sp.csr_array) -> Array:
    """Mass-orthonormal vectors that static responses add to a basis, dependent ones dropped."""
    size = np.sqrt(np.einsum("ij,ij->j", static, mass @ static))
    if not size.any():
        return static[:, :0]
    static = static[:, size > 0.0] / size[size > 0.0]
    for _ in range(2):  # twice is enough for round-off
        static = static - basis @ (basis.T @ (mass @ static))
    values, vectors = la.eigh(static.T @ (mass @ static))
    good = values > _DEPENDENT
    added: Array = static @ (vectors[:, good] / np.sqrt(values[good]))
    if good.any():
        added = added - basis @ (basis.T @ (mass @ added))
        # the eigenvectors of a Gram matrix next to singular are orthonormal to a few digits only
        gram = la.cholesky(added.T @ (mass @ added), lower=True)
        added = la.solve_triangular(gram, added.T, lower=True).T
    return added


def _signs(vectors: Array) -> Array:
    """Sign that makes the largest entry of every column positive."""
    if not vectors.size:
        return np.ones(vectors.shape[1])
    largest = np.abs(vectors).argmax(axis=0)
    return np.where(vectors[largest, np.arange(vectors.shape[1])] < 0.0, -1.0, 1.0)
