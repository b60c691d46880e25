#!/usr/bin/env bash
# mapdl-archive reads z = 0 from rows of NBLOCK whose only integer is the number of the node.
set -euo pipefail
folder=$(mktemp -d)
trap 'rm -rf "$folder"' EXIT
python3 -m venv "$folder/venv"
"$folder/venv/bin/pip" install -q numpy==2.3.5 mapdl-archive==0.4.2
cd "$folder"
venv/bin/python - <<'END'
import sys
from importlib.metadata import version
from pathlib import Path

import mapdl_archive


def row(form: str, number: int, place: tuple[float, ...]) -> str:
    """A line of NBLOCK: one integer of 9 or three, then coordinates with exponents of three digits."""
    digits = [f"{value:.9E}".split("E") for value in place]
    numbers = [number] if form.startswith("(1i9") else [number, 0, 0]
    return "".join(f"{n:9d}" for n in numbers) + "".join(f"{m}E{x[0]}{int(x[1:]):03d}".rjust(20) for m, x in digits)


corners = [(x, y, z) for z in (0.0, 2.0) for x, y in ((0.0, 0.0), (1.0, 0.0), (1.0, 1.0), (0.0, 1.0))]
element = [1, 1, 1, 1, 0, 0, 0, 0, 8, 0, 1, 1, 2, 3, 4, 5, 6, 7, 8]
heights = {}
for form, head in (("(1i9,3e20.9e3)", "NBLOCK,3,,8,8"), ("(3i9,6e20.9e3)", "NBLOCK,6,SOLID,8,8")):
    rows = [row(form, i, corner) for i, corner in enumerate(corners, 1)]
    cells = ["EBLOCK,19,SOLID,,1", "(19i9)", "".join(f"{v:9d}" for v in element), "-1"]
    Path("brick.cdb").write_text("\n".join(["/PREP7", "ET,1,185", head, form, *rows, "-1", *cells]) + "\n")
    heights[form] = mapdl_archive.Archive("brick.cdb", parse_vtk=False).nodes[:, 2].tolist()
    print(f"mapdl-archive {version('mapdl-archive')}, {form}: z of the eight corners {heights[form]}")
print("written: four times 0, four times 2")
known = {"(1i9,3e20.9e3)": [0.0] * 8, "(3i9,6e20.9e3)": [0.0] * 4 + [2.0] * 4}
sys.exit(0 if heights == known else "the behaviour has changed")
END
