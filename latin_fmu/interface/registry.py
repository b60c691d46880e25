"""The registry of interface behaviours by name: a new behaviour is one class and one line here."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from types import MappingProxyType

from .behaviour import Behaviour
from .contact import Contact, NoSlip, SoftContact
from .joints import ElasticLayer, Perfect, ViscousJoint

BEHAVIOURS: Mapping[str, Callable[..., Behaviour]] = MappingProxyType(
    {
        "perfect": Perfect,
        "contact": Contact,
        "no_slip": NoSlip,
        "elastic_layer": ElasticLayer,
        "soft_contact": SoftContact,
        "viscous_joint": ViscousJoint,
    }
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
