#!/usr/bin/env bash
# gmsh 4.15.2 writes the names and colours of volumes into no STEP file: read back with their labels, the parts of an
# assembly are called after the translator, with a counter, and have the colour of parts without one.
set -euo pipefail
folder=$(mktemp -d)
trap 'rm -rf "$folder"' EXIT
cd "$folder"
python3 -m venv venv
venv/bin/pip install -q gmsh==4.15.2
cat > parts.py <<'PYTHON'
import gmsh

gmsh.initialize(interruptible=False)
gmsh.option.setNumber("General.Terminal", 0)
print("gmsh", gmsh.__version__)
box = gmsh.model.occ.addBox(0.0, 0.0, 0.0, 1.0, 1.0, 1.0)
pin = gmsh.model.occ.addCylinder(3.0, 0.0, 0.0, 0.0, 0.0, 4.0, 1.0)
gmsh.model.occ.synchronize()
for tag, name in ((box, "base"), (pin, "pin")):
    gmsh.model.setEntityName(3, tag, name)
    gmsh.model.setColor([(3, tag)], 255, 0, 0)
told = lambda: [(gmsh.model.getEntityName(3, tag), gmsh.model.getColor(3, tag)[:3]) for _, tag in gmsh.model.getEntities(3)]
before = told()
gmsh.write("parts.step")
gmsh.clear()
gmsh.option.setNumber("Geometry.OCCImportLabels", 1)
gmsh.model.occ.importShapes("parts.step")
gmsh.model.occ.synchronize()
after = told()
print("written:", before)
print("read   :", after)
text = open("parts.step").read()
print("names in the file:", [name for name in ("base", "pin") if f"'{name}'" in text], "colours:", text.count("COLOUR_RGB"))
names = [name for name, _ in after]
assert len(names) == 2 and all("Open CASCADE STEP translator" in name for name in names), "names are written now"
assert text.count("COLOUR_RGB") == 0 and all(colour != (255, 0, 0) for _, colour in after), "colours are written now"
PYTHON
venv/bin/python parts.py | grep "^gmsh\|^written\|^read\|^names"
