"""Time schemes by name: a new scheme is one file and one line here."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from types import MappingProxyType

from .central_difference import CentralDifference
from .hht import HHT, Newmark
from .massless import MasslessContact
from .scheme import TimeScheme

SCHEMES: Mapping[str, Callable[..., TimeScheme]] = MappingProxyType(
    {"hht": HHT, "newmark": Newmark, "massless_contact": MasslessContact, "central_difference": CentralDifference}
)


def make_scheme(name: str, parameters: Mapping[str, float]) -> TimeScheme:
    """Scheme ``name`` with its parameters (alpha; beta and gamma).

    Raises
    ------
    KeyError : unknown name (the scene reader checks names first).
    """
    return SCHEMES[name](**parameters)
