"""Force through a perfect interface, which bonding has made internal to a body."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
import scipy.sparse as sp

from ..latin.assembly import Array, InterfaceUnit
from ..scene.fields import split_face
from .bodies import BondedBody
from .system import Bond

Part = tuple[BondedBody, Array, sp.csr_array]
"""A body, its basis (n_full, size), its traces of patches (3 n_patch, n_full)."""


def bond_of(interface: int, unit: InterfaceUnit, parts: Sequence[Part], load_names: Sequence[str]) -> Bond:
    """Rows of ``Bond``: equilibrium of side E, tested with a unit translation of the nodes of the interface.

    parts : all bodies, in the order of their coordinates.
    """
    name = split_face(unit.sides[0])[0]
    sizes = [basis.shape[1] for _, basis, _ in parts]
    number = next(i for i, (body, _, _) in enumerate(parts) if name in body.where)
    body, basis, trace = parts[number]
    model = body.members[name]
    test = _translations(unit, model.expansion)
    here = basis[body.where[name]]

    def rows(matrix: sp.csr_array | None) -> Array:
        wide = np.zeros((3, sum(sizes)))
        if matrix is not None:
            start = sum(sizes[:number])
            wide[:, start : start + sizes[number]] = (test @ matrix) @ here
        return wide

    loads = np.zeros((3, len(load_names)))
    for load in model.loads:
        loads[:, load_names.index(load.name)] += test @ load.pattern
    pushed = (trace[:, body.where[name]] @ test.T).reshape(-1, 3, 3)  # patch, component, direction
    normal = unit.geometry.areas @ unit.geometry.frames[:, 0]
    return Bond(
        interface=interface,
        inertia=rows(model.mass),
        damping=rows(model.damping),
        stiffness=rows(model.stiffness),
        loads=loads,
        pressure=pushed[:, 0].T,
        shear=pushed[:, 1:].transpose(1, 2, 0),
        normal=normal / np.linalg.norm(normal),
    )


def _translations(unit: InterfaceUnit, expansion: sp.csr_array) -> Array:
    """(3, n_full of side E): one along each axis at the nodes of the interface, 0 where a direction is held."""
    trace = unit.geometry.traces[0]
    test = np.zeros((3, trace.shape[1]))
    test[trace.indices % 3, trace.indices] = 1.0
    free = np.diff(expansion.indptr) > 0
    return test * free
