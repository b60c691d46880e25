"""Geometry of interfaces (points, areas, normals, traces) and their behaviours, Eqs. (6), (7), (15)-(23)."""

from .behaviour import Behaviour, PointLaw
from .contact import Contact
from .geometry import InterfaceGeometry
from .joints import Perfect
from .registry import BEHAVIOURS, make_behaviour

__all__ = ["BEHAVIOURS", "Behaviour", "Contact", "InterfaceGeometry", "Perfect", "PointLaw", "make_behaviour"]
