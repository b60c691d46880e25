"""Cells of second order that are inside out: on coarse circles middle nodes on the circle tangle them.

The library moves middle nodes until the determinants of the cells are good enough. Where it fails, it ends the process:
so it works in a copy of it. Where it has failed, edges inside the part become straight; then, of cells that are still
inside out, all: surfaces stay round as long as they can, as threads are found by them.
"""

from __future__ import annotations

import os
import tempfile
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any, Final

import numpy as np

TETRAHEDRON: Final = 11
"""Number of gmsh of a tetrahedron of 10 nodes."""
AIM: Final = 0.05
"""Least over largest determinant of a cell that the library is asked for."""
_GOOD: Final = 0.01  # that will do
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
        """Untangle cells of second order on coarse circles: by moving their middle nodes, else by straight edges; the
        number of the latter, and what is said of parts that keep such cells."""
        if any(self.bad_cells(number) for number in self._numbers.values()):
            self._optimise()
        straightened, said = 0, []
        for name, number in self._numbers.items():
            for inner in (True, False):
                straightened += self._straighten(number, self.bad_cells(number), inner)
            if bad := self.bad_cells(number):
                said.append(f"{name}: {len(bad)} cells are nearly inside out; mesh it finer, --size")
        return straightened, said

    def _optimise(self) -> None:
        """Move middle nodes by the library, in a copy of this process: where it fails, the library ends the process."""
        mesh = self._gmsh.model.mesh
        if not hasattr(os, "fork"):
            mesh.optimize("HighOrder")
            return
        with tempfile.TemporaryDirectory() as folder:
            file = Path(folder) / "nodes.npy"
            copy = os.fork()
            if copy == 0:
                mesh.optimize("HighOrder")  # of all parts, whatever is asked for
                np.save(file, mesh.getNodes()[1])
                os._exit(0)
            _, status = os.waitpid(copy, 0)
            if status != 0 or not file.is_file():
                return
            moved = np.load(file).reshape(-1, 3)
        tags, places, _ = mesh.getNodes()
        for row in np.flatnonzero((moved != places.reshape(-1, 3)).any(axis=1)):
            mesh.setNode(tags[row], list(moved[row]), [])

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
