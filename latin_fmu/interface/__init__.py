"""Geometry of interfaces (points, areas, normals, traces) and their behaviours by name, Eqs. (6), (7), (15)-(23).

A new behaviour is one class, named here.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping
from types import MappingProxyType

from .behaviour import Behaviour, PointLaw
from .contact import Contact, NoSlip, SoftContact
from .geometry import InterfaceGeometry
from .joints import ElasticLayer, Perfect, Rods, ViscousJoint

__all__ = ["BEHAVIOURS", "Behaviour", "Contact", "InterfaceGeometry", "Perfect", "PointLaw", "Rods"]

BEHAVIOURS: Mapping[str, Callable[..., Behaviour]] = MappingProxyType(
    {law.name: law for law in (Perfect, Contact, NoSlip, ElasticLayer, SoftContact, ViscousJoint)}
)
