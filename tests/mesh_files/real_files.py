"""Files of strangers read one by one, a table of what became of each: ``python -m tests.mesh_files.real_files FOLDER``.

No file may end in a traceback: each is read, or refused with its line. Volumes are compared with the integral of det J
by scikit-fem over the coordinates as the file holds them, and of tetrahedra with pyNastran, which reads the deck by
itself, where it is installed (its volumes of other cells hold for right prisms only). Folders to try: ``test`` of the
repository of CalculiX, ``models`` of pyNastran, the archives of mapdl-archive, the Exodus meshes of Norma.jl.
"""

from __future__ import annotations

import sys
import time
from collections import Counter
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import numpy as np
import skfem

from latin_fmu.errors import LatinError
from latin_fmu.fem.elements import Elements
from latin_fmu.fem.mesh import CellBlock, Mesh
from latin_fmu.fem.mesh_file import oriented
from latin_fmu.fem.reference_cells import CELL_FACES, cell_functions
from latin_fmu.mesh_files.content import MeshContent
from latin_fmu.mesh_files.reading import read_content
from latin_fmu.mesh_files.unused import unused_content

SUFFIXES = (".inp", ".bdf", ".dat", ".nas", ".fem", ".cdb", ".g", ".e", ".exo", ".gen")
CLOSE = 1e-9  # relative difference of volumes
ELEMENTS = {
    "tetra": skfem.ElementTetP1,
    "tetra10": skfem.ElementTetP2,
    "hexahedron": skfem.ElementHex1,
    "hexahedron20": skfem.ElementHexS2,
    "hexahedron27": skfem.ElementHex2,
    "wedge": skfem.ElementWedge1,
}


def volumes(content: MeshContent) -> dict[str, float]:
    """Volume of the sound cells of each type, by the package."""
    found = {}
    for kind, cells in content.solids.items():
        if kind in CELL_FACES:
            turned, bad = oriented(content.points, CellBlock(kind, cells))
            mesh = Mesh(content.points, (CellBlock(kind, turned[~bad]),), {})
            found[kind] = sum(float(p.volumes.sum()) for _, p in Elements(mesh).points(of_products=True))
    return found


def by_scikit_fem(content: MeshContent) -> dict[str, float]:
    """The same by the shape functions and rules of scikit-fem, of the types that it has."""
    found = {}
    for kind, cells in content.solids.items():
        if kind not in ELEMENTS:
            continue
        _, bad = oriented(content.points, CellBlock(kind, cells))
        element, ours = ELEMENTS[kind](), cell_functions(kind)
        scale = {"hexahedron": [2, 2, 2], "wedge": [1, 1, 2]}.get(kind[:10], [1, 1, 1])
        theirs = (ours.nodes + (np.array(scale) == 2)) / scale
        points, weights = rule(kind)
        places = content.points[cells[~bad]]
        jacobian = np.zeros((len(places), len(weights), 3, 3))
        for i, location in enumerate(element.doflocs):
            node = int(np.abs(theirs - location).max(axis=1).argmin())
            slope = np.asarray(element.lbasis(points, i)[1])
            jacobian += np.einsum("ci,kq->cqik", places[:, node], slope)
        found[kind] = float(np.abs(np.linalg.det(jacobian) @ weights).sum())
    return found


def rule(kind: str) -> tuple[np.ndarray, np.ndarray]:
    """Points (3, n) and weights (n,) of degree 6; of wedges the product of two rules, as the weights that scikit-fem
    12.0.2 gives for them sum up to half of the volume."""
    if kind != "wedge":
        points, weights = skfem.quadrature.get_quadrature(ELEMENTS[kind].refdom, 6)
        return points, weights
    flat, area = skfem.quadrature.get_quadrature(skfem.refdom.RefTri, 6)
    line, length = skfem.quadrature.get_quadrature(skfem.refdom.RefLine, 6)
    points = np.concatenate([np.repeat(flat, len(length), axis=1), np.tile(line, len(area))])
    return points, np.repeat(area, len(length)) * np.tile(length, len(area))


def by_pynastran(path: Path) -> float | None:
    """Volume of the tetrahedra of four nodes of a deck by pyNastran; None where it is missing or does not read it."""
    try:
        from pyNastran.bdf.bdf import BDF  # type: ignore[import-not-found, import-untyped, unused-ignore]
    except (ImportError, AttributeError):
        # AttributeError: a version that does not fit the version of NumPy
        return None
    model: Any = BDF(debug=None, log=None)
    try:
        model.read_bdf(str(path), xref=False)
        model.cross_reference(xref_elements=False, xref_nodes=True)
        tetrahedra = [e for e in model.elements.values() if e.type == "CTETRA" and len([n for n in e.nodes if n]) == 4]
        total = 0.0
        for element in tetrahedra:
            a, b, c, d = (model.nodes[n].get_position() for n in element.nodes[:4])
            total += abs(float(np.linalg.det([b - a, c - a, d - a]))) / 6.0
    except (Exception, SystemExit):
        return None
    return total


def row_of(path: Path) -> tuple[str, str]:
    """What became of a file: "read", "no solids", "refused", "WRONG" or "TRACEBACK", and the details."""
    start = time.process_time()
    try:
        content = read_content(path)
        content.refuse()
        own, other = volumes(content), by_scikit_fem(content)
    except LatinError as error:
        return "refused", "; ".join(str(error).split("\n")[1:3])
    except Exception as error:
        return "TRACEBACK", f"{type(error).__name__}: {error}"
    wrong = [k for k in other if abs(own[k] - other[k]) > CLOSE * max(abs(other[k]), 1e-300)]
    straight = by_pynastran(path) if path.suffix.lower() != ".inp" and "tetra" in own else None
    agrees = "" if straight is None else ", tetrahedra as pyNastran has them"
    if straight is not None and abs(own["tetra"] - straight) > CLOSE * straight:
        wrong.append(f"pyNastran {straight:.9g}")
    text = ", ".join(f"{len(c)} {k}" for k, c in content.solids.items())
    text += f", volume {sum(own.values()):.6g}{agrees}, {time.process_time() - start:.1f} s"
    said = "; ".join(unused_content(content, (), ()))
    keywords = "" if content.deck is None else ", ".join(content.deck.unused_words())
    details = " | ".join(part for part in (text, said[:300], keywords[:120]) if part)
    return ("WRONG" if wrong else "read" if own else "no solids"), f"{', '.join(wrong)} {details}".strip()


def files(folders: list[str]) -> Iterator[Path]:
    """Decks below these folders, by name."""
    for folder in folders:
        yield from sorted(p for p in Path(folder).rglob("*") if p.suffix.lower() in SUFFIXES and p.is_file())


def main(folders: list[str]) -> int:
    """Print the table and the numbers of each outcome; 1 where a file ended in a traceback or a wrong volume."""
    outcomes: Counter[str] = Counter()
    for path in files(folders):
        outcome, details = row_of(path)
        outcomes[outcome] += 1
        sys.stdout.write(f"{outcome:10s} {path.name}: {details}\n")
    counts = ", ".join(f"{count} {outcome}" for outcome, count in outcomes.most_common())
    sys.stdout.write(f"{counts or 'no decks there'}\n")
    return int(any(outcomes[word] for word in ("TRACEBACK", "WRONG")))


if __name__ == "__main__":
    sys.exit(main(sys.argv[1:]))
