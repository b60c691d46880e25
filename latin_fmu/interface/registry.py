"""The registry of interface behaviours by name: a new behaviour is one class, named here."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from types import MappingProxyType

from .behaviour import Behaviour
from .contact import Contact, NoSlip, SoftContact
from .joints import ElasticLayer, Perfect, ViscousJoint

BEHAVIOURS: Mapping[str, Callable[..., Behaviour]] = MappingProxyType(
    {law.name: law for law in (Perfect, Contact, NoSlip, ElasticLayer, SoftContact, ViscousJoint)}
)


def opens(name: str) -> bool:
    """Whether interfaces of the behaviour ``name`` may open (they have a gap and a contact status)."""
    return bool(getattr(BEHAVIOURS[name], "opens"))  # noqa: B009, a class variable of every entry


def make_behaviour(name: str, parameters: Mapping[str, float]) -> Behaviour:
    """Behaviour ``name`` with its parameters.

    Raises
    ------
    KeyError : unknown name (the scene reader checks names first).
    """
    return BEHAVIOURS[name](**parameters)
