"""Fields of a substructure that are found from its stored displacements and stresses, when the results are written."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any, Final

import numpy as np

from ..fem.stress import Recovery, principal
from ..latin.record import SubstructureHistory

Columns = dict[str, tuple[object, ...]]


@dataclass(frozen=True)
class Recovered:
    """What a scene asks for beyond displacement, velocity and mean stress.

    recovery : of the substructure. strain, nodal_stress, principal_stress : as in ``[output]``; principal values are
    those of the mean stress and of the nodal stress, as far as these are kept.
    """

    recovery: Recovery
    strain: bool
    nodal_stress: bool
    principal_stress: bool

    def columns(self, history: SubstructureHistory) -> Columns:
        """Variables of the dataset of the substructure."""
        found: Columns = {}
        if self.strain and history.displacement is not None:
            strain = self.recovery.strain(history.displacement)
            found["strain"] = (("time", "cell", "strain_component"), strain)
        if self.principal_stress and history.stress is not None:
            found["principal_stress"] = (("time", "cell", "principal"), principal(history.stress))
        if self.nodal_stress and history.displacement is not None:
            stress = self.recovery.nodal_stress(history.displacement)
            found["nodal_stress"] = (("time", "node", "stress_component"), stress)
            if self.principal_stress:
                found["nodal_principal_stress"] = (("time", "node", "principal"), principal(stress))
        return found


LABELS: Final[Mapping[str, Any]] = {
    "stress_component": ("xx", "yy", "zz", "yz", "xz", "xy"),
    "strain_component": ("xx", "yy", "zz", "yz", "xz", "xy"),
    "principal": np.array([1, 2, 3], dtype=np.int32),
}
"""Coordinates of the dimensions of tensors."""
