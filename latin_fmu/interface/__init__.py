"""Geometry of interfaces (points, areas, normals, traces) and their laws, Eqs. (6), (7), (15)-(23)."""

from __future__ import annotations

from .geometry import InterfaceGeometry
from .laws import BEHAVIOURS, Behaviour, Contact, Perfect, PointLaw, Rods

__all__ = ["BEHAVIOURS", "Behaviour", "Contact", "InterfaceGeometry", "Perfect", "PointLaw", "Rods"]
