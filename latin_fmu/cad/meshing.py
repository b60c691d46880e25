"""Meshes of the parts: sizes by thickness, curvature, screws and contacts; tetrahedra of second order; names of faces.

Sizes are edges in mm. A part has ``THICKNESS`` thicknesses or ``ACROSS`` edges along its box, whichever is smaller; a
round face has edges of its circumference over a count; a contact face has ``CONTACT`` edges along its root area. Where
the contacts would have more unknowns than allowed, contact faces get larger edges, as long as that helps.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any, Final

import numpy as np

from .facts import CadAssembly, CadCylinder, CadPart, merged
from .geometry import round_face
from .neighbours import Skins
from .repair import TETRAHEDRON, CellRepair
from .sizes import PressedZone, Sizes, set_sizes

THICKNESS: Final = 3.0
"""Edge of a part over its thickness."""
ACROSS: Final = 5.0
"""Edges along the diagonal of the box of a part, at least."""
CONTACT: Final = 4.0
"""Edges along the root of the area of a contact face."""
FITTED: Final = 12.0
"""Edges around a round face that touches another one, as a pin in its hole."""
CLAMPED: Final = 5.0
"""Edges along the radius of the part of a contact face that a screw presses."""
_CONE: Final = 0.75, 0.5  # that radius: diameters of the shank (the head), and grips (a cone of some 30 degrees)
# the radius inside which parts lift off each other, likewise, and edges there over those in the pressed part
_RIM: Final = 0.75, 1.2, 1.6
_ALONG: Final = 1.6  # edges along the free shank of a screw, for its cut
TURN: Final = 8
"""Edges around a shank and its holes."""
_FASTENER: Final = 0.4  # edge of screws and nuts, beside their round faces, over the diagonal of their box
_ROUND: Final = 8  # edges around other round faces
FLOOR: Final = 0.12  # edge of a small feature over that of its part, at least
_POINT: Final = 6  # unknowns of a point of a contact
_TRIALS: Final = 9
_GAINED: Final = 0.98  # of the unknowns: larger edges give no fewer
_COARSEST: Final = 1.5  # factor on the edges of parts; those of contact faces may be larger still
_COARSER: Final = 1.15, 1.6  # edges from trial to trial


@dataclass(frozen=True)
class MeshWishes:
    """How finely to mesh.

    Attributes
    ----------
    size : the largest edge, mm; None: by the thickness of each part. finer : factor by which edges at screws and
        contacts are smaller. contacts : unknowns of contacts, at most. touch : distance up to which faces touch, mm.
    """

    size: float | None = None
    finer: float = 1.0
    contacts: int = 4000
    touch: float = 0.02


def part_size(part: CadPart, wishes: MeshWishes) -> float:
    """Edge of a part, mm."""
    own = min(THICKNESS * part.thickness, part.diagonal / ACROSS)
    return own if wishes.size is None else min(own, wishes.size)


class Mesher:
    """Meshes of an assembly whose faces are split.

    Parameters
    ----------
    gmsh : the module with the geometry. assembly : its parts, pairs, screws. numbers : of the volumes by part.
    skins : faces of these.
    """

    def __init__(
        self, gmsh: Any, assembly: CadAssembly, numbers: Mapping[str, int], skins: Skins, wishes: MeshWishes
    ) -> None:
        self._gmsh, self._assembly, self._numbers, self._skins = gmsh, assembly, numbers, skins
        self._wishes = wishes
        self._rounds = {name: self._round_faces(name) for name in numbers}
        self.contacts = self._contact_faces()
        self._fasteners = {s.part for s in assembly.screws if s.used} | {
            nut for s in assembly.screws if s.used and s.kind != "screw" for nut in s.threads
        }
        self._threads = {frozenset({s.part, part}) for s in assembly.screws if s.used for part in s.threads}
        self._free = {frozenset({s.part, part}) for s in assembly.screws if s.used for part in s.clamped}

    def _round_faces(self, name: str) -> dict[int, CadCylinder]:
        found = {face: round_face(self._gmsh, face) for face in self._skins.faces[name]}
        return {face: cylinder for face, cylinder in found.items() if cylinder is not None}

    def _contact_faces(self) -> dict[frozenset[str], dict[str, list[int]]]:
        """Faces of each part that touch each of its neighbours."""
        found: dict[frozenset[str], dict[str, list[int]]] = {}
        for pair in self._assembly.pairs:
            if not pair.faces[0]:
                continue
            sides: dict[str, list[int]] = {}
            for name, other in (pair.parts, pair.parts[::-1]):
                there = self._skins.faces[other]
                sides[name] = [
                    face for face in self._skins.faces[name] if self._skins.on_any(face, there, self._wishes.touch)
                ]
            found[frozenset(pair.parts)] = sides
        return found

    # -- sizes -------------------------------------------------------------------------------------------------------
    def sizes(self, coarser: float) -> Sizes:
        """Edges, those of flat contact faces and, less so, of parts by a factor ``coarser``."""
        sizes, finer = Sizes(), self._wishes.finer
        touching = {face for sides in self.contacts.values() for faces in sides.values() for face in faces}
        screwed = {s.part for s in self._assembly.screws if s.used}
        for part in self._assembly.parts:
            size = self._size(part.name, coarser)
            sizes.volumes[self._numbers[part.name]] = size
            screws = [s for s in self._assembly.screws if s.used and part.name in (s.part, *s.threads, *s.clamped)]
            for face in self._skins.faces[part.name]:
                radius = self._radius(face)
                sizes.faces[face] = size
                if radius is not None:
                    sizes.faces[face] = min(size, max(2.0 * np.pi * radius / _ROUND, FLOOR * size))
            for face, cylinder in self._rounds[part.name].items():
                around = 2.0 * np.pi * cylinder.radius
                if part.name in screwed or any(_around(s.axis, s.middle, cylinder) for s in screws):
                    along = [s.grip / _ALONG for s in screws if s.part == part.name and s.grip > 0.0]
                    sizes.faces[face] = min([size, around / (TURN * finer), *along])
                else:
                    fine = coarser * around / (FITTED * finer) if face in touching else np.inf
                    sizes.faces[face] = min(size, max(min(around / _ROUND, fine), FLOOR * size))
        edges: dict[int, list[float]] = {}
        for sides in self.contacts.values():
            for name, faces in sides.items():
                size = part_size(self._assembly.by_name[name], self._wishes)
                flat = [face for face in faces if face not in self._rounds[name]]
                area = sum(float(self._gmsh.model.occ.getMass(2, face)) for face in flat)
                for face in flat:
                    edges.setdefault(face, []).append(coarser * min(size, area**0.5 / (CONTACT * finer)))
        sizes.faces |= {face: min(found) for face, found in edges.items()}
        sizes.flat = sorted(edges)
        for screw in self._assembly.screws:
            if screw.used:
                radius = _CONE[0] * screw.diameter + _CONE[1] * screw.grip
                half = np.array(screw.axis) * (screw.grip + screw.diameter)
                size = coarser * radius / (CLAMPED * finer)
                sizes.pressed.append(PressedZone(screw.middle, half, radius, size))
                rim = _RIM[0] * screw.diameter + _RIM[1] * screw.grip
                sizes.pressed.append(PressedZone(screw.middle, half, rim, _RIM[2] * size))
        return sizes

    def _size(self, name: str, coarser: float) -> float:
        """Edge of a part, mm; that of small parts of a joint follows from their round faces and contacts."""
        part = self._assembly.by_name[name]
        size = min(coarser, _COARSEST) * part_size(part, self._wishes)
        if name in self._fasteners:
            return max(size, _FASTENER * part.diagonal)
        return size

    def _radius(self, face: int) -> float | None:
        """The smallest radius of curvature at places in a face, mm; None where it is flat."""
        if self._gmsh.model.getType(2, face) == "Plane":
            return None
        low, high = self._gmsh.model.getParametrizationBounds(2, face)
        grid = np.stack(np.meshgrid(*(np.linspace(low[i], high[i], 5)[1:-1] for i in (0, 1))), axis=-1).ravel()
        curvatures = np.abs(np.concatenate(self._gmsh.model.getPrincipalCurvatures(face, grid)[:2]))
        largest = float(curvatures[np.isfinite(curvatures)].max(initial=0.0))
        return 1.0 / largest if largest > 0.0 else None

    # -- meshing -----------------------------------------------------------------------------------------------------
    def mesh(self) -> dict[str, float]:
        """Mesh all parts; figures of the mesh.

        Trials of the surfaces alone come first, until the contacts have no more unknowns than wished.
        """
        model, coarser = self._gmsh.model, 1.0
        unknowns, before = 0, np.inf
        for _ in range(_TRIALS):
            set_sizes(self._gmsh, self.sizes(coarser), FLOOR)
            model.mesh.clear()
            model.mesh.generate(2)
            unknowns = self._contact_unknowns()
            if unknowns <= self._wishes.contacts or unknowns > _GAINED * before:
                break
            before = unknowns
            coarser *= min(max(_COARSER[0], (unknowns / self._wishes.contacts) ** 0.5), _COARSER[1])
        model.mesh.generate(3)
        model.mesh.setOrder(2)
        repaired, nearly = CellRepair(self._gmsh, self._numbers).repair()
        self._assembly.remarks += nearly
        nodes = len(model.mesh.getNodes()[0])
        cells = sum(len(model.mesh.getElementsByType(TETRAHEDRON, number)[0]) for number in self._numbers.values())
        return {"contact unknowns": unknowns, "nodes": nodes, "cells": cells, "straightened": repaired}

    def _contact_unknowns(self) -> int:
        """Unknowns of the contacts that the scene will have: of each, the points of the part with smaller facets."""
        points = 0
        facets = {name: self._facet_area(name) for name in self._numbers}
        for pair, sides in self.contacts.items():
            if pair in self._threads:
                continue
            finer = min(sides, key=lambda name: facets[name])
            # the free shank of a screw is in no contact
            chosen = [f for f in sides[finer] if pair not in self._free or f not in self._rounds[finer]]
            points += sum(self._points(face) for face in chosen)
        return _POINT * points

    def _facet_area(self, name: str) -> float:
        """Mean area of the facets of a part, mm2."""
        faces = self._skins.faces[name]
        count = sum(len(self._gmsh.model.mesh.getElementsByType(2, face)[0]) for face in faces)
        return self._assembly.by_name[name].area / max(count, 1)

    def _points(self, face: int) -> int:
        """Corners of the facets of a face, at which its contacts have their points."""
        mesh = self._gmsh.model.mesh
        edges = self._gmsh.model.getBoundary([(2, face)], oriented=False)
        # each edge with one of its ends
        return len(mesh.getNodes(2, face)[0]) + sum(len(mesh.getNodes(1, abs(edge))[0]) + 1 for _, edge in edges)

    # -- names -------------------------------------------------------------------------------------------------------
    def name_groups(self) -> dict[str, list[str]]:
        """Name parts and their faces in the mesh; names of the faces by part."""
        model, groups = self._gmsh.model, dict[str, list[int]]()
        names: dict[str, list[str]] = {}
        for part in self._assembly.parts:
            own: dict[str, list[int]] = self._ends(part)
            for pair, sides in self.contacts.items():
                if part.name in pair and sides[part.name]:
                    (other,) = pair - {part.name}
                    own[f"on_{other}"] = sides[part.name]
            touched = {face for pair in self.contacts.values() for face in pair.get(part.name, ())}
            for name, faces in self._ends(part).items():
                if not touched.intersection(faces):
                    area = sum(float(model.occ.getMass(2, face)) for face in faces)
                    self._assembly.ends[f"{part.name}.{name}"] = area
            named = {face for faces in own.values() for face in faces}
            own |= self._holes(part, named)
            for name, faces in own.items():
                groups.setdefault(name, []).extend(faces)
            names[part.name] = list(own)
        model.removePhysicalGroups()
        for number, part in enumerate(self._assembly.parts, start=1):
            model.addPhysicalGroup(3, [self._numbers[part.name]], number, part.name)
        for number, (name, faces) in enumerate(groups.items(), start=len(names) + 1):
            model.addPhysicalGroup(2, sorted(set(faces)), number, name)
        return names

    def _ends(self, part: CadPart) -> dict[str, list[int]]:
        """Flat faces at the ends of the box of a part: xmin, xmax, ..."""
        found: dict[str, list[int]] = {}
        slack = 1e-4 * part.diagonal
        for axis, letter in enumerate("xyz"):
            for corner, word in ((part.low, "min"), (part.high, "max")):
                faces = [
                    face
                    for face in self._skins.faces[part.name]
                    if np.abs(self._skins.box(face)[:, axis] - corner[axis]).max() <= slack
                ]
                if faces:
                    found[f"{letter}{word}"] = faces
        return found

    def _holes(self, part: CadPart, named: set[int]) -> dict[str, list[int]]:
        """Round faces that have no name yet: hole_1, round_1, in the order of their places."""
        free = [c for face, c in self._rounds[part.name].items() if face not in named]
        whole = [c for c in merged(free) if c.turn >= 0.4]
        found: dict[str, list[int]] = {}
        for word, outward in (("hole", False), ("round", True)):
            chosen = sorted(
                (c for c in whole if c.outward == outward),
                key=lambda c: [round(x, 3) for x in (-c.radius, *c.point, c.low)],
            )
            found |= {f"{word}_{i}": list(c.faces) for i, c in enumerate(chosen, start=1)}
        return found

    def write(self, file: Path) -> None:
        """Write the mesh, parts and named faces alone."""
        for key, value in (("MshFileVersion", 4.1), ("Binary", 1), ("SaveAll", 0)):
            self._gmsh.option.setNumber(f"Mesh.{key}", value)
        self._gmsh.write(str(file))


def _around(axis: Sequence[float], middle: Sequence[float], cylinder: CadCylinder) -> bool:
    """Whether a round face is about the axis of a screw."""
    across = np.cross(np.array(cylinder.point) - np.array(middle), np.array(axis))
    parallel = abs(float(np.dot(cylinder.axis, axis))) > 0.999
    return bool(parallel and np.linalg.norm(across) <= 0.2 * cylinder.radius)
