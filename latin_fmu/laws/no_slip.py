"""Contact without slip.

The normal law is that of contact. Tangentially a point that is closed at the start of the instant does not slide within
the instant, pressed or not; a point that closes within the instant slides freely until it has closed:

    F_hat_t = G   where the gap at the start is at most ``touch``,   else 0

``touch`` is round-off of a distance. A point that was pressed at the end of the instant before is closed, too, whatever
gap the time scheme leaves it: the local stage hands it to the law with the gap 0 (``kernels.local_stage``). Whether a
point is closed thus depends on this point alone, and on no load elsewhere. It is the limit of Coulomb's law for
mu -> infinity that stays solvable: the closure of Coulomb's cone is the half space P >= 0, shear without pressure
belongs to it. Stick then depends on the past only, the problem of the instant is convex and the iteration converges,
where a very large friction coefficient (stick from the smallest pressure on) may not. The status follows the traction:
stick wherever there is any, separation only where there is none.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import ClassVar

from ..compiled import kernel
from .base import Array, PointLaw
from .parts import SEPARATION, STICK, PointState, Unknowns, add_unknown, sticking


@kernel
def value(point: PointState, traction: Array) -> None:
    """P as in contact; held along the face while the gap at the start of the instant is below the parameter, m."""
    closing = -(point.jump[0] + point.reach[0])
    traction[0] = -closing / point.z[0] if closing > 0.0 and point.z[0] > 0.0 else 0.0
    # reach is the gap times ``rate``
    stick = point.reach[0] <= point.rate * point.parameters[0] and point.z[1] > 0.0
    for i in range(1, len(point.jump)):
        # no bound by the pressure: shear at a point without pressure belongs to this law
        traction[i] = point.jump[i] / point.z[1] if stick else 0.0


@kernel
def tangent(point: PointState, unknowns: Unknowns) -> int:
    """The pressure of a pressed point, and the shear of a held one."""
    count = 0
    if -(point.jump[0] + point.reach[0]) > 0.0 and point.z[0] > 0.0:
        count = add_unknown(0, 0, unknowns.proximal * point.z[0], unknowns)
    if len(point.jump) > 1 and point.z[1] > 0.0 and point.reach[0] <= point.rate * point.parameters[0]:
        count = sticking(count, unknowns.proximal * point.z[1], unknowns)
    return count


@kernel
def point_status(traction: Array, parameters: Array, no_contact: float) -> int:
    """Stick where there is a pressure or a shear above ``no_contact``, else separation."""
    carried = -traction[0]
    for i in range(1, len(traction)):
        carried = max(carried, abs(traction[i]))
    return STICK if carried > no_contact else SEPARATION


@dataclass(frozen=True)
class NoSlip(PointLaw):
    """Contact of surfaces that never slide on each other; ``touch`` : gap that counts as closed, m."""

    touch: float = 0.0
    name: ClassVar[str] = "no_slip"
    opens: ClassVar[bool] = True
    value = staticmethod(value)
    tangent = staticmethod(tangent)
    point_status = staticmethod(point_status)
