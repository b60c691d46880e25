"""One body in its Ritz coordinates."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np
import scipy.sparse as sp

from ..propagator.reduction import ReducedModel, reduce_model
from .bodies import BondedBody
from .contacts import Cut, body_trace
from .system import Array


@dataclass(frozen=True)
class ReducedBody:
    """A body and its reduced model.

    Attributes
    ----------
    trace : (3 n_patch of all interfaces, n_full) motion of the patches, E' positive, E negative. mass : kg.
    """

    body: BondedBody
    model: ReducedModel
    trace: sp.csr_array
    mass: float

    @classmethod
    def of(cls, body: BondedBody, cuts: Sequence[Cut], n_mode: int) -> ReducedBody:
        """Reduce a body."""
        trace, area = body_trace(body, cuts)
        needed = np.flatnonzero(_transmits(cuts) & (np.diff(trace.indptr) > 0))
        here = replace(body.model, trace=sp.csr_array(trace[needed]), channel_area=area[needed])
        reduced = reduce_model(here, n_mode, exciting=_uniform(cuts)[needed])
        return cls(body, reduced, trace, float(body.model.inertia.sum()) / 3.0)

    @property
    def size(self) -> int:
        """Number of coordinates."""
        return len(self.model.eigenvalues)

    @property
    def basis(self) -> Array:
        """(n_full, size), coordinates of the size of a displacement."""
        scaled: Array = self.model.basis * np.sqrt(self.mass)
        return scaled

    def rows(self, substructure: str, node: int) -> Array:
        """(3, size) displacement of a node of a substructure from the coordinates."""
        if substructure not in self.body.where:
            return np.zeros((3, self.size))
        first = self.body.where[substructure].start + 3 * node
        picked: Array = self.basis[first : first + 3]
        return picked


def _transmits(cuts: Sequence[Cut]) -> np.ndarray[tuple[int], np.dtype[np.bool_]]:
    """Rows of a trace of patches that carry traction: no tangential ones where there is no friction."""
    rows = [np.tile(np.arange(3) < c.unit.behaviour.n_component, len(c.members)) for c in cuts]
    return np.concatenate([np.zeros(0, dtype=bool), *rows])


def _uniform(cuts: Sequence[Cut]) -> Array:
    """Uniform tractions on every interface, one a column, (3 n_patch of all, 3 n_cut)."""
    blocks = [np.tile(np.eye(3), (len(c.members), 1)) for c in cuts]
    columns: Array = sp.block_diag([*blocks, np.zeros((0, 0))]).toarray()
    return columns


def loads_of(bodies: Sequence[ReducedBody], root: Array) -> tuple[list[str], Array]:
    """Names of the load terms, each once, and their forces on the coordinates (n, n_load)."""
    names = list(dict.fromkeys(load.name for b in bodies for load in b.body.model.loads))
    table = np.zeros((len(root), len(names)))
    start = 0
    for b in bodies:
        for load, column in zip(b.body.model.loads, b.model.loads.T, strict=True):
            table[start : start + b.size, names.index(load.name)] += column
        start += b.size
    return names, table * root[:, None]


def damping_of(bodies: Sequence[ReducedBody]) -> Array | None:
    """(n, n) damping of all bodies, N s m-1; None where there is none."""
    if all(b.model.damping is None for b in bodies):
        return None
    parts = [np.zeros((b.size, b.size)) if b.model.damping is None else b.mass * b.model.damping for b in bodies]
    blocks: Array = sp.block_diag(parts).toarray()
    return blocks
