#!/usr/bin/env bash
# medcoupling writes the middle nodes of faces of hexahedra of 27 nodes to .vtu in the order of MED.
set -euo pipefail
folder=$(mktemp -d)
trap 'rm -rf "$folder"' EXIT
python3 -m venv "$folder/venv"
"$folder/venv/bin/pip" install -q numpy==2.3.5 medcoupling==9.15.0
cd "$folder"
venv/bin/python - <<'END'
import re
import sys
from importlib.metadata import version
from pathlib import Path

import medcoupling as mc
import numpy as np

corners = np.array([(x, y, z) for z in (0, 1) for x, y in ((0, 0), (1, 0), (1, 1), (0, 1))], dtype=float)
around = [(0, 1), (1, 2), (2, 3), (3, 0)]
edges = [*around, *((i + 4, j + 4) for i, j in around), *((i, i + 4) for i in range(4))]
# MED: the middles of the faces below, four sides around, above, and of the cell
faces = [(0, 1, 2, 3), (0, 1, 5, 4), (1, 2, 6, 5), (2, 3, 7, 6), (3, 0, 4, 7), (4, 5, 6, 7), range(8)]
points = np.vstack([corners, [corners[list(place)].mean(axis=0) for place in (*edges, *faces)]])
mesh = mc.MEDCouplingUMesh("cube", 3)
mesh.setCoords(mc.DataArrayDouble(points))
mesh.allocateCells(1)
mesh.insertNextCell(mc.NORM_HEXA27, 27, list(range(27)))
mesh.finishInsertingCells()
mesh.checkConsistency()
mesh.writeVTK("cube.vtu", False)

text = Path("cube.vtu").read_text()
nodes = [int(n) for n in re.search(r'Name="connectivity"[^>]*>([^<]*)<', text)[1].split()]
number = re.search(r'Name="types"[^>]*>([^<]*)<', text)[1].split()
written = points[nodes[20:26]].tolist()
# VTK_TRIQUADRATIC_HEXAHEDRON, 29: middles of the faces x = 0, x = 1, y = 0, y = 1, z = 0, z = 1
manual = [[0.0, 0.5, 0.5], [1.0, 0.5, 0.5], [0.5, 0.0, 0.5], [0.5, 1.0, 0.5], [0.5, 0.5, 0.0], [0.5, 0.5, 1.0]]
print(f"medcoupling {version('medcoupling')}, a unit cube of HEXA27 in .vtu, cell type {number}: nodes 20 to 25")
print(f"by VTK  {manual}\nwritten {written}")
sys.exit(0 if number == ["29"] and sorted(written) == sorted(manual) and written != manual else "the behaviour has changed")
END
