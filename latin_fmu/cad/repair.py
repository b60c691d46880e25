"""Cells of second order that are inside out: on coarse circles middle nodes on the circle tangle them.

Edges of such cells inside the part become straight; then, of cells that are still inside out, all edges. Surfaces stay
round as long as they can, as threads are found by them. The optimizer of the library is left alone: its results depend
on addresses in memory, and where it fails it ends the process (gmsh 4.15.2).
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any, Final

import numpy as np

TETRAHEDRON: Final = 11
"""Number of gmsh of a tetrahedron of 10 nodes."""
_GOOD: Final = 2e-3  # least over largest determinant of a cell that will do: two faces on one cylinder take it to zero
_EDGES: Final = ((0, 1), (1, 2), (2, 0), (3, 0), (3, 2), (3, 1))
"""Ends of the edges of a tetrahedron in the order of its middle nodes, as gmsh counts them."""


class CellRepair:
    """Cells of the parts.

    Parameters
    ----------
    gmsh : the module with the mesh. numbers : of the volumes by part.
    """

    def __init__(self, gmsh: Any, numbers: Mapping[str, int]) -> None:
        self._gmsh, self._numbers = gmsh, numbers

    def bad_cells(self, number: int) -> list[int]:
        """Cells of a volume whose determinant changes sign, or nearly so."""
        mesh = self._gmsh.model.mesh
        tags = mesh.getElementsByType(TETRAHEDRON, number)[0]
        if not len(tags):
            return []
        least = np.array(mesh.getElementQualities(tags, "minDetJac"))
        most = np.array(mesh.getElementQualities(tags, "maxDetJac"))
        return [int(tag) for tag in np.array(tags)[least < _GOOD * np.abs(most)]]

    def repair(self) -> tuple[int, list[str]]:
        """Untangle cells of second order on coarse circles: by straight edges; how many, and what is said
        of parts that keep such cells."""
        straightened, said = 0, []
        for name, number in self._numbers.items():
            for inner in (True, False):
                straightened += self._straighten(number, self.bad_cells(number), inner)
            if bad := self.bad_cells(number):
                said.append(f"{name}: {len(bad)} cells are nearly inside out; mesh it finer, --size")
        return straightened, said

    def _straighten(self, number: int, cells: Sequence[int], inner: bool) -> int:
        """Take the middle nodes of cells to the middles of their edges; ``inner`` : those inside the part alone."""
        mesh, count = self._gmsh.model.mesh, 0
        movable = set(mesh.getNodes(3, number)[0].tolist())
        for cell in cells:
            nodes = mesh.getElement(cell)[1].tolist()
            for middle, (a, b) in zip(nodes[4:], _EDGES, strict=True):
                if inner and middle not in movable:
                    continue
                first, second = (np.array(mesh.getNode(nodes[i])[0]) for i in (a, b))
                mesh.setNode(middle, (0.5 * (first + second)).tolist(), [])
                count += 1
        return count
