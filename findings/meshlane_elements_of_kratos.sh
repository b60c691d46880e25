#!/usr/bin/env bash
# meshlane takes an element of Kratos, Element3D8N, for a line of eight nodes.
set -euo pipefail
folder=$(mktemp -d)
trap 'rm -rf "$folder"' EXIT
python3 -m venv "$folder/venv"
"$folder/venv/bin/pip" install -q numpy==2.3.5 KratosMultiphysics==10.4.4 meshlane==5.5.0
cd "$folder"
venv/bin/python - <<'END'
import sys
from importlib.metadata import version
from pathlib import Path

import KratosMultiphysics as Kratos
import meshlane

model = Kratos.Model()
part = model.CreateModelPart("cube")
part.CreateNewProperties(1)
corners = [(x, y, z) for z in (0.0, 1.0) for x, y in ((0.0, 0.0), (1.0, 0.0), (1.0, 1.0), (0.0, 1.0))]
for i, corner in enumerate(corners, 1):
    part.CreateNewNode(i, *corner)
part.CreateNewElement("Element3D8N", 1, list(range(1, 9)), part.GetProperties()[1])
Kratos.ModelPartIO("cube", Kratos.IO.WRITE | Kratos.IO.MESH_ONLY).WriteModelPart(part)
found = {block.type: len(block.data) for block in meshlane.read("cube.mdpa").cells}
line = next(line for line in Path("cube.mdpa").read_text().splitlines() if line.startswith("Begin Elements"))
print(f"Kratos {version('KratosMultiphysics')} writes a cube of one hexahedron under '{' '.join(line.split())}'")
print(f"meshlane {version('meshlane')} reads the cells {found}")
sys.exit(0 if found == {"line8": 1} else "the behaviour has changed")
END
