"""Response in time of a class of identical substructures to loads and interface tractions.

A reduced propagator has modes of one substructure. The march by modes of the whole assembly, with its cut-off
frequency, is in ``joined`` (``reduced_assembly``, ``reduced_run``).

========================================  =============================================================================
base, model, forcing                      what all share; matrices of a substructure; loads and prescribed motions
direct, explicit, static                  by factors or conjugate gradients, central differences, without inertia
stable_step                               longest step of the explicit one
reduced, reduction                        by modes of a substructure and its static responses
vibration, lanczos                        modes of free dofs
interface_matrices, patches               dense matrices of interfaces, in patches
interface_sweeps, interface_probing       large interfaces: substitution through the factor, sparse tables
image, layout, class_record               the memory of a run for the kernels
========================================  =============================================================================
"""

from .base import Propagator
from .direct import DirectPropagator
from .model import Histories, LoadTerm, SubstructureModel
from .static import StaticPropagator

__all__ = ["DirectPropagator", "Histories", "LoadTerm", "Propagator", "StaticPropagator", "SubstructureModel"]
