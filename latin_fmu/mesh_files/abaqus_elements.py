"""Element types of Abaqus and CalculiX: which are solids, which are faces, and what may not be left out."""

from __future__ import annotations

import re
from typing import Final

from .content import SHELLS, SOLIDS

_SOLID_NAME = re.compile(r"C3D(\d+)[A-Z]*")
# five unknowns a node: S8R5; STRI65 is a triangle of six nodes
_SHELL_NAME = re.compile(r"(?:CPS|CPE|CPEG|CAX|S|SAX|SCAX|M3D|SFM3D|R3D|DS|STRI)(\d+?)(?:[A-Z]*|R5|5)")
_SOLID_FAMILIES: Final = (
    *("C3D", "UC3D", "COH3D", "GK3D", "CCL", "SC6", "SC8", "CSS"),
    *("AC3D", "ACIN3D", "CIN3D", "DC3D", "DCC3D", "EC3D", "EMC3D", "Q3D", "PC3D", "F3D", "FC3D"),
)
"""First letters of the types that fill a volume: cohesive, acoustic, thermal, Eulerian, gasket, continuum shell, ..."""


def element_type(name: str) -> tuple[str, int] | None:
    """VTK name and number of nodes of an element type such as C3D8I or CPS6, None for what is neither."""
    name = name.upper()
    if (match := _SOLID_NAME.fullmatch(name)) and int(match[1]) in SOLIDS:
        return SOLIDS[int(match[1])], int(match[1])
    if (match := _SHELL_NAME.fullmatch(name)) is not None:
        count = int(match[1])
        if count in SHELLS:
            return (SHELLS[count], count)
        return None
    return None


def fills_volume(name: str) -> bool:
    """Whether a type that ``element_type`` does not know belongs to a family of solids."""
    return name.upper().startswith(_SOLID_FAMILIES)
