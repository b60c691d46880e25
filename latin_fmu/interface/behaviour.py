"""The contract of an interface behaviour.

An interface sees each side through one outgoing quantity, known after the linear stage,

    s = W - F / k        velocity the side would take if the interface exerted no traction,

and its search direction E+ gives ``W_hat = s + F_hat / k``. With z = 1/k the sum of both sides, the behaviour
at one instant is a relation between the relative free velocity ``s' - s`` and the traction on side E.
Components are those of the local frame (N, t1, t2), N from E to E'; a frictionless interface has N only.

Rules

1. Pure and vectorised over points: no mesh, no matrix, no time step, inputs unchanged.
2. ``local`` satisfies the relation and E+ to round-off; F_hat_E' = -F_hat_E is the solver's.
3. History enters as ``reach``. For unilateral contact it is the open gap at the start of the instant over dt, the
   velocity that would close it within the instant; ``rate`` is then 1/dt. An ``elastic`` behaviour sees the jump of
   displacement itself: with d = W_hat' - W_hat the time scheme makes the jump of the new instant

       [u] = (reach + d) / rate,   reach : (n_point, n_component), signed, the initial gap along N included.

4. A layer of stiffness k_l therefore acts as an added compliance ``rate / k_l``.
5. Parameters travel per point, (n_point, n_parameter), so that interfaces of one kind are solved together.
6. A ``compliant`` behaviour has a definite traction also where both sides are held (z = 0): it follows from the jumps
   alone, at the start of a run too. The others give no traction there.
7. ``local`` may be written in plain NumPy: the Python driver calls it. A behaviour with ``compiled = True`` has its law
   in ``kernels.laws`` under its name, and ``local`` applies it; the compiled driver needs that.
"""

from __future__ import annotations

from typing import ClassVar, Protocol, cast

import numpy as np
from numpy.typing import NDArray

Array = NDArray[np.float64]
Status = NDArray[np.int8]

SEPARATION, STICK, SLIP = 0, 1, 2


class Behaviour(Protocol):
    """Relation of one kind of interface (rules in the module docstring)."""

    name: ClassVar[str]
    opens: ClassVar[bool]  # has a gap and a contact status
    compliant: ClassVar[bool]  # traction known from the jumps of displacement and velocity (rule 6)
    elastic: ClassVar[bool]  # depends on the jump of displacement (rule 3)

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
        reach : (n_point,) open gap at the start of the instant / dt, m s-1; (n_point, n_component) where ``elastic``.
        rate : s-1, see rule 3. parameters : (n_point, n_parameter).

        Returns
        -------
        (n_point, n_component) F_hat on side E, Pa.
        """

    @staticmethod
    def status(traction: Array, parameters: Array) -> Status:
        """Separation 0, stick 1, slip 2 from F_hat; leading axes free, last one the components."""


class Layer(Behaviour, Protocol):
    """A behaviour that stores energy."""

    @staticmethod
    def stored_energy(traction: Array, parameters: Array) -> Array:
        """Elastic energy per area, J m-2, from F_hat; leading axes free, last one the components."""


def bonds(behaviour: Behaviour) -> bool:
    """Whether the sides keep one velocity."""
    return not (behaviour.opens or behaviour.compliant)


def as_layer(behaviour: Behaviour) -> Layer | None:
    """The behaviour where it stores energy, else None."""
    return cast(Layer, behaviour) if behaviour.elastic else None
