"""Interface behaviours by name: a new behaviour is one file and one line here."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from types import MappingProxyType

from .behaviour import Behaviour
from .contact import Contact
from .no_slip import NoSlip
from .perfect import Perfect

BEHAVIOURS: Mapping[str, Callable[..., Behaviour]] = MappingProxyType(
    {"perfect": Perfect, "contact": Contact, "no_slip": NoSlip}
)


def make_behaviour(name: str, parameters: Mapping[str, float]) -> Behaviour:
    """Behaviour ``name`` with its parameters.

    Raises
    ------
    KeyError : unknown name (the scene reader checks names first).
    """
    return BEHAVIOURS[name](**parameters)
