"""Sizes of a scene before anything is factorised, and what its parts cost per instant.

The factor is counted exactly, from the pattern of the matrices; times are counts times the seconds below (one thread
of a present-day processor): good for shares and orders of magnitude.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property
from typing import Final

import numpy as np
import scipy.sparse as sp

from ..interface.behaviour import bonds
from ..propagator import SubstructureModel
from ..propagator.cholesky.symbolic import analyse
from ..propagator.model import reduced_rank
from ..scene.build import Prepared

SWEEP, PRODUCT, SPARSE, LOCAL = 5e-10, 3e-10, 1.2e-9, 1.5e-8
"""Seconds per entry of a factor in one half solve, of a dense and of a sparse matrix product, and per unknown of the
local stage with its bookkeeping."""
INSTANT = 2e-5
"""Seconds of an instant and class whatever its size."""
ITERATIONS: Final = {"friction": 4.0, "contact": 3.0, "bonded": 3.0}
"""LATIN iterations of a window of one instant with the automatic search direction (measured on the shipped models)."""


@dataclass(frozen=True)
class ClassSizes:
    """Sizes of a class of identical substructures.

    n_member, n_dof, n_channel : members; unknowns and interface channels of one. factor : entries of its factor.
    stiffness, mass, damping : entries of the reduced matrices. nodes, cells : of one member's mesh.
    rigid : whether it cannot deform.
    """

    n_member: int
    n_dof: int
    n_channel: int
    factor: int
    stiffness: int
    mass: int
    damping: int
    nodes: int
    cells: int
    rigid: bool

    @property
    def march(self) -> float:
        """One instant of all members without iteration, s."""
        per_member = (
            2 * SWEEP * self.factor + SPARSE * (self.stiffness + self.mass) + PRODUCT * self.n_channel**2
        )
        return INSTANT + self.n_member * per_member

    @property
    def response(self) -> float:
        """One product with the condensed operator for all members, s."""
        return self.n_member * PRODUCT * self.n_channel**2


class Sizes:
    """Sizes of a prepared scene."""

    def __init__(self, prepared: Prepared) -> None:
        self.prepared, self.scene = prepared, prepared.scene
        explicit = getattr(prepared.scheme, "explicit", False)
        self.classes = [self._class(c.members, len(c.channels), explicit=explicit) for c in prepared.classes]

    def _class(self, members: list[SubstructureModel], n_channel: int, explicit: bool) -> ClassSizes:
        model = members[0]
        body = self.prepared.bodies[model.name]
        if model.mass is None:
            stiffness = model.reduced_stiffness
            return ClassSizes(
                len(members), stiffness.shape[0], n_channel, _factor_entries(model, stiffness), stiffness.nnz, 0,
                0, body.mesh.n_node, len(body.mesh.cells), body.rigid,
            )  # fmt: skip
        mass, damping, stiffness = model.reduced
        entries = mass.shape[0] if explicit else _factor_entries(model, stiffness + mass)
        return ClassSizes(
            len(members), mass.shape[0], n_channel, entries, stiffness.nnz, mass.nnz,
            0 if damping is None else damping.nnz, body.mesh.n_node, len(body.mesh.cells), body.rigid,
        )  # fmt: skip

    @property
    def n_dof(self) -> int:
        """Unknowns of all substructures."""
        return sum(c.n_member * c.n_dof for c in self.classes)

    @property
    def n_flat(self) -> int:
        """Interface unknowns, both sides, ground included."""
        return self.prepared.layout.n_flat

    @property
    def n_instant(self) -> int:
        """Number of steps."""
        return len(self.prepared.time) - 1

    @property
    def n_stored(self) -> int:
        """Instants at which fields are kept."""
        return self.n_instant // self.scene.output.every + 1

    @property
    def n_tangential(self) -> int:
        """Tangential interface unknowns, both sides."""
        return int((~self.prepared.layout.normal).sum())

    @property
    def solved_at_once(self) -> bool:
        """Whether every instant is one linear solve: perfect interfaces only, windows of one instant."""
        solver, units = self.scene.solver, self.prepared.units
        wanted = solver.window == 1 and solver.bonds == "direct" and not self.scene.time.quasi_static
        return wanted and bool(units) and all(bonds(u.behaviour) for u in units)

    @cached_property
    def iterations(self) -> float:
        """LATIN iterations expected per instant (one solve of the bonds counts as one)."""
        units = self.prepared.units
        if not units:
            return 0.0
        if self.solved_at_once:
            return 1.0
        if any(u.behaviour.opens and u.behaviour.n_component > 1 for u in units):
            return ITERATIONS["friction"]
        return ITERATIONS["contact" if any(u.behaviour.opens for u in units) else "bonded"]

    @property
    def march(self) -> float:
        """One instant of all substructures without iteration, s."""
        return sum(c.march for c in self.classes)

    @property
    def iterating(self) -> float:
        """LATIN iterations of one instant, s."""
        return self.iterations * (sum(c.response for c in self.classes) + LOCAL * self.n_flat)

    @property
    def factor_bytes(self) -> int:
        """Factors and condensed operators."""
        return sum(8 * (c.factor + 3 * c.n_channel**2) for c in self.classes)


def _factor_entries(model: SubstructureModel, pattern: sp.csr_array) -> int:
    """Entries of the factor of one substructure, its interface dofs last."""
    if not pattern.shape[0]:
        return 0
    trace = sp.csc_array(model.trace @ model.expansion)
    last = np.flatnonzero(np.diff(trace.indptr)).astype(np.int64)
    rank = None if model.ordering is None else reduced_rank(model.expansion, model.ordering)
    interior = int(analyse(sp.csr_array(pattern), last, rank).panel_start[-1])
    return interior + len(last) ** 2
