"""Table [material.NAME]: what a substructure is made of."""

from __future__ import annotations

from typing import Annotated

from .fields import Real, Table, about


class Material(Table):
    """Homogeneous isotropic elastic material, with optional Rayleigh damping C = a M + b K."""

    young_modulus: Annotated[Real, about("Young's modulus E", "Pa", gt=0)]
    poisson_ratio: Annotated[Real, about("Poisson's ratio nu", "1", gt=-1, lt=0.5)]
    density: Annotated[Real, about("mass per unit volume rho", "kg m-3", gt=0)]
    rayleigh_mass: Annotated[Real, about("Rayleigh damping, share a of the mass", "s-1", ge=0)] = 0.0
    rayleigh_stiffness: Annotated[Real, about("Rayleigh damping, share b of the stiffness", "s", ge=0)] = 0.0
