"""What the branches of the bodies make of the static responses of a reduced assembly to its loads.

The static response K+ f of a load beyond that of the modes strains the bodies as their motion does: with its amplitude
f_k every branch has an elongation (``time_scheme.maxwell``)

    e_new = c_e e + c_u (f_new - f)

which is part of what a communication step goes on from, as the elongations of prescribed motions are.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from ..joined.reduced_run import DrivePlace
from ..latin.assembly import Array, Assembly
from ..time_scheme import MasslessContact, MaxwellBranches


@dataclass(frozen=True)
class LoadStrains:
    """Elongations of loads that vary.

    Attributes
    ----------
    places : of the loads, with their numbers among the drives. branches : of the bodies. dt : step, s.
    """

    places: Sequence[tuple[int, DrivePlace]]
    branches: MaxwellBranches
    dt: float

    @property
    def size(self) -> int:
        """Numbers of the state."""
        return len(self.places) * len(self.branches)

    def place(self, k: int) -> int | None:
        """Where the elongations of the drive ``k`` begin in the state; None for a load that does not vary."""
        numbers = [number for number, _ in self.places]
        return numbers.index(k) * len(self.branches) if k in numbers else None

    def after(self, bodies: Assembly, before: Array, instant: int) -> Array:
        """Elongations (size,) at an instant of the segment that the bodies have begun, from those at its first one."""
        if not self.size:
            return np.zeros(0)
        loads = np.array([place.amplitude(bodies) for _, place in self.places]).reshape(len(self.places), -1)
        _, c_e, c_u, _ = self.branches.weights(MasslessContact(), self.dt)
        elongations = before.reshape(len(self.places), len(self.branches))
        for t in range(instant):
            elongations = c_e * elongations + np.outer(loads[:, t + 1] - loads[:, t], c_u)
        return np.asarray(elongations).ravel()
