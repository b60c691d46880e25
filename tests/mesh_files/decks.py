"""Small meshes written as decks, by hand and without any library."""

from __future__ import annotations

from pathlib import Path

import numpy as np

from latin_fmu.fem.mesh import Mesh, box_mesh
from latin_fmu.fem.mesh_file import mesh_of
from latin_fmu.mesh_files.content import Array, Index
from latin_fmu.mesh_files.reading import read_content

# Boundary faces of a unit box by the labels of a C3D8 with VTK order of nodes (Abaqus: S1 is nodes 1-2-3-4, ...)
LABEL_OF = {"zmin": "S1", "zmax": "S2", "ymin": "S3", "xmax": "S4", "ymax": "S5", "xmin": "S6"}


def cube() -> Mesh:
    """2 x 2 x 2 hexahedra on the unit cube moved to (1, 2, 3)."""
    return box_mesh(np.array([1.0, 2.0, 3.0]), np.ones(3), (2, 2, 2))


def node_rows(nodes: Array, first: int = 1) -> str:
    """Data lines of *NODE."""
    return "".join(f"{first + i}, {x!r}, {y!r}, {z!r}\n" for i, (x, y, z) in enumerate(nodes.tolist()))


def element_rows(cells: Index, first: int = 1, shift: int = 1) -> str:
    """Data lines of *ELEMENT; ``shift`` is the label of node 0."""
    return "".join(
        f"{first + i}, " + ", ".join(str(n + shift) for n in cell) + "\n" for i, cell in enumerate(cells.tolist())
    )


def layer(mesh: Mesh, face: str) -> list[int]:
    """Labels of the cells of a box that touch a face."""
    wanted = set(np.unique(mesh.faces[face].blocks[0].facets).tolist())
    return [i + 1 for i, cell in enumerate(mesh.blocks[0].cells.tolist()) if len(wanted & set(cell)) == 4]


def surfaces_deck() -> str:
    """The cube with the faces of the box as surfaces of element faces, by sets and by single elements."""
    mesh = cube()
    text = "*HEADING\n a cube\n** comment\n*NODE, NSET=NALL\n" + node_rows(mesh.nodes)
    text += "*ELEMENT, TYPE=C3D8I, ELSET=part\n" + element_rows(mesh.blocks[0].cells)
    for face, label in LABEL_OF.items():
        labels = layer(mesh, face)
        if face in ("zmin", "xmax"):
            rows = "".join(f"{n}, {label}\n" for n in labels)
        else:
            rows = f"_{face}, {label}\n"
            text += f"*ELSET, ELSET=_{face}, INTERNAL\n" + ", ".join(map(str, labels)) + ",\n"
        text += f"*SURFACE, NAME={face}, TYPE=ELEMENT\n{rows}"
    return text


def instances_deck() -> str:
    """A bar of two cells used twice, the second turned by 90 degrees about z through (1, 0, 0) and lifted by 2."""
    mesh = box_mesh(np.zeros(3), np.array([2.0, 1.0, 1.0]), (2, 1, 1))
    return (
        "*PART, NAME=Bar\n*NODE\n"
        + node_rows(mesh.nodes)
        + "*ELEMENT, TYPE=C3D8R\n"
        + element_rows(mesh.blocks[0].cells)
        + "*ELSET, ELSET=all, GENERATE\n1, 2, 1\n*NSET, NSET=End, GENERATE\n3, 12, 3\n"
        + "*SURFACE, NAME=Top\nall, S2\n*SOLID SECTION, ELSET=all, MATERIAL=steel\n*END PART\n"
        + "*ASSEMBLY, NAME=A\n*INSTANCE, NAME=Bar-1, PART=Bar\n*END INSTANCE\n"
        + "*INSTANCE, NAME=Bar-2, PART=Bar\n0., 0., 2.\n1., 0., 2., 1., 0., 3., 90.\n*END INSTANCE\n"
        + "*NSET, NSET=Both, INSTANCE=Bar-1\nEnd\n*NSET, NSET=Both, INSTANCE=BAR-2\n1\n"
        + "*ELSET, ELSET=_left, INTERNAL, INSTANCE=Bar-2\n1,\n*SURFACE, NAME=Left, TYPE=ELEMENT\n_left, S6\n"
        + "*SURFACE, NAME=Direct\nBar-2.all, S1\nBar-1.1, S6\n*END ASSEMBLY\n"
    )


def nastran_small(nodes: Array) -> str:
    """GRID entries in fields of eight characters."""
    return "".join(
        f"GRID    {i + 1:<8d}        {x:<8.5g}{y:<8.5g}{z:<8.5g}\n" for i, (x, y, z) in enumerate(nodes.tolist())
    )


def nastran_deck() -> str:
    """The cube as property 7, one face of shells as property 8, in small and free fields, without BEGIN BULK."""
    mesh = cube()
    text = "$ bulk only\n" + nastran_small(mesh.nodes)
    for i, cell in enumerate((mesh.blocks[0].cells + 1).tolist()):
        text += f"CHEXA   {i + 1:<8d}7       " + "".join(f"{n:<8d}" for n in cell[:6]) + f"+C{i}\n"
        text += f"+C{i}".ljust(8) + "".join(f"{n:<8d}" for n in cell[6:]) + "\n"
    for i, facet in enumerate((mesh.faces["zmax"].blocks[0].facets + 1).tolist()):
        text += f"CQUAD4,{100 + i},8," + ",".join(map(str, facet)) + "\n"
    return text + "PSOLID,7,1\nPSHELL,8,1,0.1\nSPC1,3,123,1,THRU,9\n"


def read_mesh(path: Path, group: str | None = None, scale: float = 1.0) -> Mesh:
    """Mesh of one volume group of a mesh file."""
    content = read_content(path)
    content.refuse()
    return mesh_of(content, path.name, group, scale)


def keywords_deck() -> str:
    """A slab made of its corners, placed in a cylindrical system, with supports, a tie and a clearance."""
    return (
        "*SYSTEM\n1., 2., 3., 1., 2., 4.\n1., 3., 3.\n*NODE, SYSTEM=C\n1, 1., 0., 0.\n5, 5., 0., 0.\n21, 1., 20., 0.\n"
        "25, 5., 20., 0.\n*SYSTEM\n*NGEN, NSET=front\n1, 5\n*NGEN, NSET=back\n21, 25, 1\n"
        "*NFILL, NSET=floor\nfront, back, 2, 10\n*NCOPY, CHANGE NUMBER=100, OLD SET=floor, SHIFT, NEW SET=roof\n"
        "0., 1., 0.\n0., 0., 0., 0., 0., 1., 5.\n*ELEMENT, TYPE=C3D8, ELSET=slab\n1, 1, 2, 12, 11, 101, 102, 112, 111\n"
        "*ELGEN, ELSET=slab\n1, 4, 1, 1, 2, 10, 10\n*ELEMENT, TYPE=B31, ELSET=links\n90, 1, 2\n"
        "*ELCOPY, ELEMENT SHIFT=500, OLD SET=slab, SHIFT NODES=0, NEW SET=copy\n*NSET, NSET=all, ELSET=slab\n"
        "*TRANSFORM, NSET=front, TYPE=R\n0., 1., 0., -1., 0., 0.\n*SURFACE, NAME=up\nslab, S2\n*SURFACE, NAME=down\n"
        "slab, S1\n*TIE, NAME=glue, POSITION TOLERANCE=0.1\nup, down\n*CLEARANCE, SLAVE=up, MASTER=down, VALUE=0.1\n"
        "*RIGID BODY, ELSET=slab\n*BOUNDARY\nfront, XSYMM\n5, 1, 3\n*STEP\n"
        "*BOUNDARY, OP=NEW\nback, 1, 2, 0.\n*END STEP\n"
    )


def systems_deck() -> str:
    """A sector of quadratic cells in systems placed in each other, with a mass, spiders and entries that are not
    read."""
    return (
        "GRDSET,,2\nCORD1R,1,91,92,93\nCORD2C,2,1,1.,2.,3.,1.,2.,9.\n,7.,2.,3.\nGRID,91,0,1.,1.,1.\nGRID,92,0,1.,1.,4.\n"
        "GRID,93,0,5.,1.,1.\nGRID,1,,2.,0.,0.\nGRID,2,,4.,0.,0.\nGRID,3,,3.,40.,0.\nGRID,4,,3.,15.,2.\nGRID,5,,3.,0.,0.\n"
        "GRID,6,,3.,20.,0.\nGRID*   7                               2.5             2.+1            *\n"
        "*       0.              \nGRID,8,0,4.5,4.,6.\nGRID,10,,2.,40.,0.\n"
        "CTETRA,1,,1,2,3,4,5,6\n,7\nCPYRA,2,9,1,2,3,10,8\n"
        "CTRIA6,3,8,1,2,3\n"
        "CONM2,70,8,,2.0-3,0.,0.,1.\n,8.0-2,,9.0-2,,,7.0-2\nRBE2,80,8,123456,1,2,3\nRBE3,81,,8,123,1.,123,1,2\n,3,UM\n"
        "CBAR,60,8,1,8,1.,0.,0.\nCWHAT,61,8,1,8\nCVISC,62,8,1,2\nSPC1,3,123,1,THRU,3\nSPC,3,4,1,0.\n"
    )
