"""The state that a motion starts from where it is not the one given substructure by substructure."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, replace

from ..latin.assembly import Array, Assembly
from .models import ModelClass


@dataclass(frozen=True)
class InitialState:
    """Displacements and interface tractions in equilibrium.

    Attributes
    ----------
    displacement : (n_full,) by substructure, m. traction : (n_point, n_component) on side E by interface, local frames,
        Pa. closure : (n_point,) by interface, m: what the tolerance has left of the gaps of closed points.
    amplitudes : of the loads that are set from outside. told : how it was found. remarks : warnings.
    """

    displacement: Mapping[str, Array]
    traction: Mapping[str, Array]
    closure: Mapping[str, Array]
    amplitudes: Mapping[str, float]
    told: str
    remarks: tuple[str, ...] = ()

    def displaced(self, classes: list[ModelClass]) -> list[ModelClass]:
        """The classes with these initial displacements."""
        return [
            replace(c, members=[m.displaced(self.displacement.get(m.name, m.displacement)) for m in c.members])
            for c in classes
        ]

    def hand_over(self, assembly: Assembly) -> None:
        """Give an assembly the tractions, and the gaps of closed points as zero.

        A gap that the tolerance has left, small as it is, would have to be crossed within the first step: over a
        short one that is a velocity.
        """
        for i, unit in enumerate(assembly.interfaces):
            if unit.name in self.traction:
                assembly.start_tractions[i] = self.traction[unit.name]
            if unit.name in self.closure:
                group = assembly.layout.group(i)
                group.gap[group.members[i]] = unit.geometry.gap - self.closure[unit.name]
