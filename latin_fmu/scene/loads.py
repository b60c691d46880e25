"""Table [load.NAME]: surface loads with a history in time."""

from __future__ import annotations

from typing import Annotated

from .fields import Face, Real, Table, Vector, about
from .laws import ConstantLaw, Law


class Load(Table):
    """A uniform load on a face, times a law. It has exactly one of `pressure` and `traction`.

    Loads on one face add up. A positive pressure p compresses: its traction is -p n, n the outward normal.
    """

    face: Annotated[Face, about('the loaded face, "substructure.face"')]
    pressure: Annotated[Real | None, about("pressure, positive in compression", "Pa")] = None
    traction: Annotated[Vector | None, about("traction along x, y, z", "Pa")] = None
    law: Annotated[Law, about("time law a(t)")] = ConstantLaw()
