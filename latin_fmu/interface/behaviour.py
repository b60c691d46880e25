"""The contract of an interface behaviour.

An interface sees each side through one outgoing quantity, known after the linear stage,

    s = W - F / k        velocity the side would take if the interface exerted no traction,

and its search direction E+ gives ``W_hat = s + F_hat / k``. With z = 1/k the sum of both sides, the behaviour
at one instant is a relation between the relative free velocity ``s' - s`` and the traction on side E.
Components are those of the local frame (N, t1, t2), N from E to E'; a frictionless interface has N only.

Rules

1. Pure and vectorised over points: no mesh, no matrix, no time step, inputs unchanged.
2. ``local`` satisfies the relation and E+ to round-off; F_hat_E' = -F_hat_E is the solver's.
3. History enters as ``reach``: the jump of displacement (gap along N) at the start of the instant, as the
   velocity that would close it within the instant. The time scheme supplies it.
4. A layer of stiffness k_l acts as an added compliance ``rate / k_l`` (``rate`` = 1/dt, from the scheme).
5. Parameters travel per point, (n_point, n_parameter), so that interfaces of one kind are solved together.
"""

from __future__ import annotations

from typing import ClassVar, Protocol

import numpy as np
from numpy.typing import NDArray

Array = NDArray[np.float64]
Status = NDArray[np.int8]

SEPARATION, STICK, SLIP = 0, 1, 2


class Behaviour(Protocol):
    """Relation of one kind of interface (rules in the module docstring)."""

    name: ClassVar[str]
    opens: ClassVar[bool]  # has a gap and a contact status

    @property
    def n_component(self) -> int:
        """Unknowns per point: 1 (normal only) or 3."""

    def point_parameters(self, n_point: int) -> Array:
        """Parameters per point, (n_point, n_parameter)."""

    @staticmethod
    def local(jump: Array, z: Array, reach: Array, rate: float, parameters: Array) -> Array:
        """Traction on side E that satisfies the behaviour.

        Parameters
        ----------
        jump : (n_point, n_component) relative free velocity s' - s, m s-1.
        z : (n_point, 2) sum of 1/k of both sides, normal and tangential, m3 N-1 s-1.
        reach : (n_point,) open gap at the start of the instant / dt, m s-1.
        rate : 1/dt, s-1. parameters : (n_point, n_parameter).

        Returns
        -------
        (n_point, n_component) F_hat on side E, Pa.
        """

    @staticmethod
    def status(traction: Array, parameters: Array) -> Status:
        """Separation 0, stick 1, slip 2 from F_hat; leading axes free, last one the components."""
