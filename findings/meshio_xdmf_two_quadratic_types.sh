#!/usr/bin/env bash
# meshio does not read the .xdmf that it wrote of tetrahedra of 10 beside hexahedra of 20 nodes.
set -euo pipefail
folder=$(mktemp -d)
trap 'rm -rf "$folder"' EXIT
python3 -m venv "$folder/venv"
"$folder/venv/bin/pip" install -q numpy==2.3.5 meshio==5.3.5 h5py==3.16.0
cd "$folder"
venv/bin/python - <<'END'
import sys
from importlib.metadata import version

import meshio
import numpy as np

generator = np.random.default_rng(1)
kinds = {"hexahedron20": 20, "tetra10": 10}
outcome = {}
for names in (["hexahedron20"], ["tetra10"], ["hexahedron20", "tetra10"]):
    count = sum(kinds[name] for name in names)
    starts = np.cumsum([0, *(kinds[name] for name in names)])
    cells = [(name, start + np.arange(kinds[name])[None]) for name, start in zip(names, starts, strict=False)]
    meshio.Mesh(generator.random((count, 3)), cells).write("mesh.xdmf")
    try:
        outcome[" and ".join(names)] = f"read, {sum(len(block.data) for block in meshio.read('mesh.xdmf').cells)} cells"
    except KeyError as error:
        outcome[" and ".join(names)] = f"KeyError {int(error.args[0])}"
print(f"meshio {version('meshio')}, .xdmf written and read again")
for names, text in outcome.items():
    print(f"{names}: {text}")
known = ["read, 1 cells", "read, 1 cells", "KeyError 48"]
sys.exit(0 if list(outcome.values()) == known else "the behaviour has changed")
END
