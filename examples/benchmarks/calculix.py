"""CalculiX (ccx): the input deck of a scene, a run, and what it prints.

Same mesh, materials, conditions, loads, steps: 8-node hexahedra with full integration (C3D8), 4-node or 10-node
tetrahedra (C3D4, C3D10); dynamics by the Hilber-Hughes-Taylor scheme of the scene, or statics; interfaces as
face-to-face penalty contact with Coulomb friction, or bonded by merging their nodes. SI units.
"""

from __future__ import annotations

import os
import re
import shutil
import subprocess
from collections.abc import Iterable, Iterator
from contextlib import suppress
from dataclasses import dataclass
from pathlib import Path
from tempfile import TemporaryDirectory

import numpy as np
from numpy.typing import NDArray

from latin_fmu.assembly.problem import DiscretisedProblem
from latin_fmu.fem.mesh import Mesh
from latin_fmu.scene.boundaries import AXES, Fixed, PrescribedDisplacement, PrescribedVelocity, Symmetry
from latin_fmu.scene.fields import split_face
from latin_fmu.scene.materials import MaterialTable

Array = NDArray[np.float64]


# -- cards ------------------------------------------------------------------------------------------------------------
# Elements of CalculiX by type of cell, and the local corners of their faces in the order of the numbers it gives them.
ELEMENTS = {"hexahedron": "C3D8", "tetra": "C3D4", "tetra10": "C3D10"}
FACES = {
    "hexahedron": ((0, 1, 2, 3), (4, 5, 6, 7), (0, 1, 5, 4), (1, 2, 6, 5), (2, 3, 7, 6), (3, 0, 4, 7)),
    "tetra": ((0, 1, 2), (0, 3, 1), (1, 3, 2), (2, 3, 0)),
}
FACES["tetra10"] = FACES["tetra"]


def surface(face: str) -> str:
    """Name of a face in the deck."""
    return face.replace(".", "_").upper()


def facets(mesh: Mesh, side: str) -> Iterator[tuple[int, int]]:
    """Elements (from 0) and the numbers of their faces that make up a face of the mesh."""
    wanted = {frozenset(f) for b in mesh.faces[side].blocks for f in b.corners.tolist()}
    for element, cell in enumerate(mesh.blocks[0].cells.tolist()):
        for number, local in enumerate(FACES[mesh.blocks[0].cell_type], 1):
            if frozenset(cell[k] for k in local) in wanted:
                yield element, number


def facet_area(mesh: Mesh, side: str) -> float:
    """Mean area of the facets of a plane face made of parallelograms or triangles, m2."""
    corner = mesh.nodes[mesh.faces[side].blocks[0].facets]
    sides = corner[:, 1] - corner[:, 0], corner[:, -1] - corner[:, 0]
    return float(np.linalg.norm(np.cross(*sides), axis=1).mean()) / (2.0 if corner.shape[1] == 3 else 1.0)


def amplitude(name: str, time: Array, values: Array) -> Iterator[str]:
    """A table, four pairs a line."""
    yield f"*AMPLITUDE, NAME={name.upper()}"
    pairs = [f"{t:.9e}, {v:.9e}" for t, v in zip(time, values, strict=True)]
    for first in range(0, len(pairs), 4):
        yield ", ".join(pairs[first : first + 4])


def wrapped(numbers: Iterable[int]) -> Iterator[str]:
    """Numbers, twelve a line."""
    texts = [str(int(n)) for n in numbers]
    for first in range(0, len(texts), 12):
        yield ", ".join(texts[first : first + 12])


def laws(ready: DiscretisedProblem) -> Iterator[str]:
    """Amplitudes at the instants of the scene; linear between them, as in the scene."""
    scene, time = ready.scene, ready.time
    for name, load in scene.load.items():
        yield from amplitude(f"A_{name}", time, load.law.sample(time))
    for name, boundary in scene.boundary.items():
        if isinstance(boundary, PrescribedDisplacement):
            yield from amplitude(f"B_{name}", time, boundary.law.sample(time))
        elif isinstance(boundary, PrescribedVelocity):
            speed = boundary.law.sample(time)
            moved = np.concatenate([[0.0], np.cumsum(0.5 * np.diff(time) * (speed[1:] + speed[:-1]))])
            yield from amplitude(f"B_{name}", time, moved)


def held(ready: DiscretisedProblem) -> Iterator[str]:
    """What does not move."""
    yield "*BOUNDARY"
    for boundary in ready.scene.boundary.values():
        if isinstance(boundary, Fixed):
            axes = [AXES.index(c) for c in boundary.components]
        elif isinstance(boundary, Symmetry):
            name, side = split_face(boundary.face)
            mesh = ready.bodies[name].mesh
            axes = [int(np.argmin(np.ptp(mesh.nodes[mesh.faces[side].nodes], axis=0)))]
        elif isinstance(boundary, PrescribedDisplacement | PrescribedVelocity):
            continue
        else:
            raise ValueError(f"no counterpart in the deck: boundary of type {boundary.type}")
        for axis in axes:
            yield f"N_{surface(boundary.face)}, {axis + 1}, {axis + 1}"


def moved(ready: DiscretisedProblem) -> Iterator[str]:
    """What moves as prescribed."""
    for name, boundary in ready.scene.boundary.items():
        if isinstance(boundary, PrescribedDisplacement | PrescribedVelocity):
            yield f"*BOUNDARY, AMPLITUDE=B_{name.upper()}"
            for component, value in zip(boundary.components, boundary.value, strict=True):
                axis = AXES.index(component) + 1
                yield f"N_{surface(boundary.face)}, {axis}, {axis}, {value:.9e}"


# -- deck -------------------------------------------------------------------------------------------------------------
@dataclass(frozen=True)
class Choices:
    """What a scene leaves open.

    Attributes
    ----------
    bonded : nodes that coincide are one, no contact.
    stiffness : penalty of the contact pressure, in units of E/h of the softer side, h the element size. stick : slope
        of the friction before slip, in units of the penalty. alpha : of the HHT scheme; that of the scene where None.
    fixed : steps of the scene only; else CalculiX may cut them. displacements : print them for all nodes,
        ``last``: at the last instant only. stresses : at
        the nodes, means of the elements around, at the last instant.
    """

    bonded: bool = False
    stiffness: float = 10.0
    stick: float = 0.1
    alpha: float | None = None
    fixed: bool = False
    displacements: bool = False
    last: bool = False
    stresses: bool = False


class Deck:
    """Numbers of nodes and elements of the whole assembly, and the lines of the deck."""

    def __init__(self, ready: DiscretisedProblem, choices: Choices) -> None:
        self.ready, self.choices = ready, choices
        self._bodies = ready.bodies
        counts = [b.mesh.n_node for b in self._bodies.values()]
        cells = [b.mesh.n_cell for b in self._bodies.values()]
        number = np.arange(sum(counts))
        if choices.bonded:
            points = np.concatenate([b.mesh.nodes for b in self._bodies.values()])
            size = float(np.ptp(points, axis=0).max())
            rounded = np.round(points / size, 9) + 0.0
            number = np.unique(rounded, axis=0, return_inverse=True)[1].ravel()
        starts = np.cumsum([0, *counts[:-1]])
        self.node = {n: number[s : s + c] + 1 for n, s, c in zip(self._bodies, starts, counts, strict=True)}
        ends = np.cumsum([0, *cells])
        self._element = {n: int(e) + 1 for n, e in zip(self._bodies, ends, strict=False)}

    def text(self) -> str:
        """The deck."""
        return "\n".join(self._lines()) + "\n"

    def _lines(self) -> Iterator[str]:
        yield from self._mesh()
        yield from self._materials()
        yield from self._surfaces()
        if not self.choices.bonded:
            yield from self._contacts()
        yield from laws(self.ready)
        yield from held(self.ready)
        yield "*STEP, INC=1000000"
        yield from self._procedure()
        yield from moved(self.ready)
        yield from self._loads()
        yield from self._output()
        yield "*END STEP"

    # -- model -----------------------------------------------------------------------------------------------
    def _mesh(self) -> Iterator[str]:
        yield "*NODE, NSET=NALL"
        seen: set[int] = set()
        for name, body in self._bodies.items():
            for number, place in zip(self.node[name].tolist(), body.mesh.nodes.tolist(), strict=True):
                if number not in seen:
                    seen.add(number)
                    yield f"{number}, " + ", ".join(f"{x:.11e}" for x in place)
        for name, body in self._bodies.items():
            block = body.mesh.blocks[0]
            yield f"*ELEMENT, TYPE={ELEMENTS[block.cell_type]}, ELSET={name.upper()}"
            numbered = self.node[name][block.cells]
            for i, nodes in enumerate(numbered.tolist(), self._element[name]):
                yield ", ".join(map(str, (i, *nodes)))

    def _materials(self) -> Iterator[str]:
        for name, material in self.ready.scene.material.items():
            yield from _orientation(name, material)
            yield f"*MATERIAL, NAME={name.upper()}"
            yield from _elastic(material)
            yield "*DENSITY"
            yield f"{material.density:.9e}"
        for name, body in self.ready.scene.substructure.items():
            turned = self.ready.scene.material[body.material].orthotropic is not None
            own = f", ORIENTATION={body.material.upper()}" if turned else ""
            yield f"*SOLID SECTION, ELSET={name.upper()}, MATERIAL={body.material.upper()}{own}"

    def _faces_named(self) -> list[str]:
        """Faces that something is done with, each once."""
        scene = self.ready.scene
        named = [s for i in scene.interface.values() for s in i.sides]
        named += [b.face for b in scene.boundary.values() if hasattr(b, "face")]
        named += [load.face for load in scene.load.values()]
        return sorted(set(named))

    def _surfaces(self) -> Iterator[str]:
        for face in self._faces_named():
            name, side = split_face(face)
            yield f"*SURFACE, NAME={surface(face)}, TYPE=ELEMENT"
            for element, number in facets(self._bodies[name].mesh, side):
                yield f"{element + self._element[name]}, S{number}"
            yield f"*NSET, NSET=N_{surface(face)}"
            yield from wrapped(np.sort(self.node[name][self._bodies[name].mesh.faces[side].nodes]))

    def _contacts(self) -> Iterator[str]:
        for name, interface in self.ready.scene.interface.items():
            sides = [self._bodies[split_face(s)[0]] for s in interface.sides]
            moduli = [b.shape.elasticity.young_moduli[0] for b in sides]
            size = min(
                float(np.sqrt(facet_area(b.mesh, split_face(s)[1])))
                for b, s in zip(sides, interface.sides, strict=True)
            )
            slope = self.choices.stiffness * min(moduli) / size
            yield f"*SURFACE INTERACTION, NAME={name.upper()}"
            yield "*SURFACE BEHAVIOR, PRESSURE-OVERCLOSURE=LINEAR"
            yield f"{slope:.9e}"
            if interface.friction_coefficient > 0.0:
                yield "*FRICTION"
                yield f"{interface.friction_coefficient:.9g}, {self.choices.stick * slope:.9e}"
            yield f"*CONTACT PAIR, INTERACTION={name.upper()}, TYPE=SURFACE TO SURFACE"
            yield f"{surface(interface.sides[1])}, {surface(interface.sides[0])}"  # slave, master

    # -- step ------------------------------------------------------------------------------------------------
    def _procedure(self) -> Iterator[str]:
        choices, dt, end = self.choices, self.ready.dt, float(self.ready.time[-1])
        direct = ", DIRECT" if choices.fixed else ""
        if self.ready.scene.time.quasi_static:
            yield f"*STATIC{direct}"
        else:
            alpha = self.ready.scheme.memory_weight if choices.alpha is None else choices.alpha
            yield f"*DYNAMIC, ALPHA={alpha:.9g}{direct}"
        limits = "" if choices.fixed else f", {1e-6 * dt:.9e}, {dt:.9e}"
        yield f"{dt:.9e}, {end:.9e}{limits}"

    def _loads(self) -> Iterator[str]:
        for name, load in self.ready.scene.load.items():
            body, side = split_face(load.face)
            mesh = self._bodies[body].mesh
            if load.pressure is not None:
                yield f"*DLOAD, AMPLITUDE=A_{name.upper()}"
                for element, number in facets(mesh, side):
                    yield f"{element + self._element[body]}, P{number}, {load.pressure:.9e}"
                continue
            face = self._bodies[body].face(side)
            yield f"*CLOAD, AMPLITUDE=A_{name.upper()}"
            for axis, part in enumerate(load.traction or (), 1):
                for node, area in zip(self.node[body][face.nodes].tolist(), face.areas, strict=True):
                    if part:
                        yield f"{node}, {axis}, {part * area:.9e}"

    def _output(self) -> Iterator[str]:
        if self.choices.displacements:
            yield f"*NODE PRINT, NSET=NALL, FREQUENCY={1_000_000 if self.choices.last else 1}"
            yield "U"
        if self.choices.stresses:
            yield from ("*EL FILE, FREQUENCY=1000000", "S")
        if not self.choices.bonded:
            for interface in self.ready.scene.interface.values():
                yield f"*CONTACT PRINT, SLAVE={surface(interface.sides[1])}, MASTER={surface(interface.sides[0])}"
                yield "CF"


# -- run --------------------------------------------------------------------------------------------------------------
def _orientation(name: str, material: MaterialTable) -> Iterator[str]:
    """Axes of an orthotropic material."""
    if material.orthotropic is not None:
        axes = material.orthotropic.axes
        rows = ((1.0, 0.0, 0.0), (0.0, 1.0, 0.0)) if axes is None else axes.rows[:2]
        yield f"*ORIENTATION, NAME={name.upper()}, SYSTEM=RECTANGULAR"
        yield ", ".join(f"{x:.12g}" for row in rows for x in row)


def _elastic(material: MaterialTable) -> Iterator[str]:
    own = material.orthotropic
    if own is None:
        yield "*ELASTIC"
        yield f"{material.young_moduli[0]:.9e}, {material.poisson_ratio:.9g}"
        return
    yield "*ELASTIC, TYPE=ENGINEERING CONSTANTS"
    constants = [f"{x:.9e}" for x in (*own.young_moduli, *own.poisson_ratios, *own.shear_moduli)]
    yield ", ".join(constants[:8])  # eight numbers a line at most
    yield f"{constants[8]}, 294."


MISSING = "CalculiX (ccx) is not installed: Debian and Ubuntu have it as calculix-ccx; nothing is compared with it"
_TIME = re.compile(r"time\s+([-+.\dEe]+)\s*$")
_LONG = re.compile(r"(\.\d+)([+-]\d{3})\b")  # an exponent of three digits pushes its E out
_PAIR = re.compile(r"slave set (\w+), master set (\w+) and time")


@dataclass(frozen=True)
class Printed:
    """What a run left in its .dat file.

    Attributes
    ----------
    time : instants printed, s. displacement : (n_time, n_node, 3) by number of the node from 1, m, or None.
    force : total force on the slave surface (n_time, 3), N, by (slave, master). held : forces on the nodes that print
        them (n_time, n_node, 3), by number from 1, N, or None.
    """

    time: Array
    displacement: Array | None
    force: dict[tuple[str, str], Array]
    held: Array | None = None


@dataclass(frozen=True)
class Finished:
    """A run of ccx: CPU seconds, increments and iterations, and what it printed; ``complete``: reached the end."""

    seconds: float
    increments: int
    iterations: int
    complete: bool
    printed: Printed
    stress: Array | None = None


def installed() -> bool:
    """Whether there is a ccx to run."""
    return shutil.which("ccx") is not None


def run(deck: str, end: float, limit: float = 600.0) -> Finished:
    """Run ccx on one thread, at most ``limit`` seconds of wall clock; ``end`` is the last instant, s."""
    with TemporaryDirectory() as folder:
        place = Path(folder)
        (place / "deck.inp").write_text(deck)
        one = {**os.environ, "OMP_NUM_THREADS": "1", "CCX_NPROC_RESULTS": "1", "CCX_NPROC_EQUATION_SOLVER": "1"}
        before = os.times()
        with (place / "log").open("w") as log, suppress(subprocess.TimeoutExpired):
            subprocess.run(["ccx", "-i", "deck"], cwd=place, env=one, stdout=log, stderr=log, timeout=limit)
        after = os.times()
        seconds = after.children_user + after.children_system - before.children_user - before.children_system
        data = place / "deck.dat"
        printed = read(data.read_text()) if data.exists() else Printed(np.zeros(0), None, {})
        counts = _steps(place / "deck.sta")
        fields = place / "deck.frd"
        stress = stress_of(fields.read_text()) if fields.exists() else None
    complete = bool(len(printed.time)) and printed.time[-1] >= end * (1.0 - 1e-6)
    return Finished(seconds, len(counts), sum(counts), complete, printed, stress)


def _steps(path: Path) -> list[int]:
    """Iterations of every increment that was accepted."""
    if not path.exists():
        return []
    rows = [line.split() for line in path.read_text().splitlines()]
    return [int(r[3]) for r in rows if len(r) == 7 and r[0].isdigit()]


def read(text: str) -> Printed:
    """Contents of a .dat file."""
    moved: dict[float, Array] = {}
    held: dict[float, Array] = {}
    forces: dict[tuple[str, str], dict[float, Array]] = {}
    for title, body in _blocks(text):
        found = _TIME.search(title)
        if found is None:
            continue
        time = float(found.group(1))
        pair = _PAIR.search(title)
        kind = title.split()[0]
        if kind in ("displacements", "forces"):
            rows = np.array([_numbers(line) for line in body])
            field = np.zeros((int(rows[:, 0].max()), 3))
            field[rows[:, 0].astype(int) - 1] = rows[:, 1:]
            (moved if kind == "displacements" else held)[time] = field
        elif pair is not None:
            numbers = next(line for line in body if not line.lstrip().startswith("total"))
            forces.setdefault((pair[1], pair[2]), {})[time] = np.array([float(x) for x in numbers.split()[:3]])
    times = sorted(moved or held or next(iter(forces.values()), {}))
    return Printed(
        np.array(times),
        np.stack([moved[t] for t in times]) if moved else None,
        {pair: np.stack([found[t] for t in times]) for pair, found in forces.items()},
        np.stack([held[t] for t in times]) if held else None,
    )


def stress_of(text: str) -> Array | None:
    """Stresses (n_node, 6) at the nodes by number from 1, xx yy zz yz xz xy, of the last instant in a .frd file; None
    where it has none. A row has a key of 3 characters, a number of 10, and six values of 12."""
    blocks = text.split(" -4  STRESS")[1:]
    if not blocks:
        return None
    rows = [line for line in blocks[-1].split("\n -3")[0].splitlines() if line.startswith(" -1")]
    numbers = np.array([int(line[3:13]) for line in rows])
    values = np.array([[float(line[k : k + 12]) for k in range(13, 85, 12)] for line in rows])
    stress = np.full((numbers.max(), 6), np.nan)
    stress[numbers - 1] = values[:, [0, 1, 2, 4, 5, 3]]  # there xx yy zz xy yz zx
    return stress


def _numbers(line: str) -> list[float]:
    return [float(x) for x in _LONG.sub(r"\1E\2", line).split()]


def _blocks(text: str) -> Iterator[tuple[str, list[str]]]:
    """Title and lines of every block; the title is the line with the time."""
    title, body = "", []
    for line in text.splitlines():
        if not line.strip():
            continue
        if _TIME.search(line):
            if title:
                yield title, body
            title, body = line, []
        else:
            body.append(line)
    if title:
        yield title, body
