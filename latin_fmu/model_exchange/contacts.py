"""Interfaces seen from the full dofs of the bodies: traces of patches, mean velocities of faces."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
import scipy.sparse as sp

from ..latin.assembly import Array, Index, InterfaceUnit
from ..scene.fields import GROUND, split_face
from .bodies import BondedBody
from .patches import patches


@dataclass(frozen=True)
class Cut:
    """An interface that may open, cut into patches. ``number`` counts the interfaces of the scene."""

    number: int
    unit: InterfaceUnit
    members: list[Index]

    @classmethod
    def of(cls, number: int, unit: InterfaceUnit, n_patch: int) -> Cut:
        """Cut an interface."""
        return cls(number, unit, patches(unit.geometry.points, unit.geometry.areas, n_patch))

    @property
    def areas(self) -> Array:
        """(n_patch,), m2."""
        return np.array([self.unit.geometry.areas[m].sum() for m in self.members])

    def mean(self, values: Array) -> Array:
        """Means of values (n_point, ...) over the patches, weighted by area."""
        weights = self.unit.geometry.areas
        return np.stack([np.tensordot(weights[m] / weights[m].sum(), values[m], axes=1) for m in self.members])

    def trace(self, side: int) -> sp.csr_array | None:
        """(3 n_patch, n_full) mean motion of a side in local axes; None for the ground."""
        local = self.unit.geometry.local_trace(side, 3)
        if local is None:
            return None
        weights, n_point = self.unit.geometry.areas, self.unit.geometry.n_point
        rows = np.repeat(np.arange(len(self.members)), [len(m) for m in self.members])
        points = np.concatenate(self.members)
        share = weights[points] / self.areas[rows]
        mean = sp.csr_array((share, (rows, points)), shape=(len(self.members), n_point))
        return sp.csr_array(sp.kron(mean, sp.eye_array(3)) @ local)


def body_trace(body: BondedBody, cuts: Sequence[Cut]) -> tuple[sp.csr_array, Array]:
    """Mean motion of the patches of all interfaces on a body, E' counted positive and E negative.

    Returns
    -------
    (3 n_patch of all cuts, n_full), zero where the body has no part in it, and the areas (3 n_patch,) of its rows.
    """
    blocks, areas = [], []
    for cut in cuts:
        block = sp.csr_array((3 * len(cut.members), body.model.n_full))
        for side, face in enumerate(cut.unit.sides):
            trace = None if face == GROUND else cut.trace(side)
            if trace is not None and (name := split_face(face)[0]) in body.where:
                sign = 1.0 if side else -1.0
                block = sp.csr_array(block + sign * placed(trace, body.where[name], body.model.n_full))
        blocks.append(block)
        areas.append(np.repeat(cut.areas, 3))
    if not blocks:
        return sp.csr_array((0, body.model.n_full)), np.zeros(0)
    return sp.csr_array(sp.vstack(blocks)), np.concatenate(areas)


def face_means(body: BondedBody, units: Sequence[InterfaceUnit]) -> Array:
    """(n_interface, 2, 3, n_full) mean motion of both sides of every interface in global axes, weighted by area."""
    found = np.zeros((len(units), 2, 3, body.model.n_full))
    for i, unit in enumerate(units):
        share = sp.csr_array(unit.geometry.areas[None, :] / unit.geometry.areas.sum())
        for side, face in enumerate(unit.sides):
            trace = unit.geometry.traces[side]
            if trace is not None and (name := split_face(face)[0]) in body.where:
                mean = sp.csr_array(sp.kron(share, sp.eye_array(3)) @ trace)
                found[i, side] = placed(mean, body.where[name], body.model.n_full).toarray()
    return found


def placed(rows: sp.csr_array, where: slice, n: int) -> sp.csr_array:
    """Rows over the dofs of a substructure as rows over those of its body."""
    wide = sp.csr_array(rows).tocoo()
    return sp.csr_array((wide.data, (wide.coords[0], wide.coords[1] + where.start)), shape=(rows.shape[0], n))
