"""Sections of shanks at named places, found from the meshes, and what the shanks clamp.

Along its axis a shank is free between what holds its two ends: the innermost points of seats, bonds and held nodes on
either side of its cut. ``head`` and ``thread`` are the sections of the free shank next to these, just under the head
and at the first engaged thread. The end with the thread is that of a bond around the shank, else that of a bond or of
held nodes; where both ends are alike the head is the end that the axis points to, and of a stud with a nut at each end
both have a thread.

A ``parting`` face is where an interface of other parts, across the axis, surrounds the shank between its ends, that of
a washer included. Its points belong to the shank that is nearest to them, of those which cross it.
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from typing import Final

import numpy as np

from ..fem.elements import stiffness
from ..fem.mesh import Array, Index
from ..interface.laws import coulomb_coefficient
from ..latin.assembly import InterfaceUnit
from ..latin.bolt_sections import CUT, HEAD, PARTING, THREAD, ClampedFace, ScrewData, ShankSections
from ..results.bolt_strength import endurance_limit
from ..scene.fields import split_face
from ..scene.threads import class_minimum
from .body import Body, body_sides
from .bolts import BoltCut, OpenedMesh, ShankSection
from .shank_facets import SAME, ShankFacets, across, chosen_elements

_NEAR: Final = 3.0  # radii of the shank around its axis within which points hold it, or surround it
_ACROSS: Final = 0.5  # cosine between a normal and the axis from which on a face lies across it
_INSIDE: Final = 0.25, 0.5, 1.0, 2.0, 3.0
"""Of the distance of elements along the axis: from an end of the free shank to its section, the first that is free."""
_LEVEL: Final = 0.02  # of the free length: heights of one face
_AROUND: Final = 0.6  # of the angle around the shank that is modelled: a face with less on one side lies beside it
_NUT: Final = 3.5  # radii of the shank: a part within them around a thread is its nut
_WIDER: Final = 5.0  # times the area of the cut: a section with more is none of the shank

Faces = list[tuple[float, list["Ring"]]]


@dataclass(frozen=True)
class Ring:
    """Points of an interface around a shank.

    Attributes
    ----------
    unit : the interface. sides : names of its bodies. heights : (n_point,) along the axis, m. radii : (n_point,)
        distance from it, m. across : (n_point,) whether the face lies across it. near : (n_point,) those within reach.
    """

    unit: InterfaceUnit
    sides: tuple[str, ...]
    heights: Array
    radii: Array
    across: np.ndarray
    near: np.ndarray

    @classmethod
    def of(cls, unit: InterfaceUnit, cut: BoltCut, reach: float) -> Ring:
        """Of an interface and a cut."""
        geometry = unit.geometry
        radii = np.linalg.norm(across(geometry.points - cut.point, cut.axis), axis=1)
        cosines = np.abs(geometry.frames[:, 0] @ cut.axis)
        sides = tuple(split_face(face)[0] for face in unit.sides)
        return cls(unit, sides, geometry.points @ cut.axis, radii, cosines >= _ACROSS, radii <= reach)

    def surrounds(self, cut: BoltCut) -> bool:
        """Whether its points lie all around the shank, as far as it is modelled."""
        picked = self.near & self.across
        if picked.sum() < 2:
            return False
        arms = (self.unit.geometry.points[picked] - cut.point) @ cut.directions[1:].T
        angles = np.sort(np.arctan2(arms[:, 1], arms[:, 0]))
        empty = float(np.diff(np.append(angles, angles[0] + 2.0 * np.pi)).max())
        return empty <= 2.0 * np.pi * (1.0 - _AROUND * cut.share)


@dataclass(frozen=True)
class _Hold:
    """What holds an end of a shank: height of its innermost point, m; ``rank`` 1 of a seat, 2 of a bond across the axis
    or held nodes, 3 of a thread; the ring, None of held nodes."""

    height: float
    rank: int
    ring: Ring | None = None


class _Shank:
    """A shank between what holds it."""

    def __init__(self, cut: BoltCut, body: Body, units: Sequence[InterfaceUnit], fixed: np.ndarray) -> None:
        self.cut, self.body = cut, body
        self.facets = ShankFacets(body, cut.axis)
        self.radius = float(np.sqrt(cut.area / (cut.share * np.pi)))
        self.middle = float(cut.point @ cut.axis)
        rings = [Ring.of(unit, cut, _NEAR * self.radius) for unit in units if not unit.attached]
        self.rings = [ring for ring in rings if ring.near.any()]
        self.taken = self._taken(units, fixed)
        holds = [*self._holds(), *self._held(fixed)]
        self.low = max((h for h in holds if h.height < self.middle), key=lambda h: (h.height, h.rank), default=None)
        self.high = min((h for h in holds if h.height > self.middle), key=lambda h: (h.height, -h.rank), default=None)

    def _taken(self, units: Sequence[InterfaceUnit], fixed: np.ndarray) -> np.ndarray:
        """(n_node,) nodes that bonds, faces across the axis or boundaries hold."""
        taken = fixed.copy()
        for i, side, name in body_sides(units):
            trace = units[i].geometry.traces[side]
            if name != self.body.name or trace is None:
                continue
            lying = np.abs(units[i].geometry.frames[:, 0] @ self.cut.axis) >= _ACROSS
            rows = np.repeat(lying | (not units[i].behaviour.opens), 3)
            taken[np.unique(trace[np.flatnonzero(rows)].indices) // 3] = True
        return taken

    def _holds(self) -> Iterator[_Hold]:
        """Seats and bonds of the body, on both sides of the cut."""
        for ring in self.rings:
            if self.body.name not in ring.sides:
                continue
            bonded = not ring.unit.behaviour.opens
            taking = ring.near & (ring.across | bonded)
            for chosen, innermost in ((ring.heights < self.middle, max), (ring.heights > self.middle, min)):
                heights = ring.heights[taking & chosen]
                if not len(heights):
                    continue
                rank = 1
                if bonded:
                    rank = 2 if ring.across[taking & chosen].mean() > _ACROSS else 3
                yield _Hold(float(innermost(heights)), rank, ring)

    def _held(self, fixed: np.ndarray) -> Iterator[_Hold]:
        """Nodes near the axis that a boundary condition holds along it."""
        radii = np.linalg.norm(across(self.body.mesh.nodes - self.cut.point, self.cut.axis), axis=1)
        heights = self.facets.heights[fixed & (radii <= _NEAR * self.radius)]
        for chosen, innermost in ((heights < self.middle, max), (heights > self.middle, min)):
            if chosen.any():
                yield _Hold(float(innermost(heights[chosen])), 2)

    @property
    def ends(self) -> dict[str, _Hold]:
        """What holds head and thread, by the name of the section."""
        low, high = self.low, self.high
        if low is None or high is None:
            found = high if low is None else low
            if found is None:
                return {}
            return {HEAD if found.rank == 1 else THREAD: found}
        if low.rank == high.rank == 3:
            return {THREAD: low, f"{THREAD}_2": high}
        if high.rank > low.rank:
            return {HEAD: low, THREAD: high}
        return {HEAD: high, THREAD: low}

    @property
    def downwards(self) -> bool:
        """Whether the axis points from the thread to the head."""
        head, thread = self.ends.get(HEAD), self.ends.get(THREAD)
        if head is not None:
            return head.height > self.middle
        return thread is not None and f"{THREAD}_2" not in self.ends and thread.height < self.middle

    @property
    def length(self) -> float | None:
        """Free length between the two ends, m; None where one is open."""
        if self.low is None or self.high is None:
            return None
        return self.high.height - self.low.height

    def is_nut(self, name: str, bodies: Mapping[str, Body]) -> bool:
        """Whether a body that is bonded to the shank is no larger than a nut."""
        bonded = (hold.ring for hold in (self.low, self.high) if hold is not None and hold.rank == 3)
        if name not in bodies or not any(ring is not None and name in ring.sides for ring in bonded):
            return False
        radii = np.linalg.norm(across(bodies[name].mesh.nodes - self.cut.point, self.cut.axis), axis=1)
        return bool(radii.max() <= _NUT * self.radius)

    def partings(self, bodies: Mapping[str, Body]) -> Faces:
        """Heights of the faces of clamped parts that cross the free shank, m, from the head on, and their rings."""
        length = self.length
        if length is None or self.low is None or self.high is None:
            return []
        slack, found = _LEVEL * length, list[tuple[float, Ring]]()
        for ring in self.rings:
            own = self.body.name in ring.sides or any(self.is_nut(name, bodies) for name in ring.sides)
            if own or not ring.surrounds(self.cut):
                continue
            height = float(ring.heights[ring.near & ring.across].mean())
            if self.low.height - slack <= height <= self.high.height + slack:
                found.append((height, ring))
        faces: Faces = []
        for height, ring in sorted(found, key=lambda pair: pair[0]):
            if faces and height - faces[-1][0] <= slack:
                faces[-1][1].append(ring)
            else:
                faces.append((height, [ring]))
        if self.downwards:
            faces.reverse()
        return faces

    def seat(self, hold: _Hold | None, bodies: Mapping[str, Body]) -> float | None:
        """Area of the bearing surface at an end, m2: of the head, or of the nut whose thread holds it; None where there
        is none."""
        if hold is None or hold.ring is None or self.length is None:
            return None
        if hold.rank < 3:
            names = {self.body.name}
        else:
            names = {name for name in hold.ring.sides if name != self.body.name and self.is_nut(name, bodies)}
        area, slack = 0.0, _LEVEL * self.length
        for ring in self.rings:
            if not names & set(ring.sides) or {self.body.name, *names} >= set(ring.sides):
                continue
            at = ring.near & ring.across & (np.abs(ring.heights - hold.height) <= slack)
            area += float(ring.unit.geometry.areas[at].sum())
        return area or None

    # -- sections ---------------------------------------------------------------------------------------------------
    def end_section(self, height: float) -> ShankSection | str:
        """The section next to an end of the free shank: the first one with nothing between it and the cut that holds
        the shank, else the last one; why there is none, in words."""
        found: ShankSection | str = ""
        for inside in _INSIDE:
            found = self.section(height, inside)
            if isinstance(found, str) or not self._holds_inside(found):
                break
        return found

    def _holds_inside(self, section: ShankSection) -> bool:
        """Whether nodes of the elements at the side of the cut, but for those of the section, hold the shank."""
        others = self.taken.copy()
        others[section.nodes] = False
        cells = np.split(section.side, np.cumsum([len(b.cells) for b in self.body.mesh.blocks])[:-1])
        return any(others[b.cells[c]].any() for b, c in zip(self.body.mesh.blocks, cells, strict=True))

    def section(self, height: float, inside: float = 0.0) -> ShankSection | str:
        """The section at a height, ``inside`` of the free shank by this part of the distance of its elements; why there
        is none, in words."""
        facets, cut = self.facets, self.cut
        near = facets.at(float(facets.level(np.asarray(self.middle))))
        step = float(np.median(facets.high[near] - facets.low[near])) if len(near) else 0.0
        wanted = float(facets.level(np.asarray(height))) + np.sign(self.middle - height) * inside * step
        # at an end of the body the first plane of facets, not far away
        level = float(np.clip(wanted, facets.low.min(), facets.high.max() - SAME))
        if abs(level - wanted) > step:
            return f"the mesh of {self.body.name} ends before"
        chosen = facets.at(level)
        if not len(chosen):
            return f"the mesh of {self.body.name} has no facet across the axis there"
        found, distance, width, _ = facets.nearest(chosen, cut.point)
        area = facets.area(found)
        if distance > max(width, np.sqrt(area)) or area > _WIDER * cut.area or area <= 0.0:
            return f"the facets of {self.body.name} there are none of its shank"
        nodes = facets.nodes_of(found)
        before = height > self.middle
        side = facets.touching(nodes) & ((facets.levels <= level) == before)
        weights = np.abs(facets.projected_areas()[found])
        centre = weights @ facets.centres(found) / weights.sum()
        return ShankSection.of((nodes, side, 1.0 if before else -1.0, centre, area))

    def at_cut(self) -> ShankSection:
        """The section of the cut."""
        facets, cut = self.facets, self.cut
        chosen = np.flatnonzero((np.isin(facets.facets, cut.nodes) | (facets.facets < 0)).all(axis=1))
        weights = np.abs(facets.projected_areas()[chosen])
        centre = weights @ facets.centres(chosen) / weights.sum()
        return ShankSection.of((cut.nodes, cut.beyond, -1.0, centre, cut.area))


def with_sections(
    cuts: Mapping[str, BoltCut],
    bodies: Mapping[str, Body],
    fixed: Mapping[str, np.ndarray],
    units: Sequence[InterfaceUnit],
) -> dict[str, BoltCut]:
    """The cuts with the sections of their shanks, what these clamp and what margins take; ``fixed`` : (n_node,) nodes
    held along the axis, by bolt."""
    shanks = {name: _Shank(cut, bodies[cut.table.substructure], units, fixed[name]) for name, cut in cuts.items()}
    faces = {name: shank.partings(bodies) for name, shank in shanks.items()}
    crossing: dict[str, list[str]] = {}
    for name, found in faces.items():
        for _, rings in found:
            for ring in rings:
                crossing.setdefault(ring.unit.name, []).append(name)
    opened: dict[str, OpenedMesh] = {}
    done = {}
    for name, shank in shanks.items():
        body = shank.body
        if body.name not in opened:
            own = [cut for cut in cuts.values() if cut.table.substructure == body.name]
            opened[body.name] = OpenedMesh(body.mesh, own, {})
        sections, named = _named(shank, faces[name])
        clamped = tuple(
            ClampedFace(
                ring.unit.name,
                _nearest(ring.unit, name, crossing[ring.unit.name], cuts),
                coulomb_coefficient(ring.unit.behaviour),
            )
            for _, rings in faces[name]
            for ring in rings
        )
        rows = tuple(_with_rows(section, shank, opened[body.name]) for section in sections)
        done[name] = replace(shank.cut, sections=rows, named=named, clamped=clamped, screw=_screw(shank, bodies))
    return done


def _nearest(unit: InterfaceUnit, name: str, names: Sequence[str], cuts: Mapping[str, BoltCut]) -> Index:
    """Points of an interface that are nearer to a shank than to the others, ``names``, that cross it."""
    points = unit.geometry.points
    apart = [np.linalg.norm(across(points - cuts[n].point, cuts[n].axis), axis=1) for n in names]
    return np.flatnonzero(np.argmin(np.stack(apart), axis=0) == names.index(name))


def _named(shank: _Shank, faces: Faces) -> tuple[list[ShankSection], ShankSections]:
    """Sections of a shank, each once and that of the cut first, and their names."""
    wanted = [(name, hold.height, True) for name, hold in shank.ends.items()]
    numbers = [""] if len(faces) == 1 else [f"_{i}" for i in range(1, len(faces) + 1)]
    wanted += [(PARTING + number, height, False) for number, (height, _) in zip(numbers, faces, strict=True)]
    cut = shank.at_cut()
    sections, places = [cut], [(shank.middle, CUT, 0)]
    missing = [f"no {end}: nothing holds this end of the shank" for end in _open_ends(shank)]
    for name, height, end in wanted:
        found = shank.end_section(height) if end else shank.section(height)
        if isinstance(found, str):
            at = round(height, 9) + 0.0
            missing.append(f"no section {name} at {at:.4g} {shank.body.units['m']} along the axis: {found}")
            continue
        same = [i for i, other in enumerate(sections) if np.array_equal(other.nodes, found.nodes)]
        if not same:
            same = [len(sections)]
            sections.append(found)
        places.append((height, name, same[0]))
    # from the head to the thread
    ranks = {HEAD: -1, THREAD: 1}
    places.sort(key=lambda place: (-place[0] if shank.downwards else place[0], ranks.get(place[1], 0)))
    rows = np.array([row for *_, row in places])
    named = ShankSections(
        tuple(name for _, name, _ in places),
        rows,
        np.stack([sections[i].centre for i in rows]),
        np.array([sections[i].area for i in rows]),
        shank.cut.directions,
        tuple(missing),
    )
    return sections, named


def _open_ends(shank: _Shank) -> list[str]:
    """Names of the ends that were not found."""
    if shank.low is not None and shank.high is not None:
        return []
    return [end for end in (HEAD, THREAD) if end not in shank.ends]


def _with_rows(section: ShankSection, shank: _Shank, opened: OpenedMesh) -> ShankSection:
    """The section with the rows of its resultant."""
    shape, body = shank.body.shape, shank.body
    part = chosen_elements(opened.mesh, shape.moduli, section.side)
    matrix = stiffness(part, shape.elasticity, shape.bending_modes)
    pattern, jumps = section.rows(opened, matrix, shank.cut.directions)
    heated = pattern @ (body.mesh.nodes @ shape.elasticity.expansion).ravel()
    return replace(section, pattern=pattern, jumps=jumps, heated=np.asarray(heated))


def _screw(shank: _Shank, bodies: Mapping[str, Body]) -> ScrewData | None:
    """What margins take of a bolt; None where its thread has no size."""
    table, units, thread = shank.cut.table, shank.body.units, shank.cut.table.named_thread
    if thread is None:
        return None
    mm, mpa = 1e-3 / units.size("m"), 1e6 / units.size("Pa")
    bearing = {HEAD: table.head_bearing, THREAD: table.nut_bearing}
    areas: dict[str, float | None] = {}
    for end, diameters in bearing.items():
        seat = shank.seat(shank.ends.get(end), bodies)
        areas[end] = None
        if diameters is not None:
            areas[end] = 0.25 * np.pi * (diameters[1] ** 2 - diameters[0] ** 2)
        elif seat is not None:
            areas[end] = seat / shank.cut.share
    limit = shank.body.shape.material.yield_stress
    if table.property_class is not None:
        limit = mpa * (class_minimum(table.property_class, thread.diameter) or 0.0)
    return ScrewData(
        mm * thread.pitch,
        mm * thread.flank_diameter,
        mm * thread.stress_diameter,
        limit,
        table.property_class,
        mpa * endurance_limit(thread.diameter),
        table.rolled,
        table.friction_of_thread(),
        table.permissible_pressure,
        areas[HEAD],
        areas[THREAD],
        table.clamp_length or shank.length,
    )
