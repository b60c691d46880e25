"""Table [substructure.NAME]: a body, its shape, its material and its initial state."""

from __future__ import annotations

import math
from typing import Annotated

from pydantic import AfterValidator, BeforeValidator

from .fields import Flag, Name, Positive, PositiveCount, Real, Table, Text, Vector, _as_list, about, refusal

BOX_FACES = ("xmin", "xmax", "ymin", "ymax", "zmin", "zmax")
MAX_ELEMENTS = 20_000_000


def _check_amount(elements: tuple[int, int, int]) -> tuple[int, int, int]:
    if math.prod(elements) > MAX_ELEMENTS:
        raise refusal("too many elements", value=elements, allowed=f"at most {MAX_ELEMENTS} in one substructure")
    return elements


Sizes = Annotated[tuple[Positive, Positive, Positive], BeforeValidator(_as_list)]
Elements = Annotated[
    tuple[PositiveCount, PositiveCount, PositiveCount], BeforeValidator(_as_list), AfterValidator(_check_amount)
]


class Box(Table):
    """A box along the axes, cut into 8-node hexahedra; its faces are xmin xmax ymin ymax zmin zmax."""

    origin: Annotated[Vector, about("corner with the smallest coordinates", "m")] = (0.0, 0.0, 0.0)
    size: Annotated[Sizes, about("lengths along x, y, z", "m")]
    elements: Annotated[Elements, about("number of elements along x, y, z (20 million in all at most)", "1")]


class MeshFile(Table):
    """A mesh read from a file (hexahedra of 8, 20 or 27 nodes, tetrahedra of 4 or 10, wedges of 6, also mixed); its
    faces are the named surface groups of the file."""

    file: Annotated[Text, about("mesh file, relative to the scene file (.msh, .inp, .bdf, .e, .vtu, .med ...)")]
    group: Annotated[Text | None, about("named volume group to take; the whole file where left out")] = None
    scale: Annotated[Real, about("length of one file unit (1e-3 for a mesh in mm)", "m", gt=0)] = 1.0


class Substructure(Table):
    """An elastic body, or a rigid one. It has exactly one of `box` and `mesh`."""

    material: Annotated[Name, about("name of a [material.NAME] table")]
    box: Annotated[Box | None, about("a box meshed by the program")] = None
    mesh: Annotated[MeshFile | None, about("a mesh read from a file")] = None
    rigid: Annotated[
        Flag, about("undeformable: six unknowns (small rotations about the mass centre), no stiffness")
    ] = False
    bending_modes: Annotated[
        Flag, about("8-node hexahedra bend as they should: incompatible modes, eliminated inside each element")
    ] = False
    initial_velocity: Annotated[Vector, about("uniform velocity at t = 0", "m s-1")] = (0.0, 0.0, 0.0)
    initial_spin: Annotated[
        Vector, about("angular velocity at t = 0, about the mass centre (small rotations)", "rad s-1")
    ] = (0.0, 0.0, 0.0)
    initial_displacement: Annotated[Vector, about("uniform displacement at t = 0", "m")] = (0.0, 0.0, 0.0)
    body_force: Annotated[Vector, about("force per unit volume, constant in time", "N m-3")] = (0.0, 0.0, 0.0)
