"""Outputs of a co-simulation: resultants of interfaces, arrays of the table, contact events.

``kernels.outputs`` makes the rows of scalar outputs and follows the contact events.

Contact events are touch, separation and slip: how many there were, and the instant of the last one. An event belongs to
an interface as a whole and lies in the time step from t_(j-1) to t_j in which its state changes:

=============  ====================================  ===============================================================
event          state at t_(j-1), at t_j              instant, kept inside the time step
=============  ====================================  ===============================================================
touch          no point in contact, some             t_(j-1) + min over the points in contact at t_j of g / v
separation     some point in contact, none           t_(j-1) + N / (-dN/dt)
slip           some point in contact sticks, none    t_(j-1) + (q_j - q) / (dq/dt), q = |T| / N
=============  ====================================  ===============================================================

g is the gap at a point and v the speed at which it closes; N and T are the normal and the tangential resultant, and q_j
is on the friction cone. Values without index are those at t_(j-1), rates of N and q those over the time step before it.
Each instant is where a straight line reaches the state that the event begins: its error is of second order in the time
step where g, N or q are smooth before the event. Where the line does not reach it the instant is t_j.
"""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

import numpy as np

from ..latin.outcome import Array, InterfaceHistory
from .output_table import INTERFACE, FacePoints


def array_output(name: str, time: Array, interfaces: Mapping[str, InterfaceHistory], instant: int) -> Array:
    """An array of the variable table by name; empty where there is none.

    time, interfaces : instants and histories of the window. instant : index of the present instant in ``time``.
    """
    if name == "window.time":
        return time
    _, interface, group, quantity = name.split(".")
    if interface not in interfaces:
        return np.zeros(0)
    history = interfaces[interface]
    if group == "window":
        values: Any = INTERFACE.row(quantity).of
        return np.asarray(values(FacePoints.over(history)))
    field = getattr(history, "contact_status" if quantity == "status" else quantity)
    return np.zeros(0) if field is None else np.asarray(field[instant], dtype=float)
