"""Inertia of rigid parts that the modes of a tied assembly leave out.

Modes are those of an assembly whose contacts are tied. A part that slides or lifts off as a whole moves as none of
them: their sum comes close to it slowly, and few modes leave out a share of its mass. With the motions R of the
assembly in which each part is rigid and no bond, spring or support is strained, B their relative motions at the
contacts and u = Phi zeta + (Psi - Phi G) r the motion of the reduced assembly, that share is

    M_left = R^T M R - (Phi^T M R)^T (Phi^T M R) = E^T B,    E = (Psi - Phi G)^T M R

and s = M_left^+ E^T r is how far relative motions r move parts as a whole. The inertia N^T N of r, N = M_left^(1/2)
M_left^+ E^T, gives that share back to every rigid motion. It is the part of (Psi - Phi G)^T M (Psi - Phi G) that moves
with rigid parts: nothing else gets heavier than it is.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Final, NamedTuple

import numpy as np
import scipy.linalg as la

from ..latin.assembly import Array, Layout
from ..propagator import SubstructureModel
from ..propagator.model import closest_reduced
from .tied_assembly import MASS, STIFFNESS, TiedAssembly, jump_rows

_STRAIN_FREE: Final = 1e-10  # of a unit motion, and its force over the largest stiffness of a dof
_WITHOUT_MASS: Final = 1e-10  # of the largest mass
_LEFT: Final = 1e-3  # of the mass of a part: less of it is left to the modes


class RigidInertia(NamedTuple):
    """Inertia of parts that move as a whole.

    Attributes
    ----------
    amplitudes : (j, n_r) s of relative motions. relative : (n_r, j) B, relative motions of s. root : (j, j) of the mass
    that modes leave out, kg0.5.
    """

    amplitudes: Array
    relative: Array
    root: Array

    @property
    def rows(self) -> Array:
        """N (j, n_r), kg0.5."""
        return np.asarray(self.root @ self.amplitudes)


@dataclass(frozen=True)
class RigidParts:
    """Motions R (n_full, k) of an assembly in which each part is rigid.

    Attributes
    ----------
    forces : M R (n, k) on [q, r], kg. relative : B (n_r, k). mass : R^T M R (k, k), kg.
    """

    forces: Array
    relative: Array
    mass: Array

    @staticmethod
    def of(tied: TiedAssembly, layout: Layout) -> RigidParts:
        """Those of a tied assembly whose contacts move freely; ``layout`` : of its channels."""
        motions = np.zeros((tied.jump.shape[1], 6 * len(tied.models)))
        for i, model in enumerate(tied.models):
            motions[tied.where[model.name], 6 * i : 6 * i + 6] = _of_body(model)
        _, strains, turn = la.svd(_strains(tied, layout, motions))
        motions = motions @ turn[strains < _STRAIN_FREE].T
        pulled = tied.times(MASS, motions)
        return RigidParts(
            np.asarray(tied.expansion.T @ pulled), np.asarray(tied.jump @ motions), np.asarray(motions.T @ pulled)
        )

    def inertia_left(self, beyond: Array, of_modes: Array) -> RigidInertia:
        """What modes leave out.

        Parameters
        ----------
        beyond : E (n_r, k), kg. of_modes : Phi^T M R (m, k), kg0.5, as the march has it.
        """
        sizes, turn = la.eigh(self.mass)
        sound = sizes > _WITHOUT_MASS * sizes.max(initial=0.0)
        whiten = turn[:, sound] / np.sqrt(sizes[sound])
        # per unit of mass: E^T B of the modes as they are, M_left of those that are marched
        shares = whiten.T @ (beyond.T @ self.relative) @ whiten
        rows = whiten.T @ beyond.T
        marched = of_modes @ whiten
        moments, directions = la.eigh(0.5 * (shares + shares.T))
        directions, moments = directions[:, moments > _LEFT], moments[moments > _LEFT]
        lacking = directions.T @ (np.eye(len(whiten.T)) - marched.T @ marched) @ directions
        squares, turned = la.eigh(lacking)
        root = (turned * np.sqrt(np.maximum(squares, 0.0))) @ turned.T
        return RigidInertia((directions.T @ rows) / moments[:, None], self.relative @ whiten @ directions, root)


def _of_body(model: SubstructureModel) -> Array:
    """Rigid motions (n_full, 6) of a body alone: translations, and rotations about its middle over its size; those
    of a rigid body are its dofs."""
    if model.nodal is not None or model.positions is None:
        return np.eye(model.n_full, 6)
    arms = model.positions - model.positions.mean(axis=0)
    arms = arms / np.abs(arms).max()
    motions = np.zeros((len(arms), 3, 6))
    motions[:, :, :3] = np.eye(3)
    for axis in range(3):
        motions[:, :, 3 + axis] = np.cross(np.eye(3)[axis], arms)
    return motions.reshape(-1, 6)


def _strains(tied: TiedAssembly, layout: Layout, motions: Array) -> Array:
    """What supports, bonds and springs do not allow of motions (n_full, k): a triangular factor (k, k) of it."""
    stiffest = [np.abs(m.stiffness.data).max(initial=0.0) for m in tied.models]
    largest = max(*stiffest, np.abs(tied.springs.data).max(initial=0.0), np.finfo(float).tiny)
    forces = tied.times(STIFFNESS, motions) / largest
    factor = np.zeros((0, motions.shape[1]))
    for model in tied.models:
        where = tied.where[model.name]
        moved = motions[where]
        misfit = moved - model.expansion @ closest_reduced(model.expansion, moved)
        factor = la.qr(np.vstack([factor, misfit, forces[where]]), mode="r")[0]
        factor = factor[: motions.shape[1]]
    for i in tied.joints.bonded:
        apart = jump_rows(layout, tied.trace, i) @ motions
        factor = la.qr(np.vstack([factor, apart]), mode="r")[0][: motions.shape[1]]
    return factor
