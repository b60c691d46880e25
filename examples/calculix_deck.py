"""Input deck for CalculiX (ccx) from a scene: same mesh, materials, conditions, loads, steps.

8-node hexahedra with full integration (C3D8) or 4-node tetrahedra (C3D4); dynamics by the Hilber-Hughes-Taylor scheme
of the scene, or statics; interfaces as face-to-face penalty contact with Coulomb friction, or bonded by merging their
nodes. SI units.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass

import numpy as np
from calculix_cards import ELEMENTS, facet_area, facets, surface, wrapped
from calculix_conditions import held, laws, moved

from latin_fmu.assembly.problem import DiscretisedProblem
from latin_fmu.scene.fields import split_face


@dataclass(frozen=True)
class Choices:
    """What a scene leaves open.

    Attributes
    ----------
    bonded : nodes that coincide are one, no contact.
    stiffness : penalty of the contact pressure, in units of E/h of the softer side, h the element size. stick : slope
        of the friction before slip, in units of the penalty. alpha : of the HHT scheme; that of the scene where None.
    fixed : steps of the scene only; else CalculiX may cut them. displacements : print them for all nodes,
        ``last``: at the last instant only.
    """

    bonded: bool = False
    stiffness: float = 10.0
    stick: float = 0.1
    alpha: float | None = None
    fixed: bool = False
    displacements: bool = False
    last: bool = False


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
            yield f"*MATERIAL, NAME={name.upper()}"
            yield "*ELASTIC"
            yield f"{material.young_modulus:.9e}, {material.poisson_ratio:.9g}"
            yield "*DENSITY"
            yield f"{material.density:.9e}"
        for name, body in self.ready.scene.substructure.items():
            yield f"*SOLID SECTION, ELSET={name.upper()}, MATERIAL={body.material.upper()}"

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
            moduli = [b.shape.material.young_modulus for b in sides]
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
        if not self.choices.bonded:
            for interface in self.ready.scene.interface.values():
                yield f"*CONTACT PRINT, SLAVE={surface(interface.sides[1])}, MASTER={surface(interface.sides[0])}"
                yield "CF"
