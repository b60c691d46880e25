"""Numbers read off the history of one interface: peaks, contact instants, shares of its area.

Pure functions of plain arrays. ``InterfaceFields`` is what they need; it is made from a solver history or
from a stored group, so that a file and a fresh solution give the same numbers.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray

from ..latin.record import Array, InterfaceHistory

if TYPE_CHECKING:
    import xarray as xr

CONTACT_SHARE = 0.01
"""Share of its peak the normal resultant must exceed for an interface to count as in contact."""

ROUND_OFF = 1e-9
"""A normal resultant below this share of the largest sum of area x |traction| is round-off, not contact."""

SEPARATION, STICK, SLIP = 0, 1, 2


@dataclass(frozen=True)
class InterfaceFields:
    """Local-stage fields of one interface.

    Attributes
    ----------
    time : (n_time,), s. areas : (n_point,), m2. normals : (n_point, 3), unit, from E to E'.
    traction : (n_time, n_point, 3), what the interface exerts on side E, Pa.
    contact_status : (n_time, n_point), separation 0, stick 1, slip 2; None where it cannot open.
    """

    time: Array
    areas: Array
    normals: Array
    traction: Array
    contact_status: NDArray[np.int8] | None

    @classmethod
    def of_history(cls, history: InterfaceHistory, time: Array) -> InterfaceFields:
        """Fields of a solver history over the run's instants ``time`` (n_time,), s."""
        return cls(time, history.areas, history.normals, history.traction, history.contact_status)

    @classmethod
    def of_dataset(cls, dataset: xr.Dataset) -> InterfaceFields:
        """Fields of a stored group ``interfaces/<name>``."""
        status = dataset["contact_status"].values if "contact_status" in dataset else None
        columns = (dataset[name].values for name in ("time", "area", "normal", "traction"))
        time, areas, normals, traction = (np.asarray(values, dtype=float) for values in columns)
        return cls(time, areas, normals, traction, status)


def normal_resultant(fields: InterfaceFields) -> Array:
    """Resultant along the normals, (n_time,), N, positive in compression."""
    resultant: Array = -np.einsum("p,tpc,pc->t", fields.areas, fields.traction, fields.normals)
    return resultant


def friction_resultant(fields: InterfaceFields) -> Array:
    """Magnitude of the resultant of the tangential tractions, (n_time,), N."""
    along = np.einsum("tpc,pc->tp", fields.traction, fields.normals)
    tangential = np.einsum("p,tpc->tc", fields.areas, fields.traction)
    tangential -= np.einsum("p,tp,pc->tc", fields.areas, along, fields.normals)
    length: Array = np.linalg.norm(tangential, axis=1)
    return length


def friction_sum(fields: InterfaceFields) -> Array:
    """Sum of the magnitudes of the friction forces of all points, (n_time,), N.

    Unlike the resultant it does not cancel where a body spreads in all directions.
    """
    along = np.einsum("tpc,pc->tp", fields.traction, fields.normals)
    tangential = fields.traction - along[:, :, None] * fields.normals
    total: Array = np.linalg.norm(tangential, axis=2) @ fields.areas
    return total


def peak_force(fields: InterfaceFields) -> float:
    """Largest magnitude of the normal resultant over time, N."""
    return float(np.abs(normal_resultant(fields)).max(initial=0.0))


def first_contact_time(fields: InterfaceFields) -> float | None:
    """First instant at which the normal resultant exceeds 1 % of its peak, s; None if never."""
    instants = _loaded_instants(fields)
    return float(fields.time[instants[0]]) if instants.size else None


def separation_time(fields: InterfaceFields) -> float | None:
    """Last instant at which the normal resultant exceeds 1 % of its peak, s; None if never.

    Equal to the end of the run for an interface still loaded there.
    """
    instants = _loaded_instants(fields)
    return float(fields.time[instants[-1]]) if instants.size else None


def _loaded_instants(fields: InterfaceFields) -> NDArray[np.intp]:
    force = np.abs(normal_resultant(fields))
    peak = force.max(initial=0.0)
    everything = np.einsum("p,tp->t", fields.areas, np.linalg.norm(fields.traction, axis=2))
    if peak <= ROUND_OFF * everything.max(initial=0.0):
        return np.empty(0, dtype=np.intp)
    return np.flatnonzero(force > CONTACT_SHARE * peak)


def status_shares(fields: InterfaceFields) -> Array:
    """Share of the area in separation, stick and slip, (n_time, 3); rows add up to 1.

    Raises ``ValueError`` for an interface that cannot open (no contact status).
    """
    if fields.contact_status is None:
        raise ValueError("this interface has no contact status: it cannot open")
    share = fields.areas / fields.areas.sum()
    states = (SEPARATION, STICK, SLIP)
    return np.stack([(fields.contact_status == state) @ share for state in states], axis=1)


def largest_slip_share(fields: InterfaceFields) -> float | None:
    """Largest share of the area that slips at one instant; None for an interface that cannot open."""
    if fields.contact_status is None:
        return None
    return float(status_shares(fields)[:, SLIP].max(initial=0.0))
