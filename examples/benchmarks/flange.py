"""A bolted flange of ten parts, without inertia: this package and CalculiX on one and the same mesh.

Two rings (radii 20 and 40 mm, 8 mm thick) and four bolts M6, each of two halves whose faces at the cut, in the plane of
the joint, are pulled towards each other with 8 kN: what both codes can express. Friction 0.15 in the joint and below
the heads. The rim of the lower ring is held; five increments tighten the bolts, five load the rim of the upper one by
1.2 MPa along x and 3 MPa upwards. By equilibrium the joint carries the shear, whatever the mesh.

Then the package alone, quadratic tetrahedra: every part with a mesh of its own, against a finer mesh whose nodes match.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from importlib.util import find_spec
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import Any

import numpy as np
from calculix import run
from harness import STEEL, Case, cpu, prepared, tools

import latin_fmu
from latin_fmu.building import discretise
from latin_fmu.decks.export_draft import DeckChoices
from latin_fmu.decks.exporting import export_deck
from latin_fmu.fem.faces import Face, face_of
from latin_fmu.fem.mesh_file import mesh_of
from latin_fmu.latin.outcome import Outcome
from latin_fmu.mesh_files.reading import read_content

BORE, RIM, HIGH = 20.0, 40.0, 8.0  # mm, of a ring
PLACES = [(30.0, 0.0), (0.0, 30.0), (-30.0, 0.0), (0.0, -30.0)]
HOLE, SHANK, HEAD, HEAD_HIGH = 3.3, 3.0, 5.0, 4.0
FRICTION, PULL, SHEAR, LIFT = 0.15, 8e3, 1.2e6, 3.0e6  # -, N, Pa, Pa
PENALTY = DeckChoices(penalty=100.0)
NO_GMSH = "gmsh is not installed: pip install gmsh; the flange is not compared"
VARIANTS: dict[str, dict[str, Any]] = {"as it comes": {}, "without Newton steps": {"newton": False}}


@dataclass(frozen=True)
class Mesh:
    """Sizes of the elements of the rings and of the bolts, mm; ``matching``: parts share nodes; ``order`` 1 or 2."""

    lower: float
    upper: float
    bolt: float
    matching: bool = True
    order: int = 1

    def made(self, path: Path) -> Case:
        """Mesh the flange, write the file and make the scene."""
        self.write(path)
        return case(self, path)

    def write(self, path: Path) -> None:
        """Mesh the flange with gmsh."""
        import gmsh

        gmsh.initialize()
        try:
            gmsh.option.setNumber("General.Terminal", 0)
            parts = _solids(gmsh.model.occ)
            if self.matching:
                _, pieces = gmsh.model.occ.fragment([(3, v) for v in parts.values()], [])
                parts = {name: piece[0][1] for name, piece in zip(parts, pieces, strict=True)}
            gmsh.model.occ.synchronize()
            gmsh.option.setNumber("Mesh.MeshSizeExtendFromBoundary", 1)
            for name, volume in parts.items():
                size = {"lower": self.lower, "upper": self.upper}.get(name, self.bolt)
                for corner in gmsh.model.getBoundary([(3, volume)], recursive=True):
                    x, y, _ = gmsh.model.getValue(*corner, [])
                    near = min(np.hypot(x - a, y - b) for a, b in PLACES) < HEAD + 0.1
                    gmsh.model.mesh.setSize([corner], self.bolt if near else size)
            for name, volume in parts.items():
                gmsh.model.addPhysicalGroup(3, [volume], name=name)
            for name, faces in _named_faces(gmsh.model).items():
                gmsh.model.addPhysicalGroup(2, faces, name=name)
            gmsh.option.setNumber("Mesh.ElementOrder", self.order)
            gmsh.option.setNumber("Mesh.HighOrderOptimize", 2)
            gmsh.model.mesh.generate(3)
            gmsh.write(str(path))
        finally:
            gmsh.finalize()


ONE = Mesh(4.0, 4.0, 1.6)
QUADRATIC = {"matching nodes, fine": Mesh(5.0, 5.0, 2.5, order=2), "own meshes": Mesh(7.0, 5.0, 2.5, False, 2)}


def _solids(occ: Any) -> dict[str, int]:
    """Volumes of the ten parts by name."""
    parts = {}
    for name, up in (("lower", -1.0), ("upper", 1.0)):
        ring = occ.addCylinder(0, 0, 0, 0, 0, up * HIGH, RIM)
        holes = [(3, occ.addCylinder(0, 0, 0, 0, 0, up * HIGH, BORE))]
        holes += [(3, occ.addCylinder(x, y, 0, 0, 0, up * HIGH, HOLE)) for x, y in PLACES]
        parts[name] = occ.cut([(3, ring)], holes)[0][0][1]
        for k, (x, y) in enumerate(PLACES, 1):
            shank = occ.addCylinder(x, y, 0, 0, 0, up * HIGH, SHANK)
            head = occ.addCylinder(x, y, up * HIGH, 0, 0, up * HEAD_HIGH, HEAD)
            parts[f"{name}_bolt{k}"] = occ.fuse([(3, shank)], [(3, head)])[0][0][1]
    return parts


def _named_faces(model: Any) -> dict[str, list[int]]:
    """Faces by name: rim and joint of the rings, their ``bearing`` outer face, cut of the bolts, ``SIDE_seatK`` below
    the heads (of head and ring where nodes match)."""
    named: dict[str, list[int]] = {}
    for _, face in model.getEntities(2):
        x, y, z, x2, y2, z2 = model.getBoundingBox(2, face)
        width, centre = x2 - x, ((x + x2) / 2, (y + y2) / 2)
        flat, level = z2 - z < 1e-3, (z + z2) / 2
        place = next((k for k, p in enumerate(PLACES, 1) if np.hypot(*np.subtract(p, centre)) < 1e-3), 0)
        if not flat:
            name = "rim" if width > 2 * RIM - 1e-3 else ""
        elif abs(level) < 1e-3:
            name = "joint" if not place else "cut" if width < 2 * SHANK + 1e-3 else ""
        elif abs(abs(level) - HIGH) < 1e-3:
            side = "upper" if level > 0 else "lower"
            name = "bearing" if not place else f"{side}_seat{place}" if width > 2 * HEAD - 1e-3 else ""
        else:
            name = ""
        if name:
            named.setdefault(name, []).append(face)
    return named


def case(mesh: Mesh, file: Path) -> Case:
    """The flange on its mesh file; the tractions at the cuts are 8 kN over the area of their facets."""
    contact = {"behaviour": "contact", "friction_coefficient": FRICTION}
    interfaces: dict[str, Any] = {"joint": {"sides": ["lower.joint", "upper.joint"], **contact}}
    tighten = {"type": "table", "times": [0.0, 0.5, 1.0], "values": [0.0, 1.0, 1.0]}
    load = {**tighten, "values": [0.0, 0.0, 1.0]}
    loads: dict[str, Any] = {"rim": {"face": "upper.rim", "traction": [SHEAR, 0.0, LIFT], "law": load}}
    content = read_content(file)
    for side, up in (("lower", 1.0), ("upper", -1.0)):
        for k in range(1, len(PLACES) + 1):
            half, seat = f"{side}_bolt{k}", f"{side}_seat{k}"
            bearing = seat if mesh.matching else "bearing"
            interfaces[seat] = {"sides": [f"{side}.{bearing}", f"{half}.{seat}"], **contact}
            body = mesh_of(content, half, half, 1e-3)
            area = float(face_of(body.nodes, body.faces["cut"]).areas.sum())
            loads[half] = {"face": f"{half}.cut", "traction": [0.0, 0.0, up * PULL / area], "law": tighten}
    scene = {
        "name": "flange",
        "material": {"steel": STEEL.table()},
        "mesh": {"flange": {"file": str(file), "scale": 1e-3, "material": "steel"}},
        "interface": interfaces,
        "boundary": {"held": {"type": "fixed", "face": "lower.rim"}},
        "load": loads,
        "time": {"end": 1.0, "instants": 10, "quasi_static": True},
        "output": {"fields": True, "every": 10},
    }
    return Case("flange", 10, FRICTION, scene)


@dataclass(frozen=True)
class FlangeResult:
    """Last instant by one code: CPU seconds, force of the joint on the lower ring (3,), N, mean displacement of the
    upper rim (3,), m, displacements of all nodes (n_node, 3), m."""

    seconds: float
    force: tools.Array
    rim: tools.Array
    moved: tools.Array

    def line(self, name: str, reference: FlangeResult, applied: float) -> str:
        """Row of the table; distances to a reference."""
        off = self.rim / reference.rim - 1.0
        balance = self.force[0] / applied - 1.0
        return (
            f"    {name:24} {self.seconds:7.1f} s   shear {self.force[0]:8.2f} N ({balance:+.0e})   rim u_x "
            f"{1e6 * self.rim[0]:6.4f} um ({off[0]:+.2%}), u_z {1e6 * self.rim[2]:6.4f} um ({off[2]:+.2%})"
        )


def of_package(case: Case, solver: dict[str, Any]) -> FlangeResult:
    """This package, from the scene to the histories."""
    outcome: list[Outcome] = []
    scene = latin_fmu.scene_from_dict({**case.description, "solver": solver})
    seconds = cpu(lambda: outcome.append(latin_fmu.solve(scene)))
    last = outcome[0]
    if not last.converged:
        raise ValueError(last.status)
    fields = {n: h.displacement[-1] for n, h in last.substructures.items() if h.displacement is not None}
    face = discretise(scene).bodies["upper"].face("rim")
    return FlangeResult(
        seconds, last.interfaces["joint"].force()[-1], mean(face, fields["upper"]), np.concatenate([*fields.values()])
    )


def of_calculix(case: Case, choices: DeckChoices, limit: float) -> FlangeResult | None:
    """CalculiX on the deck of the scene; None where it did not reach the end."""
    ready = prepared(case, {})
    deck = export_deck(ready, replace(choices, every=True, last=True))
    there = run(deck.text, float(ready.time[-1]), limit)
    fields = there.printed.displacement
    if fields is None or not there.complete:
        return None
    moved = {name: fields[-1][deck.nodes[name] - 1] for name in ready.bodies}
    force = there.printed.force["UPPER_JOINT", "LOWER_JOINT"][-1]
    rim = mean(ready.bodies["upper"].face("rim"), moved["upper"])
    return FlangeResult(there.seconds, -force, rim, np.concatenate([*moved.values()]))


def mean(face: Face, moved: tools.Array) -> tools.Array:
    """Mean by area of nodal displacements (n_node, 3) over a face, (3,)."""
    weighted: tools.Array = face.areas @ moved[face.nodes] / face.areas.sum()
    return weighted


def applied(case: Case) -> float:
    """Shear that the load brings, N."""
    face = prepared(case, {}).bodies["upper"].face("rim")
    return SHEAR * float(face.areas.sum())


def compare(limit: float) -> dict[str, FlangeResult]:
    """Print both tables; the results by name."""
    results: dict[str, FlangeResult] = {}
    with TemporaryDirectory() as folder:
        path = Path(folder)
        same = ONE.made(path / "same.msh")
        shear = applied(same)
        of_package(same, {})
        for name, solver in VARIANTS.items():
            results[name] = of_package(same, solver)
        other = of_calculix(same, PENALTY, limit)
        if other is not None:
            results["CalculiX"] = other
        reference = results["CalculiX" if other is not None else next(iter(VARIANTS))]
        nodes = len(reference.moved)
        print(f"flange, one mesh of {nodes} nodes, 4-node tetrahedra; distances to CalculiX", flush=True)
        for name, result in results.items():
            print(result.line(name, reference, shear), flush=True)
        print("flange, 10-node tetrahedra; distances to the matching mesh", flush=True)
        for name, mesh in QUADRATIC.items():
            case = mesh.made(path / "quadratic.msh")
            results[name] = of_package(case, {})
            print(results[name].line(name, results[next(iter(QUADRATIC))], applied(case)), flush=True)
    return results


def main(limit: float) -> int:
    """Compare where gmsh is installed."""
    if find_spec("gmsh") is None:
        print(NO_GMSH)
        return 0
    compare(limit)
    return 0
