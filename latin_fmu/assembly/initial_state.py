"""State that a run starts from after a static equilibrium: displacements, tractions, gaps, bolts."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field, replace

import numpy as np

from ..latin.assembly import Array, Assembly
from ..latin.probes import BoltPlace
from ..latin.record import BoltHistory
from .bolts import BoltCut
from .models import ModelClass


@dataclass(frozen=True)
class TightBolts:
    """Bolts of a scene after those of each order were tightened.

    Attributes
    ----------
    shortening : of each bolt, m. orders : in which they were tightened. forces : tension of every bolt when those of
        each of the orders were tight, (n_order,), N.
    """

    shortening: Mapping[str, float] = field(default_factory=dict)
    orders: tuple[int, ...] = ()
    forces: Mapping[str, tuple[float, ...]] = field(default_factory=dict)

    def locked(self, cuts: Mapping[str, BoltCut]) -> dict[str, tuple[float, float]]:
        """First and last amplitude of the load terms of bolts whose shortening is kept."""
        kept = {name: self.shortening.get(name, 0.0) for name in cuts}
        return {name: (delta, delta) for name, delta in kept.items()}

    def places(self, cuts: Mapping[str, BoltCut]) -> dict[str, BoltPlace]:
        """The bolts for the recorder."""
        places = {}
        for name, cut in cuts.items():
            table, delta = cut.table, self.shortening.get(name, 0.0)
            forces = self.forces.get(name, ())
            about = BoltHistory(
                name, table.substructure, table.order, table.force, cut.area, delta, np.zeros(0), self.orders, forces
            )
            places[name] = BoltPlace(table.substructure, cut.pattern, cut.stiffness, about)
        return places


@dataclass(frozen=True)
class InitialState:
    """Displacements and interface tractions in equilibrium.

    Attributes
    ----------
    displacement : (n_full,) by substructure, m. traction : (n_point, n_component) on side E by interface, local frames,
        Pa. closure : (n_point,) by interface, m: residual gaps of closed points, within the tolerance.
    amplitudes : of the loads that are set from outside. message : how it was computed. remarks : warnings.
    bolts : as tightened.
    """

    displacement: Mapping[str, Array]
    traction: Mapping[str, Array]
    closure: Mapping[str, Array]
    amplitudes: Mapping[str, float]
    message: str
    remarks: tuple[str, ...] = ()
    bolts: TightBolts = field(default_factory=TightBolts)

    def displaced(self, classes: list[ModelClass]) -> list[ModelClass]:
        """The classes with these initial displacements."""
        return [
            replace(c, members=[m.displaced(self.displacement.get(m.name, m.displacement)) for m in c.members])
            for c in classes
        ]

    def hand_over(self, assembly: Assembly) -> None:
        """Give an assembly the tractions, and the gaps of closed points as zero.

        A residual gap, small as it is, would have to close within the first step; in a short step that is a velocity.
        """
        for i, unit in enumerate(assembly.interfaces):
            if unit.name in self.traction:
                assembly.start_tractions[i] = self.traction[unit.name]
            if unit.name in self.closure and not assembly.quasi_static:
                group = assembly.layout.group(i)
                group.gap[group.members[i]] = unit.geometry.gap - self.closure[unit.name]
