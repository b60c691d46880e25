"""Response in time of a class of identical substructures to loads and interface tractions."""

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
