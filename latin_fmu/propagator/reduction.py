"""Component mode synthesis of one substructure: a few vibration modes, and exact static answers at the interfaces.

The basis holds (Rubin 1975, Craig and Bampton 1968 in the free-interface form)

    R      the rigid motions the conditions leave, K R = 0
    Phi    the lowest elastic modes of the substructure with free interfaces, K phi = lambda M phi
    X      the static answer to every traction shape and every load, K x = b - M R R^T b (inertia relief)

and is turned into Ritz vectors: mass-orthonormal, stiffness diagonal. Modes that no shape, no load and no initial
value can excite are left out: they stay at rest. A constraint mode of an interface dof is a sum of static answers and
rigid motions, so that with one shape per channel the span holds that of Craig and Bampton's constraint modes.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import scipy.linalg as la
import scipy.sparse as sp

from .model import Array, SubstructureModel, reduced_rank
from .modes import SILENT, Vibration, lowest_modes, strongest_modes

_DEPENDENT = 1e-9  # squared norm of what a static answer adds to the basis, against its own


@dataclass(frozen=True)
class ReducedModel:
    """A substructure in m Ritz coordinates q: ``u_full = basis @ q`` (+ prescribed motions, if there are any).

        q'' + damping q' + eigenvalues * q = trace^T (area * tractions) + loads @ amplitudes

    Attributes
    ----------
    basis : (n_full, m), mass-orthonormal: the reduced mass is the unit matrix. kg-1/2.
    eigenvalues : (m,) diagonal of the reduced stiffness, ascending, exactly 0 for rigid motions, s-2.
    damping : (m, m) s-1, None where the model has none.
    trace : (n_channel, m) from q' to the velocities of the interface channels.
    area : (n_channel,) of the channels, m2.
    loads : (m, n_load) nodal forces of the load terms for amplitude 1.
    displacement, velocity : (m,) initial values; the nearest ones, in the norm of the mass, where modes are missing.
    """

    basis: Array
    eigenvalues: Array
    damping: Array | None
    trace: Array
    area: Array
    loads: Array
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
    n_mode : number of elastic modes; fewer where the mesh has fewer. >= 0.
    shapes : (n_channel, n_shape) tractions on the channels, Pa, whose static answers are exact; None: one shape per
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
    for given in (shapes, exciting):
        if given is not None and (given.ndim != 2 or given.shape[0] != model.channel_area.size):
            raise ValueError(f"shapes must be ({model.channel_area.size}, n_shape), not {given.shape}")
    e = model.expansion
    mass, stiffness = (sp.csr_array(e.T @ m @ e) for m in (model.inertia, model.stiffness))
    if (mass.diagonal() <= 0.0).any():
        raise ValueError("some free directions carry no mass")
    if not mass.shape[0]:
        raise ValueError("nothing is free to move")
    body = Vibration(stiffness, mass, None if model.ordering is None else reduced_rank(e, model.ordering))
    once = 1.0 / np.maximum(np.asarray(e.sum(axis=0)).ravel(), 1.0)
    start = [once * (e.T @ model.displacement), once * (e.T @ model.velocity)]
    forces = _forces(model, shapes)
    excited = _unit(np.column_stack([forces, mass @ np.column_stack(start)]))
    if exciting is None:
        rigid, modes = lowest_modes(body, n_mode, excited)
    else:
        rigid, modes = strongest_modes(body, n_mode, _forces(model, exciting))
    kept = np.column_stack([rigid, modes])
    elastic = np.column_stack([modes, _added(body.static(rigid, forces), kept, mass)])
    eigenvalues, turn = la.eigh(elastic.T @ (stiffness @ elastic))
    q = np.column_stack([_leaning(rigid, excited), elastic @ turn])
    q = q * _signs(q)
    full = e @ q
    return ReducedModel(
        basis=full,
        eigenvalues=np.concatenate([np.zeros(q.shape[1] - len(eigenvalues)), eigenvalues]),
        damping=None if model.damping is None else full.T @ (model.damping @ full),
        trace=model.trace @ full,
        area=model.channel_area,
        loads=np.column_stack([np.zeros((q.shape[1], 0)), *(full.T @ load.pattern for load in model.loads)]),
        displacement=q.T @ (mass @ start[0]),
        velocity=q.T @ (mass @ start[1]),
    )


def _forces(model: SubstructureModel, shapes: Array | None) -> Array:
    """Forces on the free dofs whose static answers are wanted, (n, n_force)."""
    given = np.eye(model.channel_area.size) if shapes is None else shapes
    columns = model.trace.T @ (model.channel_area[:, None] * given)
    moved = [matrix @ model.imposed_pattern for matrix in (model.stiffness, model.inertia)]
    found: Array = model.expansion.T @ np.column_stack([columns, *moved, *(t.pattern for t in model.loads)])
    return _unit(found)


def _unit(columns: Array) -> Array:
    """Columns of length 1; those that are zero are left out."""
    size = np.linalg.norm(columns, axis=0)
    kept: Array = columns[:, size > 0.0] / size[size > 0.0]
    return kept


def _leaning(rigid: Array, excited: Array) -> Array:
    """Rigid motions that can be excited: a mass-orthonormal basis of theirs."""
    if not rigid.shape[1] or not excited.shape[1]:
        return rigid[:, :0]
    turned, strength, _ = la.svd(rigid.T @ excited, full_matrices=False)
    leaning: Array = rigid @ turned[:, strength > SILENT * np.linalg.norm(rigid, axis=0).max()]
    return leaning


def _added(static: Array, kept: Array, mass: sp.csr_array) -> Array:
    """Mass-orthonormal vectors that static answers add to a basis, dependent ones dropped."""
    own = np.sqrt(np.einsum("ij,ij->j", static, mass @ static))
    if not own.any():
        return static[:, :0]
    static = static[:, own > 0.0] / own[own > 0.0]
    for _ in range(2):  # twice is enough for round-off
        static = static - kept @ (kept.T @ (mass @ static))
    values, vectors = la.eigh(static.T @ (mass @ static))
    good = values > _DEPENDENT
    added: Array = static @ (vectors[:, good] / np.sqrt(values[good]))
    if good.any():
        added = added - kept @ (kept.T @ (mass @ added))
        gram = la.cholesky(added.T @ (mass @ added), lower=True)
        added = la.solve_triangular(gram, added.T, lower=True).T
    return added


def _signs(vectors: Array) -> Array:
    """Sign that makes the largest entry of every column positive."""
    if not vectors.size:
        return np.ones(vectors.shape[1])
    largest = np.abs(vectors).argmax(axis=0)
    return np.where(vectors[largest, np.arange(vectors.shape[1])] < 0.0, -1.0, 1.0)
