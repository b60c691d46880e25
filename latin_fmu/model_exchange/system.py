"""Data of a reduced model that travel in an FMU: arrays as bytes, variables as JSON."""

from __future__ import annotations

import json
from dataclasses import asdict, dataclass
from typing import Any, Final

import numpy as np
from numpy.typing import NDArray

from ..cosim.variable import Variable, table_from, table_text
from ..latin.state_serialization import decode, encode

Array = NDArray[np.float64]
STIFFNESS, DAMPING, SLIDING = "contactStiffness", "contactDamping", "slidingVelocity"
EVENTS = "model.events"
WORKS: Final = ("work_of_loads", "interface_work", "friction_dissipation", "contact_dissipation", "damping_dissipation")
"""Energies that are states, in the order of the states."""
ENERGY_NAMES: Final = ("kinetic", "elastic", "contact", *WORKS, "balance")
_KIND = "reduced system 1"


@dataclass(frozen=True)
class Contacts:
    """Interfaces that may open, on patches of uniform pressure; local axes N, t1, t2, N from side E to side E'.

    Attributes
    ----------
    owner : (n_patch,) number of the interface. area : (n_patch,), m2.
    opening : (n_patch, n) and sliding : (2, n_patch, n) motion of E' relative to E from the coordinates.
    frames : (n_patch, 3, 3) rows N, t1, t2, means over the patch.
    gap : (n_patch,) at the start, m. preload : (n_patch,), Pa. friction : (n_patch,) Coulomb's coefficient.
    stiffness : (n_patch,) static stiffness of the two bodies under uniform pressure on the interface, Pa m-1.
    """

    owner: Array
    area: Array
    opening: Array
    sliding: Array
    frames: Array
    gap: Array
    preload: Array
    friction: Array
    stiffness: Array


@dataclass(frozen=True)
class Bond:
    """Force that a perfect interface exerts on side E: what its nodes need on that side to move as they do.

        force = inertia @ x'' + damping @ x' + stiffness @ x - loads @ a - pressure @ (A P) + shear @ (A tau)

    Attributes
    ----------
    interface : its number. inertia, damping, stiffness : (3, n). loads : (3, n_load).
    pressure : (3, n_patch), shear : (2, 3, n_patch): contacts that share nodes with it. normal : (3,) mean N.
    """

    interface: int
    inertia: Array
    damping: Array
    stiffness: Array
    loads: Array
    pressure: Array
    shear: Array
    normal: Array


@dataclass(frozen=True)
class ReducedSystem:
    """A reduced model in n coordinates x, scaled so that x is of the size of a displacement, m.

        inertia x'' + damping x' + stiffness x = loads a(t) + opening^T (A P) - sliding^T (A tau)

    Attributes
    ----------
    bodies : names, sizes : numbers of coordinates. interfaces : names. inertia, stiffness : (n,), kg, N m-1.
    damping : (n, n) N s m-1, None where there is none. loads : (n, n_load), N.
    load_names : of the columns of ``loads``, "" for a constant one. laws : of these loads, as tables of the scene.
    displacement, velocity : (n,) at the start, m, m s-1.
    sides : (n_interface, 2, 3, n) mean velocities of both sides from x'; 0 for the ground.
    ground : interfaces against moving ground: number, velocity (3,) where the law is 1, m s-1, law.
    sensors : names. places : (n_sensor, 3, n).
    traction, speed : sizes that loads and initial values can bring, Pa, m s-1. end : of the scene, s.
    """

    bodies: list[str]
    sizes: list[int]
    interfaces: list[str]
    inertia: Array
    stiffness: Array
    damping: Array | None
    loads: Array
    load_names: list[str]
    laws: dict[str, dict[str, Any]]
    displacement: Array
    velocity: Array
    contacts: Contacts
    bonds: list[Bond]
    sides: Array
    ground: list[tuple[int, Array, dict[str, Any]]]
    sensors: list[str]
    places: Array
    traction: float
    speed: float
    end: float

    @property
    def n(self) -> int:
        """Number of coordinates."""
        return len(self.inertia)

    def to_bytes(self) -> bytes:
        """Write the system as bytes, bit for bit."""
        return encode(asdict(self), _KIND)

    @classmethod
    def from_bytes(cls, blob: bytes) -> ReducedSystem:
        """Read the system that ``to_bytes`` wrote. Raises InputError for other bytes."""
        tree = decode(blob, _KIND)
        tree["contacts"] = Contacts(**tree["contacts"])
        tree["bonds"] = [Bond(**bond) for bond in tree["bonds"]]
        tree["ground"] = [tuple(item) for item in tree["ground"]]
        return cls(**tree)


@dataclass(frozen=True)
class Local:
    """A state, the derivative of one, or an event indicator.

    start, nominal : of a state. derivative_of : reference of the state.
    """

    name: str
    unit: str
    description: str
    start: float | None = None
    nominal: float | None = None
    derivative_of: int | None = None


@dataclass(frozen=True)
class Names:
    """All variables; their place is the value reference, those of ``table`` first.

    states : references in the order of the states. derivatives, indicators : first of consecutive references.
    """

    table: tuple[Variable, ...]
    locals: tuple[Local, ...]
    states: tuple[int, ...]
    derivatives: int
    indicators: int

    @property
    def count(self) -> int:
        """Number of all variables."""
        return len(self.table) + len(self.locals)

    def to_text(self) -> str:
        """Write the names as JSON."""
        rest = [asdict(local) for local in self.locals]
        places = [list(self.states), self.derivatives, self.indicators]
        return "\n".join([json.dumps(places), json.dumps(rest), table_text(self.table)])

    @classmethod
    def from_text(cls, text: str) -> Names:
        """Read the names that ``to_text`` wrote."""
        places, rest, table = text.split("\n", 2)
        states, derivatives, indicators = json.loads(places)
        rows = tuple(Local(**row) for row in json.loads(rest))
        return cls(table_from(table), rows, tuple(states), derivatives, indicators)
