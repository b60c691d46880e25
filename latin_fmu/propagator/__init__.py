"""Response in time of a class of identical substructures to loads and interface tractions."""

from .base import Propagator
from .direct import DirectPropagator
from .model import Histories, LoadTerm, SubstructureModel
from .static import StaticPropagator

__all__ = ["DirectPropagator", "Histories", "LoadTerm", "Propagator", "StaticPropagator", "SubstructureModel"]
