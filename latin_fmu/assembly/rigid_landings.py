"""Impacts between rigid bodies, or of one on the ground, which have no answer without a law of impact.

Two rigid bodies that meet separate again with e times the speed of their approach. The restitution e is a property of
what is soft between them, and no key of a contact has it: the march would rebound by a number that the place of the
contact between two instants decides. A layer (``soft_contact``) or an elastic body makes the impact one of known
stiffness.
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from typing import Final

import numpy as np

from ..errors import Problem
from ..latin.assembly import InterfaceUnit
from ..scene.fields import GROUND, split_face
from ..scene.schema import Scene
from .body import Body
from .models import approaches

SOFT: Final = (
    'behaviour = "soft_contact" with the normal_stiffness of the compliance between them, or rigid = false for one of '
    "them"
)
"""What gives an impact of rigid bodies a stiffness."""


def rigid_contacts(bodies: Mapping[str, Body], units: Sequence[InterfaceUnit]) -> list[InterfaceUnit]:
    """Interfaces that may open, without a layer, between rigid bodies or a rigid body and the ground; not those with a
    law of the caller, who may have a law of impact."""
    return [
        unit
        for unit in units
        if unit.behaviour.opens
        and not unit.behaviour.compliant
        and getattr(unit.behaviour, "compiled", False)
        and all(side == GROUND or bodies[split_face(side)[0]].rigid for side in unit.sides)
    ]


def rigid_landings(scene: Scene, bodies: Mapping[str, Body], units: Sequence[InterfaceUnit]) -> Iterator[Problem]:
    """A problem for every interface where rigid bodies meet with a speed: all its points are open at the start, or
    closed ones approach each other."""
    if scene.time.quasi_static:
        return
    for unit in rigid_contacts(bodies, units):
        size = max(bodies[split_face(side)[0]].mesh.size for side in unit.sides if side != GROUND)
        gap = float(unit.geometry.gap.min(initial=np.inf))
        if gap <= 1e-9 * size and not approaches(bodies, unit):
            continue
        if gap > 1e-9 * size:
            how = f"a gap of {gap:.6g} {scene.unit_system['m']}"
        else:
            how = "sides that approach each other"
        yield Problem(
            f"interface.{unit.name}",
            f"{' and '.join(unit.sides)} are rigid and impact, and nothing says how they rebound: this would "
            "depend on the time step",
            how,
            "a layer or an elastic body on one side of an impact; faces that remain closed need neither",
            SOFT,
        )


def rigid_impacts(scene: Scene, bodies: Mapping[str, Body], units: Sequence[InterfaceUnit]) -> dict[str, str]:
    """By interface whose sides are rigid and closed at the start: what to say where it opens and closes by an impact
    during the run (``models.unforeseen_landings``)."""
    if scene.time.quasi_static:
        return {}
    words = f"both sides are rigid, and how they rebound from it depends on the time step: set {SOFT}"
    return {unit.name: words for unit in rigid_contacts(bodies, units)}
