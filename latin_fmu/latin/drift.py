"""How far bonded sides have drifted apart: velocities are tied to the tolerance, displacements add them up."""

from __future__ import annotations

import numpy as np

from ..interface.behaviour import bonds
from .assembly import Assembly

_WORTH_TELLING = 1e-2


def drift_remarks(assembly: Assembly) -> list[str]:
    """A sentence per bonded interface whose sides stand apart by more than 1 % of the largest displacement."""
    if not any(bonds(unit.behaviour) for unit in assembly.interfaces):
        return []
    u = assembly.displacement()
    largest = float(np.abs(u).max())
    remarks = []
    for i, unit in enumerate(assembly.interfaces):
        if not bonds(unit.behaviour):
            continue
        first, second = (assembly.layout.channels(i, side) for side in (0, 1))
        apart = float(np.linalg.norm(u[second] - u[first], axis=1).max())
        if apart > _WORTH_TELLING * largest:
            remarks.append(
                f"bonded interface {unit.name}: its sides have drifted apart by {apart:.3g} m, "
                f"{100 * apart / largest:.2g} % of the largest displacement of the interfaces: "
                "lower solver.tolerance"
            )
    return remarks
