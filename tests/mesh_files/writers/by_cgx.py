"""CalculiX GraphiX: its own mesh of two boxes, as it sends meshes to CalculiX, and a deck that includes the files."""

from __future__ import annotations

import re
import subprocess
from pathlib import Path
from typing import Final

from .solid import Format, Solid

TITLE: Final = "cgx"
REQUIRES: Final = ("numpy",)
PROGRAM: Final = "cgx"
FORMATS: Final = {
    **{
        f".msh, {kind}": Format(".msh", bodies=False, faces=False, near=1e-6, own=True, option=kind)
        for kind in ("he8", "he20")
    },
    **{
        f".inp with .msh and .nam, {kind}": Format(".inp", near=1e-6, own=True, option=kind)
        for kind in ("he8", "he8i", "he8r", "he20", "he20r")
    },
}
SCRIPT: Final = """
pnt a1 0 0 0
seto left
seta left p a1
swep left lx tra 10 0 0 4
swep left ly tra 0 10 0 4
seta foot s left
swep left lz tra 0 0 20 8
setc left
pnt b1 15 0 0
seto right
seta right p b1
swep right rx tra 7 0 0 4
swep right ry tra 0 10 0 4
seta tip s right
swep right rz tra 0 0 10 4
setc right
elty left {kind}
elty right {kind}
mesh all
comp foot do
comp tip do
seta left e left
seta right e right
send all abq
send left abq nam
send right abq nam
send foot abq nam
send tip abq nam
quit
"""
DECK: Final = """*INCLUDE, INPUT=all.msh
*INCLUDE, INPUT=foot.nam
*INCLUDE, INPUT=tip.nam
*INCLUDE, INPUT=left.nam
*INCLUDE, INPUT=right.nam
*MATERIAL, NAME=steel
*ELASTIC
210e3, 0.3
*DENSITY
7.8e-9
*SOLID SECTION, ELSET=Eleft, MATERIAL=steel
*SOLID SECTION, ELSET=Eright, MATERIAL=steel
"""


def version() -> str:
    """Of the program, as its package has it."""
    said = subprocess.run(["dpkg-query", "-W", "calculix-cgx"], capture_output=True, text=True, check=False).stdout
    return re.split("[\t+]", said)[1]


def write(solid: Solid, form: Format, path: Path) -> None:  # noqa: ARG001 - the mesh is its own
    """The boxes in a format."""
    (path.parent / "boxes.fbd").write_text(SCRIPT.format(kind=form.option))
    subprocess.run(["cgx", "-bg", "boxes.fbd"], cwd=path.parent, check=True)
    mesh = path.parent / "all.msh"
    if form.suffix == ".msh":
        mesh.rename(path)
        return
    path.write_text(DECK)
