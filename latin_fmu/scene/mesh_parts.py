"""Table [mesh.NAME]: one file with many parts, written out as one [substructure.PART] for each of them.

The parts that a scene says nothing else about need no table of their own; a table [substructure.PART] holds what
differs. The reader of scenes does it; the effective scene has substructures only.
"""

from __future__ import annotations

import re
from typing import Annotated

from pydantic import BeforeValidator, Field

from .fields import GROUND, Name, Real, Table, Text, _as_list, about, refusal

ALL = "*"


def _all_or_listed(value: object) -> object:
    if isinstance(value, str) and value != ALL:
        raise refusal(
            "must be a list of volume groups, or all of them", value=value, allowed='"*", or e.g. ["bolt", "nut"]'
        )
    return (ALL,) if value == ALL else _as_list(value)


class MeshParts(Table):
    """A mesh file with several parts: every volume group, or each group listed, becomes a substructure of its name."""

    file: Annotated[Text, about("mesh file, relative to the scene file (.msh, .inp, .bdf, .e, .vtu, .med ...)")]
    scale: Annotated[Real, about("length of one file unit (1e-3 for a mesh in mm)", "m", gt=0)] = 1.0
    parts: Annotated[
        tuple[Text, ...],
        BeforeValidator(_all_or_listed),
        about('volume groups that become substructures; "*": all of them that share the cells out'),
        Field(min_length=1),
    ] = (ALL,)
    material: Annotated[Name | None, about("material of the parts whose [substructure.PART] names none")] = None


def part_name(group: str) -> str:
    """Name of the substructure made of a volume group: what no name may hold becomes an underscore."""
    name = re.sub("[^A-Za-z0-9_]", "_", group)
    if not name[:1].isalpha():
        name = f"part_{name}"
    return f"{name}_" if name == GROUND else name[:100]
