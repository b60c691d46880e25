"""Quarter of a ball of 10-node tetrahedra, fine around its lowest point: writes ``ball.msh`` (needs gmsh).

Radius 1, centre in the origin, x >= 0 and y >= 0; volume group "ball", faces "skin", "xmin", "ymin".
"""

from __future__ import annotations

import sys
from pathlib import Path

FINE, COARSE, NEAR, FAR = 0.005, 0.4, 0.04, 1.1  # element size up to NEAR from the lowest point, beyond FAR


def write(file: Path) -> None:
    """Mesh the quarter and write it (gmsh 2.2, binary)."""
    import gmsh

    gmsh.initialize()
    gmsh.option.setNumber("General.Terminal", 0)
    occ = gmsh.model.occ
    ball = occ.addSphere(0, 0, 0, 1)
    box = occ.addBox(0, 0, -2, 2, 2, 4)
    occ.intersect([(3, ball)], [(3, box)])
    pole = occ.addPoint(0, 0, -1)
    occ.synchronize()
    volume = gmsh.model.getEntities(3)[0]
    names: dict[str, list[int]] = {"skin": [], "xmin": [], "ymin": []}
    for _, tag in gmsh.model.getBoundary([volume], oriented=False):
        x, y, _ = gmsh.model.occ.getCenterOfMass(2, tag)
        names["xmin" if abs(x) < 1e-6 else "ymin" if abs(y) < 1e-6 else "skin"].append(tag)
    gmsh.model.addPhysicalGroup(3, [volume[1]], name="ball")
    for name, tags in names.items():
        gmsh.model.addPhysicalGroup(2, tags, name=name)
    field = gmsh.model.mesh.field
    field.add("Distance", 1)
    field.setNumbers(1, "PointsList", [pole])
    field.add("Threshold", 2)
    for key, value in (("InField", 1), ("SizeMin", FINE), ("SizeMax", COARSE), ("DistMin", NEAR), ("DistMax", FAR)):
        field.setNumber(2, key, value)
    field.setAsBackgroundMesh(2)
    for key in ("MeshSizeExtendFromBoundary", "MeshSizeFromPoints", "MeshSizeFromCurvature"):
        gmsh.option.setNumber(f"Mesh.{key}", 0)
    gmsh.model.mesh.generate(3)
    gmsh.model.mesh.setOrder(2)
    gmsh.model.mesh.optimize("HighOrder")
    gmsh.option.setNumber("Mesh.MshFileVersion", 2.2)
    gmsh.option.setNumber("Mesh.Binary", 1)
    gmsh.write(str(file))
    gmsh.finalize()


if __name__ == "__main__":
    write(Path(sys.argv[1]) if len(sys.argv) > 1 else Path(__file__).with_name("ball.msh"))
