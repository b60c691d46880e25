"""Maxwell joint, a spring with a dashpot in series, both per area:

    F_hat.N = k_n e.N,   F_hat_t = k_t e_t   on side E,      e' = [u]' - e / tau,

e the elongation of the spring, [u] = u' - u the jump of displacement and tau the relaxation time. Side by side with an
elastic layer it is the standard linear solid. With the trapezoidal rule of ``time_scheme.maxwell`` the elongation that
acts in a step is, with the weights of the time scheme for the old and the new instant,

    e = (w_old + w_new c_e) e_old + c_u ([u]_w - [u]_old),

so that it is an elastic layer of the stiffness c_u k whose jump starts from [u]_old - (w_old + w_new c_e) / c_u e_old
(``kernels.local_stage.read_gaps``). Relaxed at the start, and always without inertia.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import ClassVar

import numpy as np

from ..compiled import kernel
from .base import Array, PointLaw
from .parts import PointState, Unknowns, add_unknown, always_stick


@kernel
def value(point: PointState, traction: Array) -> None:
    """F_hat = c_u k (s' - s + reach) / (rate + c_u k z), parameters k_n, k_t, tau and c_u."""
    for i in range(len(point.jump)):
        stiffness = point.parameters[3] * point.parameters[min(i, 1)]
        traction[i] = stiffness * (point.jump[i] + point.reach[i]) / (point.rate + stiffness * point.z[min(i, 1)])


@kernel
def tangent(point: PointState, unknowns: Unknowns) -> int:
    """One unknown for each component in which the joint has a stiffness."""
    count = 0
    for i in range(len(point.jump)):
        stiffness = point.parameters[3] * point.parameters[min(i, 1)]
        if stiffness > 0.0:
            count = add_unknown(count, i, point.rate / stiffness, unknowns)
    return count


@dataclass(frozen=True)
class MaxwellJoint(PointLaw):
    """Springs with dashpots in series between the sides.

    Attributes
    ----------
    normal_stiffness, tangential_stiffness : per area, N m-3. relaxation_time : tau, s. share : c_u of the step, 0
        without inertia (``in_step``).
    """

    normal_stiffness: float = 0.0
    tangential_stiffness: float = 0.0
    relaxation_time: float = 1.0
    share: float = 1.0
    name: ClassVar[str] = "maxwell_joint"
    compliant: ClassVar[bool] = True
    elastic: ClassVar[bool] = True
    keeps: ClassVar[tuple[bool, bool]] = (False, False)
    tangential: ClassVar[str] = "tangential_stiffness"
    value = staticmethod(value)
    tangent = staticmethod(tangent)
    point_status = staticmethod(always_stick)

    def in_step(self, share: float) -> MaxwellJoint:
        """The joint in a march with this c_u."""
        return replace(self, share=share)

    @staticmethod
    def stored_energy(traction: Array, parameters: Array) -> Array:
        """F.e / 2 per area, J m-2: that of the springs."""
        stiffness = parameters[:, [0, *[1] * (traction.shape[-1] - 1)]]
        flexibility = np.divide(1.0, stiffness, out=np.zeros_like(stiffness), where=stiffness > 0)
        energy: Array = 0.5 * (flexibility * traction**2).sum(axis=-1)
        return energy
