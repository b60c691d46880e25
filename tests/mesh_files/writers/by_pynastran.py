"""pyNastran: a property of solids for each body, of shells for each face."""

from __future__ import annotations

from pathlib import Path
from typing import Any, Final

from pyNastran.bdf.bdf import BDF

from .solid import Format, Solid

TITLE: Final = "pyNastran"
REQUIRES: Final = ("pyNastran==1.4.1", "numpy<2")
PACKAGE: Final = "pyNastran"
_CARDS: Final = {
    **{"tetra": "CTETRA", "tetra10": "CTETRA", "hexahedron": "CHEXA", "hexahedron20": "CHEXA", "wedge": "CPENTA"},
    **{"wedge15": "CPENTA", "pyramid": "CPYRAM", "pyramid13": "CPYRAM", "triangle": "CTRIA3", "quad": "CQUAD4"},
    **{"triangle6": "CTRIA6", "quad8": "CQUAD8"},
}
FORMATS: Final = {
    ".bdf, short fields": Format(".bdf", near=1e-3, option={"size": 8}),
    ".bdf, long fields": Format(".bdf", near=1e-7, option={"size": 16}),
    ".bdf, double": Format(".bdf", option={"size": 16, "is_double": True}),
    ".bdf, long, faces by SPC1": Format(".bdf", near=1e-7, option={"size": 16, "spc": True}),
}


def write(solid: Solid, form: Format, path: Path) -> None:
    """The solid in a format."""
    option: dict[str, Any] = dict(form.option)
    by_nodes = option.pop("spc", False)
    model = BDF(debug=None, log=None)
    for i, place in enumerate(solid.points, 1):
        model.add_grid(i, place)
    model.add_mat1(1, 210e3, None, 0.3, rho=7.8e-9)
    for name, mark in solid.marks().items():
        if name in solid.bodies:
            model.add_psolid(mark, 1, comment=name)
        elif by_nodes:
            model.add_spc1(mark, "123", (solid.nodes_of(name) + 1).tolist(), comment=name)
        else:
            model.add_pshell(mark, mid1=1, t=0.1, comment=name)
    number = 0
    for kind, rows, name in solid.rows("vertical first", flat=not by_nodes):
        for row in (rows + 1).tolist():
            number += 1
            model.add_card([_CARDS[kind], number, solid.marks()[name], *row], _CARDS[kind])
    model.write_bdf(str(path), **option)
