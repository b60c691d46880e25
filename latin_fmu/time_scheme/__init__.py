"""Time schemes by name, Eqs. (9)-(11): a new scheme is one class and one line here."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from types import MappingProxyType

from .central_difference import CentralDifference
from .implicit import HHT, MasslessContact, Newmark, QuasiStatic
from .scheme import TimeScheme

__all__ = ["HHT", "SCHEMES", "CentralDifference", "Newmark", "QuasiStatic", "TimeScheme"]

SCHEMES: Mapping[str, Callable[..., TimeScheme]] = MappingProxyType(
    {"hht": HHT, "newmark": Newmark, "massless_contact": MasslessContact, "central_difference": CentralDifference}
)
