"""Files of Kratos: cells of every type in its order of nodes, sub model parts as bodies and faces, what is refused.

``Geometry.DomainSize`` of Kratos 10.4.4 over the same nodes confirms the orders (``real_writers by_kratos``).
"""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from latin_fmu.errors import MeshError
from latin_fmu.fem.elements import Elements
from latin_fmu.fem.mesh import Mesh, boundary
from latin_fmu.fem.mesh_file import mesh_of
from latin_fmu.mesh_files.reading import read_content
from tests.fem.meshes import skewed, typed_box
from tests.fem.surface_integrals import integrals

from .writers.solid import ORDERS

KINDS = (
    *("tetra", "tetra10", "hexahedron", "hexahedron20", "hexahedron27"),
    *("wedge", "wedge15", "pyramid", "pyramid13", "mixed"),
)


def block(word: str, rows: list[str], name: str = "") -> str:
    return "\n".join([f"Begin {word} {name}", *rows, f"End {word}", ""])


def part(name: str, word: str, numbers: list[int]) -> str:
    return block("SubModelPart", [block(f"SubModelPart{word}", [str(i) for i in numbers])], name)


def mdpa(mesh: Mesh) -> str:
    """A body "left" and a face "foot", cells of a property and numbers of their own."""
    text = block("Nodes", [f"{i} {x!r} {y!r} {z!r} // node" for i, (x, y, z) in enumerate(mesh.nodes.tolist(), 1)])
    number = 0
    for cells in mesh.blocks:
        rows = cells.cells[:, ORDERS["kratos"].get(cells.cell_type, list(range(cells.cells.shape[1])))] + 1
        lines = [f"{number + i} 3 {' '.join(map(str, row))}" for i, row in enumerate(rows.tolist(), 1)]
        text += block("Elements", lines, f"SmallDisplacementElement3D{rows.shape[1]}N")
        number += len(rows)
    facets = 0
    for face in mesh.faces["zmin"].blocks:
        lines = [f"{facets + i} 0 {' '.join(map(str, row))}" for i, row in enumerate((face.facets + 1).tolist(), 1)]
        text += block("Conditions", lines, f"SurfaceCondition3D{face.facets.shape[1]}N")
        facets += len(lines)
    return (
        text + part("left", "Elements", [*range(1, number + 1)]) + part("foot", "Conditions", [*range(1, facets + 1)])
    )


@pytest.mark.parametrize("kind", KINDS)
def test_cells_and_parts(tmp_path: Path, kind: str) -> None:
    box = typed_box(kind, (2, 2, 2))
    mesh = Mesh(skewed(box.nodes, 0.05) if box.blocks[0].cells.shape[1] > 8 else box.nodes, box.blocks, box.faces)
    (tmp_path / "box.mdpa").write_text(mdpa(mesh))
    content = read_content(tmp_path / "box.mdpa")
    assert content.part_names("box.mdpa") == ("left",)
    found = mesh_of(content, "box.mdpa", "left")
    wanted = integrals(mesh.nodes, boundary(mesh))
    np.testing.assert_allclose(integrals(found.nodes, boundary(found)), wanted, atol=1e-12)
    assert Elements(found).volume.sum() == pytest.approx(wanted[0], rel=1e-12)
    areas = [integrals(m.nodes, m.faces[face])[4:] for m, face in ((mesh, "zmin"), (found, "foot"))]
    np.testing.assert_allclose(areas[1], areas[0], atol=1e-12)


def test_properties_sets_of_nodes_and_what_is_no_solid(tmp_path: Path) -> None:
    """Without sub model parts of solids the properties are the bodies; a part of nodes alone is a set of nodes."""
    nodes = block("Nodes", [f"{i} {x} {y} {z}" for i, (x, y, z) in enumerate([*np.eye(3).tolist(), [0, 0, 0]], 1)])
    solids = block("Elements", ["1 7 4 1 2 3"], "Element3D4N")
    others = block("Elements", ["2 7 1 2"], "TrussElement3D2N") + block("Elements", ["3 7 1 2 3"], "ShellElement3D3N")
    (tmp_path / "x.mdpa").write_text(nodes + solids + others + part("feet", "Nodes", [1, 2, 3]))
    content = read_content(tmp_path / "x.mdpa")
    assert content.part_names("x.mdpa") == ("property_7",)
    assert content.skipped == {"TrussElement3D2N": 1}
    assert content.node_sets["feet"].tolist() == [0, 1, 2]
    assert mesh_of(content, "x.mdpa", "property_7").faces["feet"].n_facet == 1


@pytest.mark.parametrize(
    ("text", "words"),
    [
        ("Begin Elements Element3D4N\n1\nEnd Elements\n", ["line 2", "not a line of Elements"]),
        ("Begin SubModelPartNodes\n1\nEnd SubModelPartNodes\n", ["line 2", "not a line of SubModelPartNodes"]),
        ("Begin Nodes\n1 0 0\nEnd Nodes\n", ["line 2", "not a line of Nodes", "1 0 0"]),
        ("Begin Nodes\n1 0 0 0\n1 0 0 1\nEnd Nodes\n", ["line 3", "two nodes with one number"]),
        (f"Begin Nodes\n{10**30} 0 0 0\nEnd Nodes\n", ["not a whole file of the format .mdpa"]),
        ("Begin Nodes\n1 0 0 0\n", ["a block does not end", "End Nodes"]),
        ("Begin Nodes\n1 0 0 0\nEnd Elements\n", ["line 3", "a block ends that did not begin"]),
        ("Begin Elements Element3D7N\n1 0 1 2 3 4 5 6 7\nEnd Elements\n", ["line 2", "Element3D7N with 7 nodes"]),
        ("Begin Elements Element3D4N\n1 0 1 2 3 4\nEnd Elements\n", ["name a node that is not there", "0 nodes"]),
    ],
)
def test_what_is_refused(tmp_path: Path, text: str, words: list[str]) -> None:
    (tmp_path / "x.mdpa").write_text(text)
    with pytest.raises(MeshError) as error:
        read_content(tmp_path / "x.mdpa")
    for word in words:
        assert word in str(error.value)
