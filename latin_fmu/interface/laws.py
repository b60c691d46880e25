"""Laws of interfaces: the contract of a behaviour, and the behaviours of the package by name.

A behaviour relates, at one instant and one point, the traction of an interface to the motion of its two sides. The
linear stage gives for each side the velocity without traction of the interface,

    s = W - F / k,

and the search direction E+ gives ``W_hat = s + F_hat / k``. With z = 1/k summed over both sides, the behaviour is a
relation between the relative free velocity ``s' - s`` and the traction on side E. Components are those of the local
frame (N, t1, t2), N from E to E'; a frictionless interface has N only.

Rules

1. Pure and vectorised over points: no mesh, no matrix, no time step, inputs unchanged.
2. ``local`` satisfies the relation and E+ to round-off; the solver sets F_hat_E' = -F_hat_E.
3. The state at the start of the instant enters as the normalised gap g, m s-1. For unilateral contact it is the open
   gap over dt, that is the velocity that closes it within the instant; ``rate`` is then 1/dt. For an ``elastic``
   behaviour it is the jump of displacement times ``rate``, shape (n_point, n_component), signed, the initial gap along
   N included: with d = W_hat' - W_hat the time scheme gives the jump of the new instant

       [u] = (g + d) / rate.

4. A layer of stiffness k_l therefore acts as an added compliance ``rate / k_l``.
5. Parameters are arrays per point, (n_point, n_parameter), so that interfaces of one class are solved together.
6. A ``compliant`` behaviour has a definite traction also where both sides are held (z = 0): it follows from the jumps
   alone, at the start of a run too. The others give no traction there.
7. ``local`` may be written in plain NumPy: the kernels call out for it, with all points of a group and on one thread. A
   behaviour with ``compiled = True`` has its law in ``laws`` under its name, and ``local`` applies it. ``PointLaw`` has
   defaults for both.
8. ``keeps`` says where the law fixes velocities only and the place of the sides follows from them: along N, where
   points are pressed or bonded, and along the face, where they stick. There the solver carries its own error of place
   along and makes it up (``kernels.local_stage``). A law that reads displacements needs none, one of velocities alone
   fixes none.

The laws themselves, with their formulas: ``laws``, one file each.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping
from types import MappingProxyType
from typing import ClassVar, Final, Protocol, cast

import numpy as np
from numpy.typing import NDArray

from ..laws.base import PointLaw
from ..laws.contact import Contact
from ..laws.dispatch import REGISTRY
from ..laws.no_slip import NoSlip
from ..laws.parts import SEPARATION, SLIP, STICK
from ..laws.perfect import Perfect, Rods

__all__ = [
    "BEHAVIOURS",
    "FRICTION",
    "SEPARATION",
    "SLIP",
    "STICK",
    "Behaviour",
    "Contact",
    "Layer",
    "NoSlip",
    "Perfect",
]
__all__ += ["PointLaw", "Rods", "as_layer", "bonds", "coulomb_coefficient"]

Array = NDArray[np.float64]
Status = NDArray[np.int8]


class Behaviour(Protocol):
    """Relation between traction and motion of the sides of an interface (rules in the module docstring)."""

    name: ClassVar[str]
    opens: ClassVar[bool]  # has a gap and a contact status
    compliant: ClassVar[bool]  # traction known from the jumps of displacement and velocity (rule 6)
    elastic: ClassVar[bool]  # depends on the jump of displacement (rule 3)
    keeps: ClassVar[tuple[bool, bool]]  # fixes the place of held points, along N and in the tangents (rule 8)

    @property
    def n_component(self) -> int:
        """Unknowns per point: 1 (normal only) or 3."""

    def point_parameters(self, n_point: int) -> Array:
        """Parameters per point, (n_point, n_parameter)."""

    def local(self, jump: Array, z: Array, normalised_gap: Array, rate: float, parameters: Array, /) -> Array:
        """Traction on side E that satisfies the behaviour.

        Parameters
        ----------
        jump : (n_point, n_component) relative free velocity s' - s, m s-1.
        z : (n_point, 2) sum of 1/k of both sides, normal and tangential, m3 N-1 s-1.
        normalised_gap : (n_point,), (n_point, n_component) where ``elastic``, m s-1, see rule 3.
        rate : s-1, see rule 3. parameters : (n_point, n_parameter).

        Returns
        -------
        (n_point, n_component) F_hat on side E, Pa.
        """

    def status(self, traction: Array, parameters: Array, /) -> Status:
        """Separation 0, stick 1, slip 2 from F_hat; leading axes free, last one the components."""


class Layer(Behaviour, Protocol):
    """A behaviour that stores energy."""

    def stored_energy(self, traction: Array, parameters: Array, /) -> Array:
        """Elastic energy per area, J m-2, from F_hat; leading axes free, last one the components."""


def bonds(behaviour: Behaviour) -> bool:
    """Whether the behaviour keeps the velocities of both sides equal."""
    return not (behaviour.opens or behaviour.compliant)


def as_layer(behaviour: Behaviour) -> Layer | None:
    """The behaviour as one that stores energy, None where it does not."""
    if behaviour.elastic:
        return cast(Layer, behaviour)
    return None


FRICTION: Final = "friction_coefficient"
"""Key of Coulomb's mu."""


def coulomb_coefficient(behaviour: Behaviour) -> float | None:
    """Coulomb's mu of a behaviour, also user-defined; 0 without friction, None where no mu P bounds the shear."""
    coefficient: float | None = getattr(behaviour, FRICTION, None) if getattr(behaviour, "coulomb", True) else None
    return coefficient


BEHAVIOURS: Mapping[str, Callable[..., Behaviour]] = MappingProxyType({law.name: law for law in REGISTRY})
"""The laws of the package, by the name that a scene has for them."""
