"""Six screws of a public CAD assembly, tightened by one table of the scene; needs gmsh and, once, the network.

AS1 is a test assembly of the exchange of CAD data: two angle brackets on a plate, held by six screws with nuts whose
shanks fill their holes, and a rod. Its file is fetched, its 18 parts are meshed as they come, and the screws are
tightened. No part has a face for its thread. A file that is there already is not fetched.

    python examples/as1_screws.py [FOLDER]

It writes as1.stp, as1.msh and as1.toml in the folder (the current one), and prints the tension of each screw beside its
target.
"""

from __future__ import annotations

import sys
import urllib.request
from pathlib import Path

import latin_fmu

SOURCE = "https://raw.githubusercontent.com/tpaviot/pythonocc-demos/master/assets/models/as1-oc-214.stp"
FORCE = 10e3  # N
SCENE = f"""\
name = "as1"

[material.steel]
young_modulus = 210e9
poisson_ratio = 0.3
density = 7800.0

[mesh.cad]
file = "as1.msh"
scale = 1e-3
parts = "*"
material = "steel"

[contact.rod]                           # the nuts of the rod
parts = ["rod_1", "nut_1", "nut_2"]
search = 0.05e-3
behaviour = "perfect"

[contact.all]
search = 0.05e-3
friction_coefficient = 0.2

[boundary.floor]
type = "fixed"
face = "plate_1.floor"

[bolt.screw]
parts = "bolt_*"
thread = {{size = "M10", part = "nut_*"}}
force = {FORCE:g}
property_class = "8.8"

[time]
quasi_static = true
end = 1.0
instants = 1
"""


def mesh(step: Path, file: Path, size: float = 25.0) -> None:
    """Mesh the parts of the assembly by tetrahedra of second order, edges up to ``size``, mm."""
    import gmsh

    gmsh.initialize(interruptible=False)
    try:
        gmsh.option.setNumber("General.Terminal", 0)
        gmsh.option.setString("Geometry.OCCTargetUnit", "MM")
        gmsh.model.occ.importShapes(str(step))
        gmsh.model.occ.synchronize()
        counts: dict[str, int] = {}
        for _, tag in gmsh.model.getEntities(3):
            # the name is the path of the part in the assembly
            part = gmsh.model.getEntityName(3, tag).split("/")[-1].split(" ")[0].replace("-", "_")
            counts[part] = counts.get(part, 0) + 1
            gmsh.model.addPhysicalGroup(3, [tag], name=f"{part}_{counts[part]}")
            if part == "plate":
                faces = [face for _, face in gmsh.model.getBoundary([(3, tag)], oriented=False)]
                low = [face for face in faces if abs(gmsh.model.occ.getCenterOfMass(2, face)[2]) < 1e-6]
                gmsh.model.addPhysicalGroup(2, low, name="floor")
        for key, value in (("MeshSizeMax", size), ("MeshSizeMin", 4.0), ("MeshSizeFromCurvature", 6.0)):
            gmsh.option.setNumber(f"Mesh.{key}", value)
        gmsh.model.mesh.generate(3)
        gmsh.model.mesh.setOrder(2)
        # thin nuts: middle nodes on coarse circles tangle their cells
        gmsh.model.mesh.optimize("HighOrderElastic")
        gmsh.model.mesh.optimize("HighOrder")
        gmsh.option.setNumber("Mesh.MshFileVersion", 2.2)
        gmsh.option.setNumber("Mesh.Binary", 1)
        gmsh.write(str(file))
    finally:
        gmsh.finalize()


def main(folder: Path) -> None:
    """Fetch, mesh, tighten."""
    folder.mkdir(parents=True, exist_ok=True)
    step, file = folder / "as1.stp", folder / "as1.msh"
    if not step.exists():
        urllib.request.urlretrieve(SOURCE, step)
    if not file.exists():
        mesh(step, file)
    (folder / "as1.toml").write_text(SCENE, encoding="utf-8")
    solution = latin_fmu.solve(latin_fmu.load_scene(folder / "as1.toml"))
    for name, bolt in solution.bolts.items():
        print(f"{name}: {bolt.force[-1]:.6g} N, off by {abs(bolt.force[-1] / FORCE - 1.0):.1e}")


if __name__ == "__main__":
    main(Path(sys.argv[1] if len(sys.argv) > 1 else "."))
