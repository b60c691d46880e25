#!/usr/bin/env bash
# meshio writes the middle nodes of hexahedra of 20 nodes to Exodus in the order of VTK.
set -euo pipefail
folder=$(mktemp -d)
trap 'rm -rf "$folder"' EXIT
python3 -m venv "$folder/venv"
"$folder/venv/bin/pip" install -q numpy==2.3.5 meshio==5.3.5 netCDF4==1.7.4
cd "$folder"
venv/bin/python - <<'END'
import sys
from importlib.metadata import version

import meshio
import netCDF4
import numpy as np

corners = np.array([(x, y, z) for z in (0, 1) for x, y in ((0, 0), (1, 0), (1, 1), (0, 1))], dtype=float)
around = [(0, 1), (1, 2), (2, 3), (3, 0)]
edges = [*around, *((i + 4, j + 4) for i, j in around), *((i, i + 4) for i in range(4))]  # order of VTK and meshio
points = np.vstack([corners, [(corners[i] + corners[j]) / 2 for i, j in edges]])
meshio.Mesh(points, [("hexahedron20", np.arange(20)[None])]).write("cube.e")

with netCDF4.Dataset("cube.e") as file:
    places = np.asarray(file["coord"][:]).T[np.asarray(file["connect1"][0]) - 1]
# Exodus: 13 to 16 stand between bottom and top, 17 to 20 around the top
heights = [places[12:16, 2].tolist(), places[16:20, 2].tolist()]
print(f"meshio {version('meshio')}, a unit cube of HEX20 in Exodus: z of nodes 13 to 16 and 17 to 20")
print(f"by the manual of Exodus {[[0.5] * 4, [1.0] * 4]}, written {heights}")
sys.exit(0 if heights == [[1.0] * 4, [0.5] * 4] else "the behaviour has changed")
END
