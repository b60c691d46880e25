"""Contacts in the equilibrium that a motion starts from, and the time scheme that was chosen before it was known.

The automatic time scheme rests on the gaps of the meshes (``models.chosen_scheme``): the equilibrium, in which bolts
are tight, takes far longer than all else before a run, and sessions, sweeps and derivatives have to march with the
scheme of the run. So the choice is checked against the equilibrium, and where it does not hold, what to choose is said.

A face that is open as a whole in the equilibrium lands when the motion closes it, as one with a gap of the meshes does.
A face that is pressed in a part and open beside it closes from the rim of the pressure on, without an impact; how many
of its points are open is in the words of the scheme. Gaps of the meshes that the equilibrium has closed do not land.
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from typing import Final, NamedTuple

import numpy as np
from numpy.typing import NDArray

from ..fem.mesh import Array
from ..latin.assembly import InterfaceUnit
from ..propagator import SubstructureModel
from ..scene.fields import GROUND, split_face
from ..scene.readable_numbers import readable
from ..scene.units import UnitSystem
from .initial_state import InitialState

_ROUND_OFF: Final = 1e-12  # of the size of a face, a gap that is none


class StartContact(NamedTuple):
    """Points of an interface in the equilibrium: gaps (n_point,), m, 0 where they are pressed, and whether they are."""

    gap: Array
    pressed: NDArray[np.bool_]

    @property
    def open(self) -> int:
        """Number of points that are open."""
        return int((self.gap > 0.0).sum())


def start_gap(unit: InterfaceUnit, models: Mapping[str, SubstructureModel], displacement: Mapping[str, Array]) -> Array:
    """Gap (n_point,), m, of an interface with displacements (n_full,) by substructure; bodies left out have none."""
    opened = np.zeros(unit.geometry.n_point)
    for side, (face, trace) in enumerate(zip(unit.sides, unit.geometry.traces, strict=True)):
        name = split_face(face)[0]
        if face == GROUND or trace is None or name not in displacement:
            continue
        nodal = models[name].nodal
        if nodal is None:
            moved = displacement[name]
        else:
            moved = nodal @ displacement[name]
        along = np.einsum("pi,pi->p", unit.geometry.frames[:, 0], (trace @ moved).reshape(-1, 3))
        # N points from E to E'
        opened += (2 * side - 1) * along
    gap: Array = unit.geometry.gap + opened
    return gap


def start_contacts(
    units: Sequence[InterfaceUnit], models: Mapping[str, SubstructureModel], start: InitialState
) -> dict[str, StartContact]:
    """Contacts in the equilibrium by the name of the interface."""
    contacts = {}
    for unit in units:
        if unit.behaviour.opens and unit.name in start.traction:
            pressed = start.traction[unit.name][:, 0] < 0.0
            gap = start_gap(unit, models, start.displacement)
            least = _ROUND_OFF * float(np.ptp(unit.geometry.points, axis=0).max())
            contacts[unit.name] = StartContact(np.where(pressed | (gap <= least), 0.0, gap), pressed)
    return contacts


def open_points(contacts: Mapping[str, StartContact], units: UnitSystem) -> str:
    """How many points of closed faces are open in the equilibrium, in words; empty where none are."""
    count, total = sum(c.open for c in contacts.values()), sum(len(c.gap) for c in contacts.values())
    if not count:
        return ""
    largest = readable(max(float(c.gap.max()) for c in contacts.values()), units.label("m"), 3)
    return f"in the equilibrium of the start {count} of {total} points are open, by up to {largest}"


def lifted(contacts: Mapping[str, StartContact]) -> dict[str, StartContact]:
    """Those of which no point is pressed, and all are open."""
    return {name: c for name, c in contacts.items() if len(c.gap) and not c.pressed.any() and (c.gap > 0.0).all()}


def scheme_remarks_at_start(
    contacts: Mapping[str, StartContact],
    unforeseen: Mapping[str, str],
    landing: Sequence[str],
    chosen: tuple[str, str],
    units: UnitSystem,
) -> Iterator[str]:
    """Sentences where the equilibrium speaks against the time scheme.

    unforeseen : by interface that was closed when the scheme was chosen, what a landing means
    (``models.unforeseen_landings``). landing : interfaces for whose gaps the scheme was chosen, none where it was not
    for them. chosen : name of the scheme, and the one that suits where they are closed.
    """
    for name, contact in lifted(contacts).items():
        if name in unforeseen:
            least, most = (readable(float(f(contact.gap)), units.label("m"), 3) for f in (np.min, np.max))
            if least == most:
                size = most
            else:
                size = f"{least} to {most}"
            yield (
                f"interface {name} is closed as it is meshed, and open by {size} in the equilibrium of the start, so "
                f"that it lands in the motion: {unforeseen[name]}"
            )
    if landing and chosen[0] != chosen[1] and all(n in contacts and contacts[n].pressed.all() for n in landing):
        yield (
            f"time.scheme {chosen[0]} was chosen for the gaps of {', '.join(landing[:3])}, which are closed in the "
            f'equilibrium of the start: nothing lands, and time.scheme = "{chosen[1]}" suits closed faces better'
        )
