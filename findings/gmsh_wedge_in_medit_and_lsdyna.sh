#!/usr/bin/env bash
# gmsh leaves a wedge out of .mesh, and writes its nodes for LS-DYNA in an order that folds it.
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

gmsh.initialize()
gmsh.option.setNumber("General.Terminal", 0)
gmsh.model.add("wedge")
gmsh.model.addDiscreteEntity(3, 1)
corners = [(0, 0, 0), (1, 0, 0), (0, 1, 0), (0, 0, 1), (1, 0, 1), (0, 1, 1)]
gmsh.model.mesh.addNodes(3, 1, list(range(1, 7)), [float(x) for corner in corners for x in corner])
gmsh.model.mesh.addElementsByType(1, 6, [1], list(range(1, 7)))
gmsh.write("wedge.mesh")
gmsh.write("wedge.key")
gmsh.finalize()

words = Path("wedge.mesh").read_text().split()
print(f"gmsh {version('gmsh')}, a mesh of one wedge")
print(f"wedge.mesh: {words[words.index('Vertices') + 1]} vertices, a section of prisms: {'Prisms' in words}")
line = next(line for line in Path("wedge.key").read_text().splitlines() if line.startswith("1, 3"))
nodes = [int(n) for n in line.split(",")[2:]]
# LS-DYNA: a wedge is a brick whose nodes 5, 6 and 7, 8 are the same; 1 2 3 4 is a face with four corners
base = [corners[n - 1] for n in nodes[:4]]
u, v, w = ([c - o for c, o in zip(corner, base[0], strict=True)] for corner in base[1:])
triple = u[0] * (v[1] * w[2] - v[2] * w[1]) - u[1] * (v[0] * w[2] - v[2] * w[0]) + u[2] * (v[0] * w[1] - v[1] * w[0])
flat = triple == 0
print(f"wedge.key: nodes {nodes}; the face of the first four is plane: {flat}, corners {base}")
sys.exit(0 if "Prisms" not in words and not flat else "the behaviour has changed")
END
