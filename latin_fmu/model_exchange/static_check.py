"""Whether the patches are fine enough: deflection under the loads with every contact closed, reduced against mesh.

A patch resists the mean motion of its points only. Where a body bends between the points of a patch (a punch on the
middle of a plate) the reduced contact is too soft, and forces come late and small; impulses may be right by accident.
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
import scipy.linalg as la
import scipy.sparse as sp

from ..cholesky.factor import interface_factor
from ..latin.assembly import Array
from ..propagator.model import reduced_rank
from ..scene.fields import GROUND, split_face
from .bodies import BondedBody
from .contacts import Cut, placed
from .system import ReducedSystem

_CLOSED = 1e4  # stiffness of a closed contact over the static stiffness of its bodies, in both models
_INERTIA = 6.0  # inertia like that of a motion exp(6 t / end): it holds what nothing else holds


def deflections(system: ReducedSystem, bodies: Sequence[BondedBody], cuts: Sequence[Cut]) -> dict[str, float]:
    """Deflection b . A^-1 b under every load b: that of the reduced model over that of the mesh, 1 where they agree.

    A = K + (6 / end)^2 M + springs that close the contacts. Loads that move nothing are left out.
    """
    growth = (_INERTIA / system.end) ** 2
    names = [name for name in system.load_names if name]
    if not names:
        return {}
    full = _mesh(system, bodies, cuts, names, growth)
    c = system.contacts
    springs = _CLOSED * c.stiffness * c.area
    matrix = np.diag(system.stiffness + growth * system.inertia) + (c.opening.T * springs) @ c.opening
    for rows in c.sliding:
        matrix += (rows.T * springs) @ rows
    loads = system.loads[:, [system.load_names.index(name) for name in names]]
    reduced = np.einsum("ij,ij->j", loads, la.solve(matrix, loads, assume_a="pos"))
    return {n: float(r / f) for n, r, f in zip(names, reduced, full, strict=True) if f > 0.0}


def _mesh(
    system: ReducedSystem, bodies: Sequence[BondedBody], cuts: Sequence[Cut], names: Sequence[str], growth: float
) -> Array:
    """Deflections (n_load,) of the mesh."""
    models = [body.model for body in bodies]
    expansion = sp.csr_array(sp.block_diag([m.expansion for m in models]))
    matrix = sp.csr_array(sp.block_diag([m.stiffness + growth * m.inertia for m in models]))
    sizes = [m.n_full for m in models]
    for cut in cuts:
        rows = _jump(cut, bodies, sizes)
        stiffness = system.contacts.stiffness[system.contacts.owner == cut.number][0]
        area = np.repeat(cut.unit.geometry.areas, cut.unit.behaviour.n_component)
        matrix = matrix + rows.T @ (sp.diags_array(_CLOSED * stiffness * area) @ rows)
    loads = np.zeros((sum(sizes), len(names)))
    start = 0
    for model in models:
        for load in model.loads:
            if load.name in names:
                loads[start : start + model.n_full, names.index(load.name)] += load.pattern
        start += model.n_full
    loads = expansion.T @ loads
    factor = interface_factor(
        sp.csr_array(expansion.T @ matrix @ expansion), np.zeros(0, dtype=np.int64), _rank(bodies)
    )
    found: Array = np.einsum("ij,ij->j", loads, factor.solve(loads))
    return found


def _jump(cut: Cut, bodies: Sequence[BondedBody], sizes: Sequence[int]) -> sp.csr_array:
    """Motion of side E' relative to E at every point, from all full dofs."""
    unit = cut.unit
    n_component = unit.behaviour.n_component
    total = sp.csr_array((unit.geometry.n_point * n_component, sum(sizes)))
    for side, face in enumerate(unit.sides):
        trace = None if face == GROUND else unit.geometry.local_trace(side, n_component)
        if trace is None:
            continue
        name = split_face(face)[0]
        number = next(i for i, body in enumerate(bodies) if name in body.where)
        start = sum(sizes[:number]) + bodies[number].where[name].start
        sign = 1.0 if side else -1.0
        total = total + sign * placed(trace, slice(start, start + trace.shape[1]), sum(sizes))
    return sp.csr_array(total)


def _rank(bodies: Sequence[BondedBody]) -> Array | None:
    """Elimination order: body after body, each in its own order; None where one has none."""
    ranks, start = [], 0.0
    for body in bodies:
        if body.model.ordering is None:
            return None
        rank = reduced_rank(body.model.expansion, body.model.ordering) + start
        start = float(rank.max(initial=start)) + 1.0
        ranks.append(rank)
    return np.concatenate(ranks)
