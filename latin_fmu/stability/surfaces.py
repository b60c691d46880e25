"""Faces of curved and of quadratic cells, and bad tetrahedra: what lies on them is uniform, or known in closed form;
boxes of any type of cells as mesh files."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Mapping
from functools import partial
from math import pi
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import Any, Final

import numpy as np

from ..fem.mesh import FacetSet, Mesh, boundary, box_mesh
from ..fem.reference_cells import CELL_EDGES, HEX_FACES
from ..latin.outcome import Array
from ..mesh_files.gmsh import write_gmsh
from .case import Bench, Case, Measure, against_round_off, contact_laws, energy_laws, make_case
from .scenes import Description

KUHN: Final = ((0, 1, 2, 6), (0, 2, 3, 6), (0, 3, 7, 6), (0, 7, 4, 6), (0, 4, 5, 6), (0, 5, 1, 6))
WEDGES: Final = ((0, 1, 3, 4, 5, 7), (1, 2, 3, 5, 6, 7))
LINEAR: Final = {"tetra10": "tetra", "hexahedron20": "hexahedron", "hexahedron27": "hexahedron", "wedge15": "wedge"}


def typed_box(cell_type: str, origin: Array, size: Array, elements: tuple[int, int, int]) -> Mesh:
    """Box of cells of one type with its six faces."""
    box = box_mesh(np.asarray(origin, float), np.asarray(size, float), elements)
    cells = box.blocks[0].cells
    corner = LINEAR.get(cell_type, cell_type)
    if corner == "tetra":
        cells = cells[:, KUHN].reshape(-1, 4)
    elif corner == "wedge":
        cells = cells[:, WEDGES].reshape(-1, 6)
    nodes = box.nodes
    if cell_type != corner:
        groups = [np.array(CELL_EDGES[corner])]
        if cell_type == "hexahedron27":
            groups += [np.array(HEX_FACES), np.arange(8)[None]]
        parts = [cells]
        places = [nodes]
        count = len(nodes)
        for group in groups:
            # an edge or face is known by its corners in ascending order: cells that share it get one node
            keys = np.sort(cells[:, group], axis=2).reshape(-1, group.shape[1])
            unique, inverse = np.unique(keys, axis=0, return_inverse=True)
            places.append(nodes[unique].mean(axis=1))
            parts.append(count + inverse.reshape(len(cells), -1))
            count += len(unique)
        nodes, cells = np.concatenate(places), np.concatenate(parts, axis=1)
    mesh = Mesh.uniform(nodes, cell_type, cells)
    return Mesh(nodes, mesh.blocks, _box_faces(mesh))


def _box_faces(mesh: Mesh) -> dict[str, FacetSet]:
    low = mesh.nodes.min(axis=0)
    high = mesh.nodes.max(axis=0)
    skin = boundary(mesh)
    faces = {}
    for axis, letter in enumerate("xyz"):
        for end, value in (("min", low[axis]), ("max", high[axis])):
            # of the extent: nodes of a plane of the box have its coordinate but for round-off
            near = 1e-9 * np.ptp(mesh.nodes[:, axis])
            on = [b.facets[(np.abs(mesh.nodes[b.facets][..., axis] - value) < near).all(axis=1)] for b in skin.blocks]
            faces[letter + end] = FacetSet.of(*(f for f in on if len(f)))
    return faces


def write_mesh(file: Path, mesh: Mesh, place: Callable[[Array], Array] | None = None) -> None:
    """Volume group "body" and the faces as surface groups; ``place`` moves the nodes."""
    faces = {name: (2, [(b.kind, b.facets) for b in face.blocks]) for name, face in mesh.faces.items()}
    body = {"body": (3, [(b.cell_type, b.cells) for b in mesh.blocks])}
    if place is None:
        places = mesh.nodes
    else:
        places = place(mesh.nodes)
    write_gmsh(file, places, {**body, **faces})


def turned(axis: Array, degrees: float) -> Array:
    """Rotation matrix (3, 3)."""
    n = np.asarray(axis, float) / np.linalg.norm(axis)
    angle = np.radians(degrees)
    cross = np.array([[0, -n[2], n[1]], [n[2], 0, -n[0]], [-n[1], n[0], 0]])
    rotation: Array = np.eye(3) + np.sin(angle) * cross + (1 - np.cos(angle)) * cross @ cross
    return rotation


QUADRATIC = ("tetra10", "hexahedron20", "hexahedron27")
Place = Callable[[Array], Array]


def surface_cases() -> Iterator[Case]:
    """Pressed and impacting faces of quadratic cells, slivers, a shaft in a sleeve, a curved foot that bounces."""
    case = partial(make_case, "surface")
    for cell in (*QUADRATIC, "tetra"):
        yield case(f"pressed faces of {cell}", "uniform pressure (patch test)", _patch, cell, 1.0, 0.0)
    for cell in QUADRATIC:
        yield case(f"edge across faces of {cell}", "equilibrium, symmetry, no tension", _edge, cell)
        yield case(f"bars of {cell} that meet", "stress Z v/2, uniform", _bars, cell)
    for aspect, flat in ((100.0, 0.0), (1.0, 0.02), (1.0, 0.002)):
        if not flat:
            name = f"sliver tetrahedra, aspect {aspect:g}"
        else:
            name = f"sliver tetrahedra, flat to {flat:g}"
        yield case(f"{name}, pressed", "uniform pressure (patch test)", _patch, "tetra", aspect, flat)
        yield case(f"{name}, meeting", "force of the same discrete problem at round-off", _slivers, aspect, flat)
    for cell in ("hexahedron", "hexahedron20"):
        yield case(f"shaft in a sleeve of {cell}, pressed from inside", "Lame's thick cylinder", _shaft, cell)
    for friction in (0.0, 0.3):
        name = f"curved foot bounces, mu {friction:g}"
        yield case(name, "impulse between m v and 2 m v, symmetry, energy, round-off", _bounce, friction)


def blocks(folder: Path, bodies: Mapping[str, tuple[Mesh, Place | None]], time: dict[str, Any]) -> Description:
    """A scene of bodies of unit stiffness and density, Poisson's ratio 0, whose meshes are written to ``folder``."""
    for name, (mesh, place) in bodies.items():
        write_mesh(folder / f"{name}.msh", mesh, place)
    return {
        "name": "surfaces",
        "material": {"m": {"young_modulus": 1.0, "poisson_ratio": 0.0, "density": 1.0}},
        "substructure": {
            name: {"material": "m", "mesh": {"file": str(folder / f"{name}.msh"), "group": "body"}} for name in bodies
        },
        "time": time,
        "interface": {"meet": {"sides": [f"{face}.z{end}" for face, end in zip(bodies, ("max", "min"), strict=False)]}},
        "boundary": {},
        "load": {},
    }


def squeezed(flat: float, height: float, elements: int) -> Place | None:
    """Moves the inner node planes towards those below until ``flat`` of a layer is left: slivers and their opposite."""
    if not flat:
        return None

    def place(nodes: Array) -> Array:
        moved, layer = nodes.copy(), height / elements
        low = nodes[:, 2].min()
        number = np.round((nodes[:, 2] - low) / layer).astype(int)
        # every second layer is thin, the next one thicker by as much; the top stays
        odd = (number % 2 == 1) & (number < elements)
        moved[odd, 2] -= (1.0 - flat) * layer
        return moved

    return place


def _two(folder: Path, cell: str, aspect: float, flat: float, time: dict[str, Any]) -> Description:
    height, n = 1.0 / aspect, 4
    size, elements = np.array([1.0, 1.0, height]), (2, 2, n)
    low, up = (typed_box(cell, np.array([0.0, 0.0, z]), size, elements) for z in (0.0, height))
    move = squeezed(flat, height, n)
    return blocks(folder, {"low": (low, move), "up": (up, move)}, time)


def _patch(cell: str, aspect: float, flat: float, bench: Bench) -> list[Measure]:
    """A uniform stress is in the space of every cell: exact. Limit: a thousand times the tolerance 1e-9."""
    with TemporaryDirectory() as folder:
        scene = _two(Path(folder), cell, aspect, flat, {"end": 1.0, "instants": 2, "quasi_static": True})
        _press(scene, "up.zmax")
        names = [("low", "z"), *((body, axis) for body in ("low", "up") for axis in "xy")]
        scene["boundary"] = {f"{b}_{a}": {"type": "symmetry", "face": f"{b}.{a}min"} for b, a in names}
        history = bench.converged(scene).interfaces["meet"]
    # traction on E along its outward normal
    pressure = -np.einsum("tpc,pc->tp", history.traction, history.normals)[-1] / 1e-3
    return [
        Measure("pressure at a point off by", float(np.abs(pressure - 1.0).max()), 1.4e-8),
        Measure("resultant off by", abs(float(history.normal_resultant()[-1]) / 1e-3 - 1.0), 4e-9),
    ]


def _press(scene: Description, face: str, tolerance: float = 1e-9) -> None:
    """A pressure of 1e-3 that rises to the end, on bodies with a Poisson's ratio, solved far."""
    ramp = {"type": "table", "times": [0.0, 1.0], "values": [0.0, 1.0]}
    scene["material"]["m"]["poisson_ratio"] = 0.3
    scene["load"] = {"press": {"face": face, "pressure": 1e-3, "law": ramp}}
    scene["solver"] = {"tolerance": tolerance, "max_iterations": 500}


def _edge(cell: str, bench: Bench) -> list[Measure]:
    """A narrower block whose edges lie across the faces below it, in their middle. Limits: a thousand times the
    tolerance 1e-9, and the symmetry of the meshes, which those of tetrahedra lack."""
    with TemporaryDirectory() as folder:
        low = typed_box(cell, np.array([-1.0, -1.0, 0.0]), np.array([2.0, 2.0, 1.0]), (4, 4, 2))
        up = typed_box(cell, np.array([-0.75, -0.75, 1.0]), np.array([1.5, 1.5, 1.0]), (3, 3, 2))
        time = {"end": 1.0, "instants": 2, "quasi_static": True}
        scene = blocks(Path(folder), {"low": (low, None), "up": (up, None)}, time)
        _press(scene, "up.zmax")
        scene["interface"]["meet"]["friction_coefficient"] = 0.3
        scene["boundary"] = {"base": {"type": "fixed", "face": "low.zmin"}}
        solution = bench.converged(scene)
    force = solution.interfaces["meet"].force()[-1]
    total = 1e-3 * 1.5**2
    measures = [Measure("resultant off by", abs(float(np.abs(force[2])) / total - 1.0), 4e-9)]
    measures.append(Measure("resultant along the face", float(np.abs(force[:2]).max()) / total, 6e-10))
    return [*measures, *contact_laws(solution)]


def _bars(cell: str, bench: Bench) -> list[Measure]:
    """Unit bars of 20 cells, one thrown at the other: stress 1/2 for two transits; limits of bars of linear cells."""
    n = 20
    with TemporaryDirectory() as folder:
        bars = [typed_box(cell, np.array([0.0, 0.0, z]), np.array([0.1, 0.1, 1.0]), (1, 1, n)) for z in (0.0, 1.0)]
        time = {"end": 1.8, "instants": round(1.8 * n)}
        scene = blocks(Path(folder), dict(zip(("low", "up"), ((b, None) for b in bars), strict=True)), time)
        scene["substructure"]["low"]["initial_velocity"] = [0.0, 0.0, 1.0]
        scene["output"] = {"energy": True}
        solution = bench.converged(scene)
    history, area = solution.interfaces["meet"], 0.01
    pressure = -np.einsum("tpc,pc->tp", history.traction, history.normals)
    stress = history.normal_resultant() / area
    # of 36 steps: behind the ripple of the front; the wave comes back after 40
    settled = stress[14:34]
    return [
        Measure("mean stress off by", abs(float(settled.mean()) / 0.5 - 1.0), 1e-3),
        Measure("ripple after 14 steps", float(np.abs(settled / 0.5 - 1.0).max()), 2e-2),
        Measure(
            "mean pressure of a point off by", float(np.abs(pressure[14:34].mean(axis=0) / 0.5 - 1.0).max()), 5.4e-3
        ),
        *energy_laws(solution),
    ]


def _slivers(aspect: float, flat: float, bench: Bench) -> list[Measure]:
    with TemporaryDirectory() as folder:
        step = 0.2 / aspect
        scene = _two(Path(folder), "tetra", aspect, flat, {"end": 30 * step, "instants": 30})
        scene["material"]["m"]["poisson_ratio"] = 0.3
        scene["interface"]["meet"]["friction_coefficient"] = 0.3
        scene["substructure"]["low"]["initial_velocity"] = [0.3, 0.0, 1.0]
        scene["output"] = {"energy": True}
        return against_round_off(bench, scene)


# -- curved faces ----------------------------------------------------------------------------------------------------
INNER = 1.0
MIDDLE = 2.0
OUTER = 3.0


def _shaft(cell: str, bench: Bench) -> list[Measure]:
    """A quarter of a hollow shaft in a sleeve of the same material, plane strain, pressure p inside: at the joint
    p a^2/(c^2 - a^2) (c^2/b^2 - 1). Flat facets and linear fields: the error falls with h^2, by 2.8 at least where h is
    halved; at 15 degrees an element, h^2/8 = 0.9 % by the chords alone: 3 %; quadratic cells a tenth."""
    exact = INNER**2 / (OUTER**2 - INNER**2) * (OUTER**2 / MIDDLE**2 - 1.0)
    off = [abs(_joint_pressure(cell, n, bench) / exact - 1.0) for n in (3, 6)]
    if cell == "hexahedron":
        allowed = 0.03
    else:
        allowed = 0.003
    return [
        Measure("pressure off by, 6 around a quarter", off[1], allowed),
        Measure("2.8 over its fall from 3 around", 2.8 * off[1] / off[0], 1.0),
    ]


def _joint_pressure(cell: str, n: int, bench: Bench) -> float:
    """Mean pressure of the joint over that inside, with n cells around the quarter and across each wall."""

    def quarter(nodes: Array) -> Array:
        r, angle, z = nodes.T
        return np.stack([r * np.cos(angle), r * np.sin(angle), z], axis=1)

    with TemporaryDirectory() as folder:
        size = np.array([1.0, pi / 2, 0.5])
        walls = [typed_box(cell, np.array([r, 0.0, 0.0]), size, (n, n, 1)) for r in (INNER, MIDDLE)]
        bodies = dict(zip(("shaft", "sleeve"), ((wall, quarter) for wall in walls), strict=True))
        scene = blocks(Path(folder), bodies, {"end": 1.0, "instants": 1, "quasi_static": True})
        _press(scene, "shaft.xmin", tolerance=1e-8)
        scene["interface"] = {"meet": {"sides": ["shaft.xmax", "sleeve.xmin"], "friction_coefficient": 0.2}}
        faces = [f"{body}.{face}" for body in bodies for face in ("ymin", "ymax", "zmin", "zmax")]
        scene["boundary"] = {f.replace(".", "_"): {"type": "symmetry", "face": f} for f in faces}
        history = bench.converged(scene).interfaces["meet"]
    pressure = -np.einsum("pc,pc->p", history.traction[-1], history.normals) / 1e-3
    return float(pressure @ history.areas / history.areas.sum())


def _bounce(friction: float, bench: Bench) -> list[Measure]:
    """A unit cube with a curved foot of radius 2, thrown on a plane: what bounces gets back part of its
    velocity, 0 to 1. Straight down it stays on its axis; askew its friction is below mu times the impulse."""
    speed, radius = 0.02, 2.0

    def foot(nodes: Array) -> Array:
        moved = nodes.copy()
        moved[:, 2] += (1.0 - nodes[:, 2]) * (nodes[:, 0] ** 2 + nodes[:, 1] ** 2) / (2.0 * radius)
        return moved

    with TemporaryDirectory() as folder:
        cube = typed_box("hexahedron", np.array([-0.5, -0.5, 0.0]), np.ones(3), (6, 6, 4))
        scene = blocks(Path(folder), {"cube": (cube, foot)}, {"end": 12.0, "instants": 240})
        scene["material"]["m"]["poisson_ratio"] = 0.3
        ground = {"point": [0.0, 0.0, -0.01], "normal": [0.0, 0.0, 1.0]}
        scene["interface"] = {
            "meet": {"sides": ["cube.zmin", "ground"], "ground": ground, "friction_coefficient": friction}
        }
        if friction:
            aside = speed
        else:
            aside = 0.0
        scene["substructure"]["cube"]["initial_velocity"] = [aside, 0.0, -speed]
        scene["output"] = {"energy": True}
        measures = against_round_off(bench, scene)
        solution = bench.converged(scene, counted=False)
    received = solution.interfaces["meet"].impulse(solution.time)[-1]
    mass = 1.0 - 1.0 / (12.0 * radius)  # without the mean of (x2 + y2)/(2 R) over the foot
    normal, along = abs(float(received[2])), float(np.hypot(received[0], received[1]))
    return [
        *measures,
        Measure("half the impulse over m v, less 3/4", abs(normal / (mass * speed) / 2.0 - 0.75), 0.25),
        Measure("impulse along the plane over mu times it, at most", along / normal, friction),
        Measure("sideways", abs(float(received[1])) / normal, 2.1e-15),
    ]
