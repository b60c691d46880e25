"""What bodies do along several motions of one reduced assembly, by shapes of relative motions that they share."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Final

import numpy as np

from ..joined.recovered_fields import MarchHistories, Motions, RecoveredRecorder, RelativeShapes
from ..joined.reduced_run import NAME, RELATIVE, ReducedMarch
from ..latin.assembly import Array, Index
from ..latin.probes import OutputRequest

_INSTANTS: Final = 400  # of each motion that are looked at, at most: shapes of neighbouring instants are alike
_LEFT_OUT: Final = 3e-3  # of the largest change of each motion: bonds and sides without friction alone take shapes


def spanned(march: ReducedMarch, motions: Sequence[MarchHistories]) -> RelativeShapes | None:
    """Shapes of the relative motions of several marches, whose sizes may differ by orders of magnitude; None where
    nothing takes them."""
    joints, units = march.tied.joints, march.bodies.interfaces
    if not (joints.bonded or joints.linear or any(unit.behaviour.n_component == 1 for unit in units)):
        return None
    changes = []
    for histories in motions:
        relative = histories.series("path")[RELATIVE][:, 0]
        change = relative - relative[:1]
        size = float(np.linalg.norm(change, axis=1).max(initial=0.0))
        if size > 0.0:
            changes.append(change[:: -(-len(change) // _INSTANTS)] / size)
    return RelativeShapes.of(march, np.concatenate([np.zeros((1, march.tied.n_relative)), *changes]), _LEFT_OUT)


class SpannedRecorder(RecoveredRecorder):
    """Histories of interfaces, sensors and bolts; velocities of the sides of contacts are those of E over E'.

    Parameters
    ----------
    march, histories, request : as for a ``RecoveredRecorder``. span : shapes of relative motions.
    """

    def __init__(
        self, march: ReducedMarch, histories: MarchHistories, request: OutputRequest, span: RelativeShapes | None
    ) -> None:
        self._span = span
        super().__init__(march, histories, request, {})

    def _motions_of(self, march: ReducedMarch, histories: Mapping[str, Array]) -> Motions:
        """By the shapes given."""
        return Motions(march, histories[NAME], histories[RELATIVE][:, 0], self._span)

    def _velocities(self, flat_w: Array) -> None:
        """Those of the ground alone."""
        self._ground(flat_w)

    def _move_sides(self, flat_w: Array, sides: tuple[Index, Index], relative: Array) -> None:
        """Set velocities of E from those of E', which are those of the ground or zero."""
        flat_w[:, sides[0]] = flat_w[:, sides[1]] + relative

    def _leave(self, n: int) -> None:
        """Nothing goes on from the end."""
