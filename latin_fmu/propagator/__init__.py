"""Substructures in time: how a class of identical substructures answers interface tractions, instant by instant."""

from .base import Propagator
from .direct import DirectPropagator
from .model import Histories, LoadTerm, SubstructureModel
from .registry import PROPAGATORS, PropagatorSettings, make_propagator
from .static import StaticPropagator

__all__ = [
    "PROPAGATORS",
    "DirectPropagator",
    "Histories",
    "LoadTerm",
    "Propagator",
    "PropagatorSettings",
    "StaticPropagator",
    "SubstructureModel",
    "make_propagator",
]
