#!/usr/bin/env bash
# gmsh writes pyramids of 13 nodes to .vtk and .su2 under the type of 5 nodes, middle nodes in its own order.
set -euo pipefail
folder=$(mktemp -d)
trap 'rm -rf "$folder"' EXIT
python3 -m venv "$folder/venv"
"$folder/venv/bin/pip" install -q gmsh==4.15.2
cd "$folder"
venv/bin/python - <<'END'
import sys
from importlib.metadata import version
from pathlib import Path

import gmsh

corners = [(0.0, 0.0, 0.0), (1.0, 0.0, 0.0), (1.0, 1.0, 0.0), (0.0, 1.0, 0.0), (0.5, 0.5, 1.0)]
edges = [(0, 1), (0, 3), (0, 4), (1, 2), (1, 4), (2, 3), (2, 4), (3, 4)]  # order of gmsh
middles = [tuple((a + b) / 2 for a, b in zip(corners[i], corners[j], strict=True)) for i, j in edges]
gmsh.initialize()
gmsh.option.setNumber("General.Terminal", 0)
gmsh.model.add("pyramid")
gmsh.model.addDiscreteEntity(3, 1)
gmsh.model.mesh.addNodes(3, 1, list(range(1, 14)), [x for point in corners + middles for x in point])
gmsh.model.mesh.addElementsByType(1, 19, [1], list(range(1, 14)))
gmsh.write("pyramid.vtk")
gmsh.write("pyramid.su2")
gmsh.finalize()

vtk = Path("pyramid.vtk").read_text().split()
count, kind = int(vtk[vtk.index("CELLS") + 3]), int(vtk[vtk.index("CELL_TYPES") + 2])
su2 = Path("pyramid.su2").read_text().splitlines()
row = su2[next(i for i, line in enumerate(su2) if line.startswith("NELEM")) + 1].split()
print(f"gmsh {version('gmsh')}, a mesh of one pyramid of 13 nodes")
print(f"pyramid.vtk: cell type {kind} with {count} nodes (VTK: 14 has 5 nodes, the quadratic pyramid is 27)")
print(f"pyramid.su2: type {row[0]} with {len(row) - 2} nodes (SU2: type 14 has 5)")
sys.exit(0 if (count, kind, row[0], len(row)) == (13, 14, "14", 15) else "the behaviour has changed")
END
