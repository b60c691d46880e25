"""Decks of two blocks, one on the other, and what they say besides."""

from __future__ import annotations

import numpy as np

from latin_fmu.fem.mesh import Mesh, box_mesh
from tests.mesh_files.decks import LABEL_OF, element_rows, layer, node_rows

STEEL = "*MATERIAL, NAME=STEEL\n*ELASTIC\n210000., 0.3\n*DENSITY\n7.8e-9\n"
HELD = "*BOUNDARY\nBOTTOM, 1, 3\n"
OUTPUT = "*NODE PRINT, NSET=TIP\nU\n"


def block(origin: tuple[float, float, float], size: tuple[float, float, float], counts: tuple[int, int, int]) -> Mesh:
    """A box, mm."""
    return box_mesh(np.array(origin), np.array(size), counts)


def one_block(mesh: Mesh, kind: str = "C3D8") -> str:
    """Nodes, elements and faces of a block: node sets BOTTOM, TOP, LEFT, RIGHT, TIP, surfaces UP, DOWN."""
    text = "*HEADING\na block\n*NODE, NSET=NALL\n" + node_rows(mesh.nodes)
    text += f"*ELEMENT, TYPE={kind}, ELSET=BLOCK\n" + element_rows(mesh.blocks[0].cells)
    text += _faces(mesh, 0, {"UP": "zmax", "DOWN": "zmin"})
    text += _sets(mesh, 0, {"BOTTOM": "zmin", "TOP": "zmax", "LEFT": "xmin", "RIGHT": "xmax"})
    return f"{text}*NSET, NSET=TIP\n{mesh.n_node}\n*SOLID SECTION, ELSET=BLOCK, MATERIAL=STEEL\n"


def two_blocks(counts: tuple[int, int, int] = (2, 2, 2), gap: float = 0.0) -> str:
    """Two blocks of 10 x 10 x 10 mm, LOW and HIGH, ``gap`` mm apart: surfaces LOWUP, HIGHDOWN, HIGHUP, node sets."""
    low = block((0.0, 0.0, 0.0), (10.0, 10.0, 10.0), counts)
    high = block((0.0, 0.0, 10.0 + gap), (10.0, 10.0, 10.0), counts)
    n, e = low.n_node, low.n_cell
    text = "*NODE, NSET=NALL\n" + node_rows(low.nodes) + node_rows(high.nodes, n + 1)
    text += "*ELEMENT, TYPE=C3D8, ELSET=LOW\n" + element_rows(low.blocks[0].cells)
    text += "*ELEMENT, TYPE=C3D8, ELSET=HIGH\n" + element_rows(high.blocks[0].cells, e + 1, n + 1)
    text += _faces(low, 0, {"LOWUP": "zmax"}) + _faces(high, e, {"HIGHDOWN": "zmin", "HIGHUP": "zmax"})
    text += _sets(low, 0, {"BOTTOM": "zmin"}) + _sets(high, n, {"TOP": "zmax"})
    text += f"*NSET, NSET=NHIGH, GENERATE\n{n + 1}, {2 * n}\n*NSET, NSET=NLOW, GENERATE\n1, {n}\n"
    text += f"*NSET, NSET=TIP\n{2 * n}\n"
    return text + "*SOLID SECTION, ELSET=LOW, MATERIAL=STEEL\n*SOLID SECTION, ELSET=HIGH, MATERIAL=STEEL\n"


def contact(behavior: str = "*SURFACE BEHAVIOR, PRESSURE-OVERCLOSURE=HARD\n", pair: str = "") -> str:
    """A contact pair between the two blocks."""
    text = f"*SURFACE INTERACTION, NAME=JOINT\n{behavior}"
    return f"{text}*CONTACT PAIR, INTERACTION=JOINT, TYPE=SURFACE TO SURFACE{pair}\nHIGHDOWN, LOWUP\n"


def static(cards: str, line: str = "1., 1.", step: str = "*STEP\n") -> str:
    """A static step."""
    return f"{step}*STATIC\n{line}\n{cards}*END STEP\n"


def _faces(mesh: Mesh, element: int, names: dict[str, str]) -> str:
    return "".join(
        f"*SURFACE, NAME={name}, TYPE=ELEMENT\n"
        + "".join(f"{cell + element}, {LABEL_OF[face]}\n" for cell in layer(mesh, face))
        for name, face in names.items()
    )


def _sets(mesh: Mesh, node: int, names: dict[str, str]) -> str:
    text = ""
    for name, face in names.items():
        labels = (np.unique(mesh.faces[face].nodes) + 1 + node).tolist()
        rows = [", ".join(map(str, labels[i : i + 12])) for i in range(0, len(labels), 12)]
        text += f"*NSET, NSET={name}\n" + "\n".join(rows) + "\n"
    return text
