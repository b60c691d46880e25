"""What a law of an interface declares: its kernels, its parameters, and what the solver has to know of it."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any, ClassVar

import numpy as np
from numpy.typing import NDArray

from .parts import STICK

Array = NDArray[np.float64]
Status = NDArray[np.int8]


class PointLaw:
    """Base of behaviours: frozen dataclasses whose fields are the parameters of the law.

    A law of the package has three kernels, ``value``, ``tangent`` and ``point_status`` (arguments: ``dispatch``),
    and a place in ``dispatch.REGISTRY``. A law in NumPy overrides ``local`` and sets ``compiled = False``; its
    points stick unless it overrides ``status``.
    """

    name: ClassVar[str]
    value: ClassVar[Callable[..., Any]]
    tangent: ClassVar[Callable[..., Any]]
    point_status: ClassVar[Callable[..., Any]]
    tractions_of: ClassVar[Callable[..., Array]]  # both set by ``dispatch``
    statuses_of: ClassVar[Callable[..., Status]]
    compiled: ClassVar[bool] = True
    opens: ClassVar[bool] = False
    compliant: ClassVar[bool] = False
    elastic: ClassVar[bool] = False
    keeps: ClassVar[tuple[bool, bool]] = (True, True)
    coulomb: ClassVar[bool] = True  # mu P bounds the shear, where there is a ``friction_coefficient`` mu
    tangential: ClassVar[str] = ""  # parameter without which the points have no tangential unknowns

    @property
    def n_component(self) -> int:
        """3; 1 where the parameter named by ``tangential`` is zero."""
        return 3 if not self.tangential or getattr(self, self.tangential) > 0 else 1

    def point_parameters(self, n_point: int) -> Array:
        """Fields of the dataclass in their order, (n_point, n_parameter)."""
        return np.tile(np.array([*vars(self).values()], dtype=float), (n_point, 1))

    @classmethod
    def local(cls, jump: Array, z: Array, normalised_gap: Array, rate: float, parameters: Array) -> Array:
        """F_hat on side E, the explicit solution per point (``interface.laws.Behaviour.local``)."""
        return cls.tractions_of(cls.name, jump, z, normalised_gap, rate, parameters)

    @classmethod
    def status(cls, traction: Array, parameters: Array) -> Status:
        """Separation 0, stick 1, slip 2 from F_hat; leading axes free, last one the components."""
        if not cls.compiled:
            return np.full(traction.shape[:-1], STICK, dtype=np.int8)
        return cls.statuses_of(cls.name, traction, parameters)
