#!/usr/bin/env bash
# meshio refuses to write a negative coordinate with all of its digits to .bdf.
set -euo pipefail
folder=$(mktemp -d)
trap 'rm -rf "$folder"' EXIT
python3 -m venv "$folder/venv"
"$folder/venv/bin/pip" install -q numpy==2.3.5 meshio==5.3.5
cd "$folder"
venv/bin/python - <<'END'
import sys
from importlib.metadata import version

import meshio
import numpy as np

outcome = {}
for x in (0.1234567890123456, -0.1234567890123456, -0.125):
    points = np.array([(x, 0.0, 0.0), (1.0, 0.0, 0.0), (0.0, 1.0, 0.0), (0.0, 0.0, 1.0)])
    try:
        meshio.Mesh(points, [("tetra", np.arange(4)[None])]).write("cell.bdf")
        outcome[x] = f"written, read again as {meshio.read('cell.bdf').points[0, 0]!r}"
    except AssertionError as error:
        outcome[x] = f"AssertionError {error}".strip()
print(f"meshio {version('meshio')}, x of a node in .bdf")
for x, text in outcome.items():
    print(f"{x!r}: {text}")
refused = [text.startswith("AssertionError") for text in outcome.values()]
sys.exit(0 if refused == [False, True, False] else "the behaviour has changed")
END
