"""Time schemes by name, Eqs. (9)-(11): a new scheme is one class and one line here."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from types import MappingProxyType

from .implicit import HHT, GeneralizedAlpha, MasslessContact, Newmark, QuasiStatic
from .maxwell import NO_BRANCHES, MaxwellBranches, joint_weights
from .scheme import CentralDifference, TimeScheme

__all__ = [
    "HHT",
    "NO_BRANCHES",
    "SCHEMES",
    "CentralDifference",
    "GeneralizedAlpha",
    "MasslessContact",
    "MaxwellBranches",
    "Newmark",
    "QuasiStatic",
    "TimeScheme",
    "joint_weights",
]

SCHEMES: Mapping[str, Callable[..., TimeScheme]] = MappingProxyType(
    {
        "generalized_alpha": GeneralizedAlpha,
        "hht": HHT,
        "newmark": Newmark,
        "massless_contact": MasslessContact,
        "central_difference": CentralDifference,
    }
)
