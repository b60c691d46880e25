"""Substructures in time: how a class of identical substructures answers interface tractions, instant by instant."""

from .direct import DirectPropagator
from .model import Histories, LoadTerm, SubstructureModel

__all__ = ["DirectPropagator", "Histories", "LoadTerm", "SubstructureModel"]
