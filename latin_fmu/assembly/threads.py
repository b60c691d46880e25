"""Screws as CAD draws them: the axis of a shank, its thread in a hole without a face of its own, its free shank.

The round faces of a body about an axis are the facets whose nodes have one distance from it. Those of a screw that look
outwards, at 0.75 to 1.1 of half the nominal diameter, are its shank; those of the engaged part that look inwards, at
the same, are the hole. Chamfers are inclined to the axis and belong to neither. Shank and hole overlap along the axis;
the end of the overlap at which more of the shank stands out is the mouth of the hole. From there the two are bonded
where they are opposite each other, over the load-bearing length exactly: facets that straddle its end are integrated
up to it (``fem.mortar``).

The rest of the shank takes no part in searches for contacts, or does but for a belt of a few facets in the middle of
its free length, where the cut finds a section.

A shank drawn thicker than the core of its thread is too stiff: a free thread has the resilience of its core (VDI 2230,
part 1, section 5.1.1.1). In the free length what lies outside the core diameter d_3 carries nothing, of each cell its
share of the volume. Along the shank its stiffness is that of E A_3 / A with the area A as drawn; bending, and the ways
that the force spreads into head and hole, are those of the core where a cell is no larger than some 0.4 diameters. A
shank that is in contact needs its surface: its modulus is scaled by A_3 / A throughout.
"""

from __future__ import annotations

from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass, replace
from fnmatch import fnmatchcase
from functools import cached_property
from typing import Final

import numpy as np

from ..errors import Problems, listed
from ..fem.elements import points_in
from ..fem.mesh import Array, CellBlock, FacetBlock, FacetSet, HalfSpace
from ..fem.reference_cells import volume_rule
from ..remarks import Remark
from ..scene.bolts import Bolt, ThreadTable
from ..scene.fields import ALL_OF_IT
from ..scene.interfaces import Interface
from ..scene.schema import Scene
from .body import Body, Shape

FITS: Final = 0.75, 1.1
"""Diameter of a hole or a shank over the nominal one, from core to nominal with some play."""
_SLACK: Final = 0.02  # of these, for chords
_ROUND: Final = 0.03  # difference of the distances of a facet's nodes from the axis, over the distance
_STEEP: Final = 0.4  # cosine between a normal and the axis from which on a facet belongs to a chamfer
_RADIAL: Final = 0.9  # cosine between a normal and the radius
_ENOUGH: Final = 0.1  # share of the surface of a screw that is round about its axis, at least
_AXIS_STEPS: Final = 4  # steps to the axis of the round faces, from one that may be off by some degrees
_GLOBAL: Final = 3.5e-3  # angle to a global axis up to which it is meant, rad (0.2 degrees)
_SEARCH: Final = 0.35  # of the radius: from shank to hole at most
_OFF: Final = 0.1  # of the length: what is missing of it that is worth a warning
_EXACT: Final = 1e-3  # the same that is nothing
_BELT: Final = 3.0  # facets around the cut that stay free
_BESIDE: Final = "beside_the_shank"
"""Name of the face of a screw that takes part in searches for contacts."""
_FINE: Final = 5  # points along each axis of a cell, for the share of it that is thread
_SOFT: Final = 0.01  # modulus of a thread without its counterpart over that of the material: it carries nothing
_CORE: Final = 0.97  # area of the core over that of the shank from which on the modulus stays

Mask = np.ndarray


@dataclass(frozen=True)
class ShankLine:
    """A line in space: (3,) unit direction and (3,) point, m."""

    axis: Array
    point: Array

    def arms(self, places: Array) -> Array:
        """Vectors (..., 3) from the line to places (..., 3), across it."""
        arm = places - self.point
        return np.asarray(arm - (arm @ self.axis)[..., None] * self.axis)


class BoundaryFacets:
    """Boundary facets of a body one by one.

    Attributes
    ----------
    centres, vectors : (n_facet, 3) mean of the corners, m; outward vector areas, m2. areas, normals : of these.
    """

    def __init__(self, body: Body) -> None:
        self.body, self._places = body, [body.mesh.nodes[block.facets] for block in body.outside.blocks]
        corners = [body.mesh.nodes[block.corners] for block in body.outside.blocks]
        self.centres = np.concatenate([x.mean(axis=1) for x in corners])
        # of triangles and quadrilaterals alike: half the product of the diagonals
        self.vectors = np.concatenate([0.5 * np.cross(x[:, 2] - x[:, 0], x[:, -1] - x[:, 1]) for x in corners])
        self.areas = np.linalg.norm(self.vectors, axis=1)
        self.normals = self.vectors / np.maximum(self.areas, 1e-300)[:, None]

    def heights(self, axis: Array) -> tuple[Array, Array]:
        """Least and largest height (n_facet,) of the nodes of each facet along an axis, m."""
        along = [x @ axis for x in self._places]
        return np.concatenate([z.min(axis=1) for z in along]), np.concatenate([z.max(axis=1) for z in along])

    def round_ones(self, line: ShankLine, outwards: bool) -> tuple[Mask, Array]:
        """Facets (n_facet,) of cylinders about a line that look away from it, or towards it, and the radii (n_facet,)
        of all, m."""
        distances = [np.linalg.norm(line.arms(x), axis=2) for x in self._places]
        least = np.concatenate([r.min(axis=1) for r in distances])
        most = np.concatenate([r.max(axis=1) for r in distances])
        arms = line.arms(self.centres)
        arms /= np.maximum(np.linalg.norm(arms, axis=1), 1e-300)[:, None]
        radial = np.einsum("fi,fi->f", arms, self.normals) * (1.0 if outwards else -1.0)
        steep = np.abs(self.normals @ line.axis) >= _STEEP
        return (most - least <= _ROUND * most) & ~steep & (radial >= _RADIAL), most

    def picked(self, chosen: Mask) -> FacetSet:
        """Some of the facets (n_facet,)."""
        blocks, first = [], 0
        for block in self.body.outside.blocks:
            members = chosen[first : first + len(block.facets)]
            first += len(block.facets)
            if members.any():
                blocks.append(FacetBlock(block.kind, block.facets[members]))
        return FacetSet(tuple(blocks))

    def line(self, axis: Array | None) -> ShankLine | None:
        """The axis of the round faces that look outwards, along ``axis`` where it is given; None where there is no
        such axis."""
        if axis is not None:
            return self._centred(axis, np.ones(len(self.areas), dtype=bool))
        weight = self.areas / self.areas.sum()
        off = self.centres - weight @ self.centres
        found: list[tuple[float, Array]] = []
        # of a body of revolution, or with three arms or more, one main axis of each is the axis
        for tensor in ((off * weight[:, None]).T @ off, (self.normals * weight[:, None]).T @ self.normals):
            for direction in np.linalg.eigh(tensor)[1].T:
                line = self._centred(direction, np.ones(len(self.areas), dtype=bool))
                found.append((float(weight[self.round_ones(line, outwards=True)[0]].sum()), line.axis))
        share, best = max(found, key=lambda pair: pair[0])
        if share < _ENOUGH:
            return None
        line = self._centred(best, np.ones(len(self.areas), dtype=bool))
        for _ in range(_AXIS_STEPS):
            line = self._fitted(line, self.round_ones(line, outwards=True)[0])
        best, faces = line.axis, self.round_ones(line, outwards=True)[0]
        main = int(np.abs(best).argmax())
        if np.linalg.norm(np.delete(best, main)) < _GLOBAL:
            best = np.eye(3)[main]
        return self._centred(best * np.sign(best[main]), faces)

    def _fitted(self, line: ShankLine, faces: Mask) -> ShankLine:
        """The line from which the corners of each facet are equally far, by a step of Gauss and Newton; normals of
        chords are inclined, and those of half a shank all to one side."""
        blocks = self.picked(faces).blocks
        if not blocks:
            return line
        across = np.linalg.svd(line.axis[None])[2][1:]
        rows, off = [], []
        for block in blocks:
            places = self.body.mesh.nodes[block.corners]
            arms = line.arms(places)
            distance = np.linalg.norm(arms, axis=2)
            towards = (arms / np.maximum(distance, 1e-300)[..., None]) @ across.T
            height = (places - line.point) @ line.axis
            # what a shift and a tilt of the line take off the distances
            change = np.concatenate([towards, height[..., None] * towards], axis=2)
            rows.append((change - change.mean(axis=1, keepdims=True)).reshape(-1, 4))
            off.append((distance - distance.mean(axis=1, keepdims=True)).ravel())
        matrix, target = np.concatenate(rows), np.concatenate(off)
        size = np.maximum(np.linalg.norm(matrix, axis=0), 1e-300)
        step = np.linalg.lstsq(matrix / size, target, rcond=1e-6)[0] / size
        axis = line.axis + step[2:] @ across
        return ShankLine(axis / np.linalg.norm(axis), line.point + step[:2] @ across)

    def _centred(self, axis: Array, faces: Mask) -> ShankLine:
        """The line along an axis that the normals of facets meet best."""
        line = ShankLine(axis, self.areas @ self.centres / self.areas.sum())
        for _ in range(2):
            flat = faces & (np.abs(self.normals @ axis) < _STEEP)
            if not flat.any():
                break
            # across the axis and the normal: a line through the centre of the facet along its normal has no part there
            across = np.cross(axis, self.normals[flat]) * np.sqrt(self.areas[flat])[:, None]
            target = np.einsum("fi,fi->f", across, self.centres[flat] - line.point)
            shift = np.linalg.lstsq(across, target, rcond=1e-6)[0]
            line = ShankLine(axis, line.point + shift)
            rounds = self.round_ones(line, outwards=True)[0]
            if rounds.any():
                faces = rounds
        return line


@dataclass(frozen=True)
class _Cylinder:
    """Round facets of a body about a line: which ones, their radius, m, and their ends along the axis, m."""

    skin: BoundaryFacets
    faces: Mask
    line: ShankLine

    @property
    def radius(self) -> float:
        """Mean radius of the nodes, m."""
        nodes = self.skin.picked(self.faces).nodes
        return float(np.linalg.norm(self.line.arms(self.skin.body.mesh.nodes[nodes]), axis=1).mean())

    @cached_property
    def ends(self) -> tuple[float, float]:
        """Least and largest height along the axis, m."""
        low, high = self.skin.heights(self.line.axis)
        return float(low[self.faces].min()), float(high[self.faces].max())

    @property
    def facet_size(self) -> float:
        """Root of the mean area of the facets, m."""
        return float(np.sqrt(self.skin.areas[self.faces].mean()))


def _fitting(radii: Array, diameter: float) -> Mask:
    """Radii that fit a nominal diameter."""
    share = 2.0 * radii / diameter
    return np.asarray((share >= FITS[0] - _SLACK) & (share <= FITS[1] + _SLACK))


def _shank(skin: BoundaryFacets, line: ShankLine, diameter: float | None) -> _Cylinder | None:
    """The shank of a screw; None where no round faces have the nominal diameter."""
    faces, radii = skin.round_ones(line, outwards=True)
    if not faces.any():
        return None
    if diameter is None:
        # of all round faces the longest ones
        low, high = skin.heights(line.axis)
        lengths = {}
        for radius in np.unique(np.round(radii[faces] / radii[faces].max(), 2)) * radii[faces].max():
            near = faces & (np.abs(radii - radius) <= _ROUND * radius)
            lengths[float(radius)] = 0.0
            if near.any():
                lengths[float(radius)] = float(high[near].max() - low[near].min())
        diameter = 2.0 * max(lengths, key=lambda radius: lengths[radius])
    faces = faces & _fitting(radii, diameter)
    if faces.any():
        return _Cylinder(skin, faces, line)
    return None


# -- engagement -------------------------------------------------------------------------------------------------------
@dataclass(frozen=True)
class Engagement:
    """Shank and hole of a thread.

    Attributes
    ----------
    shank, hole : their round faces. into : 1 where the axis points into the hole, -1 where it points out of it.
    mouth : height of the mouth of the overlap along the axis, m. overlap : its length, m.
    """

    shank: _Cylinder
    hole: _Cylinder
    into: int
    mouth: float
    overlap: float

    @classmethod
    def of(cls, shank: _Cylinder, hole: _Cylinder) -> Engagement | None:
        """The engagement of two cylinders; None where they do not overlap along the axis."""
        low, high = max(shank.ends[0], hole.ends[0]), min(shank.ends[1], hole.ends[1])
        if high - low <= _EXACT * (hole.ends[1] - hole.ends[0]):
            return None
        # the screw comes from where more of its shank stands out
        below = low - shank.ends[0] > shank.ends[1] - high
        if below:
            return cls(shank, hole, 1, low, high - low)
        return cls(shank, hole, -1, high, high - low)

    def reached(self, length: float | None) -> float:
        """Length that is bonded, m, from the mouth, where ``length`` is asked for: the overlap at most."""
        if length is None:
            return self.overlap
        return min(length, self.overlap)

    def bonded(self, cylinder: _Cylinder, length: float | None) -> FacetSet:
        """The facets of shank or hole that are bonded; they end at the length, m, from the mouth."""
        reached, axis = self.reached(length), cylinder.line.axis
        ends = np.stack(cylinder.skin.heights(axis))
        depths = self.into * (ends - self.mouth)
        facets = cylinder.skin.picked(
            cylinder.faces & (depths.max(axis=0) > 0.0) & (depths.min(axis=0) < reached * (1.0 - _EXACT))
        )
        return replace(facets, within=HalfSpace(self.into * axis, self.into * self.mouth + reached))


@dataclass(frozen=True)
class _Screw:
    """A bolt of a scene with the bodies around it; see ``with_threads``."""

    name: str
    bolt: Bolt
    thread: ThreadTable
    scene: Scene
    bodies: dict[str, Body]
    line: ShankLine
    problems: Problems

    @cached_property
    def body(self) -> Body:
        """Of the screw."""
        return self.bodies[self.bolt.substructure]

    @property
    def length_unit(self) -> str:
        """Unit of length."""
        return self.scene.unit_system["m"]

    def engagements(self) -> dict[str, Engagement]:
        """The parts around the shank, and the engagement with each; none with a problem."""
        nominal = self.bolt.nominal(self.scene.unit_system)
        shank = _shank(BoundaryFacets(self.body), self.line, nominal)
        where = f"bolt.{self.name}.thread"
        if shank is None:
            if nominal is None:
                wanted = ""
            else:
                wanted = f" of a diameter of {FITS[0] * nominal:.4g} to {FITS[1] * nominal:.4g}"
            self.problems.add(
                where,
                f"{self.body.name} has no round faces{wanted} about its axis",
                self.bolt.size,
                None,
                "check the size of the thread, the axis, and the scale of the mesh",
            )
            return {}
        if nominal is None:
            diameter = 2.0 * shank.radius
        else:
            diameter = nominal
        found: dict[str, Engagement] = {}
        seen: list[str] = []
        for name, body in self.bodies.items():
            if name == self.body.name or not fnmatchcase(name, str(self.thread.part)):
                continue
            skin = BoundaryFacets(body)
            faces, radii = skin.round_ones(self.line, outwards=False)
            seen += [f"{name}: {2.0 * r:.4g} {self.length_unit}" for r in np.unique(np.round(radii[faces], 6))[:3]]
            hole = _Cylinder(skin, faces & _fitting(radii, diameter), self.line)
            engagement = None
            if hole.faces.any():
                engagement = Engagement.of(shank, hole)
            if engagement is not None:
                found[name] = engagement
        if not found:
            self.problems.add(
                f"{where}.part",
                f"no round hole about the shank of {self.body.name} overlaps it along the axis",
                f"{self.thread.part}; holes about the axis: {listed(seen)}",
                f"a diameter of {FITS[0] * diameter:.4g} to {FITS[1] * diameter:.4g} {self.length_unit}",
                "name the part with the threaded hole, and check the size of the thread",
            )
        return found

    def interface(self, part: str, face: str) -> Interface:
        """The bond of the thread in a part, on faces of this name."""
        reach = _SEARCH * 0.5 * (self.bolt.nominal(self.scene.unit_system) or 2.0 * self._drawn)
        sides = f"{self.body.name}.{face}", f"{part}.{face}"
        return Interface(sides=sides, behaviour="perfect", search=reach, overlap="ignore", points_at="corners")

    @cached_property
    def _drawn(self) -> float:
        shank = _shank(BoundaryFacets(self.body), self.line, self.bolt.nominal(self.scene.unit_system))
        assert shank is not None
        return shank.radius

    def free_ends(self, engagements: Iterable[Engagement]) -> tuple[float, float]:
        """Heights of the free shank along the axis, m: from the mouth of the hole to its end at the head, or to the
        mouth of the hole at the other end."""
        parts = list(engagements)
        low, high = parts[0].shank.ends
        highest = min((e.mouth for e in parts if e.into > 0), default=high)
        return max((e.mouth for e in parts if e.into < 0), default=low), highest

    def touching(self, shank: _Cylinder, ends: tuple[float, float]) -> Mask:
        """Facets (n_facet,) of the screw that take part in searches for contacts."""
        if self.bolt.shank == "free":
            return ~shank.faces
        low, high = ends
        width = _BELT * shank.facet_size
        if width > high - low:
            self.problems.add(
                f"bolt.{self.name}.shank",
                "the free shank is shorter than the belt around its cut that stays free of contacts",
                f"{high - low:.4g} {self.length_unit}",
                f"more than {width:.4g} {self.length_unit}, {_BELT:g} facets",
                'refine the shank, or leave shank = "contact" out',
            )
        least, most = shank.skin.heights(shank.line.axis)
        middle = 0.5 * (low + high)
        return ~(shank.faces & (most > middle - 0.5 * width) & (least < middle + 0.5 * width))

    def moduli(self, engagements: Sequence[Engagement]) -> tuple[Array | None, str]:
        """Moduli (n_cell,) of the screw over that of its material, None where all are 1; and what is said of them."""
        named, units = self.thread.named, self.scene.unit_system
        if named is None or self.thread.modulus == "drawn":
            if named is None:
                why = "the thread has no size"
            else:
                why = "as asked"
            return None, f"modulus of the free shank as drawn ({why})"
        radius = engagements[0].shank.radius
        core = 0.5e-3 * named.core_diameter / units.size("m")
        ratio = (core / radius) ** 2
        if ratio > _CORE:
            return None, "the free shank is drawn at the core of its thread"
        outside, parts = (1.0 + _ROUND) * radius, self._threaded(engagements)
        if self.bolt.shank == "contact":
            moduli = 1.0 - (1.0 - ratio) * np.sum([self._shares(part, (-1.0, outside)) for part in parts], axis=0)
            return moduli, f"modulus of the free shank x {ratio:.3g}, to the area of the core of {self.thread.size}"
        moduli = np.maximum(1.0 - np.sum([self._shares(part, (core, outside)) for part in parts], axis=0), _SOFT)
        return moduli, (
            f"of the free shank the core of {self.thread.size} carries, a diameter of {2.0 * core:.4g} "
            f"{self.length_unit}, {ratio:.3g} of its section"
        )

    def _threaded(self, engagements: Sequence[Engagement]) -> list[tuple[float, float]]:
        """Heights along the axis, m, between which the free shank has a thread: the length without one is next to the
        head, in the middle of a stud with nuts at both ends."""
        low, high = self.free_ends(engagements)
        plain, into = min(self.thread.plain, high - low), {e.into for e in engagements}
        if len(into) == 1:
            if 1 in into:
                return [(low + plain, high)]
            return [(low, high - plain)]
        middle = 0.5 * (low + high)
        return [(low, middle - 0.5 * plain), (middle + 0.5 * plain, high)]

    def _shares(self, heights: tuple[float, float], radii: tuple[float, float]) -> Array:
        """Share (n_cell,) of the volume of each cell of the screw between two heights and two radii, m."""
        mesh, shares = self.body.mesh, []
        for block in mesh.blocks:
            found = np.zeros(len(block.cells))
            nodes = mesh.nodes[block.cells]
            height, distance = nodes @ self.line.axis, np.linalg.norm(self.line.arms(nodes), axis=2)
            near = (height.max(axis=1) > heights[0]) & (height.min(axis=1) < heights[1])
            near = np.flatnonzero(near & (distance.max(axis=1) > radii[0]) & (distance.min(axis=1) < radii[1]))
            rule = volume_rule(block.cell_type, _FINE)
            # in parts, for the memory
            for some in np.array_split(near, 1 + len(near) // 300):
                cells = points_in(mesh.nodes, CellBlock(block.cell_type, block.cells[some]), rule)
                places = np.einsum("pa,cai->cpi", cells.values, mesh.nodes[cells.cells])
                height, distance = places @ self.line.axis, np.linalg.norm(self.line.arms(places), axis=2)
                inside = (height > heights[0]) & (height < heights[1]) & (distance < radii[1])
                # a ramp over the spacing of the points: a step would jump from point to point
                beyond = np.clip(
                    0.5 + (distance - radii[0]) * _FINE / np.ptp(distance, axis=1, keepdims=True), 0.0, 1.0
                )
                found[some] = (cells.volumes * inside * beyond).sum(axis=1) / cells.volumes.sum(axis=1)
            shares.append(found)
        return np.concatenate(shares)


def face_name(bolt: str, number: int = 1) -> str:
    """Name of the faces that a thread of a bolt is bonded on, on both bodies; ``number`` : of its threads, from 1."""
    return _numbered(f"thread_of_{bolt}", number)


def _numbered(name: str, number: int) -> str:
    """A name with a number from 2 on."""
    if number > 1:
        return f"{name}_{number}"
    return name


def with_threads(
    scene: Scene, bodies: dict[str, Body], problems: Problems, remarks: list[Remark] | None = None
) -> tuple[Scene, dict[str, Body], dict[str, str]]:
    """The scene with the axes of its bolts and the bonds of their threads; the bodies with the faces of these, without
    the contacts of free shanks, their moduli scaled; and a note on every thread, by bolt. It comes before faces are
    checked: threads make their own.

    Shanks without an axis, parts without a hole are added to ``problems``; lengths that are not reached to ``remarks``.
    """
    # a body that cannot be read is not there
    if problems or not scene.bolt:
        return scene, bodies, {}
    threaded = {name: _plain(body) for name, body in bodies.items()}
    bolts, interfaces = dict(scene.bolt), dict(scene.interface)
    notes, shanks = dict[str, str](), dict[str, _Free]()
    for name, bolt in scene.bolt.items():
        body = bodies[bolt.substructure]
        line = _line(name, bolt, body, problems)
        if line is None:
            continue
        if bolt.axis is None:
            x, y, z = line.axis.tolist()
            bolts[name] = bolt = bolt.model_copy(update={"axis": (x, y, z)})
        if bolt.thread is None or bolt.thread.part is None:
            continue
        screw = _Screw(name, bolt, bolt.thread, scene, bodies, line, problems)
        found = screw.engagements()
        if not found:
            continue
        for number, (part, engagement) in enumerate(found.items(), start=1):
            _bond(screw, (part, engagement), number, threaded, interfaces)
        threads = list(found.values())
        shank, (moduli, said) = threads[0].shank, screw.moduli(threads)
        touching = screw.touching(shank, screw.free_ends(threads))
        old = shanks.get(body.name)
        # several threads of one body, as of a bow: what none of them leaves out
        if old is None:
            shanks[body.name] = _Free(shank.skin, touching, moduli)
        else:
            shanks[body.name] = old.also(touching, moduli)
        notes[name], warnings = _words(screw, found, said)
        if remarks is not None:
            remarks += [Remark("thread", warning) for warning in warnings]
    threaded |= {name: free.of(threaded[name]) for name, free in shanks.items()}
    return scene.model_copy(update={"bolt": bolts, "interface": interfaces}), threaded, notes


def _bond(
    screw: _Screw, part: tuple[str, Engagement], number: int, bodies: dict[str, Body], interfaces: dict[str, Interface]
) -> None:
    """Bond the thread ``number`` of a screw to a part: a face of both bodies and an interface more."""
    (name, engagement), length = part, screw.thread.length
    face, name_of_bond = face_name(screw.name, number), _numbered(f"{screw.name}_thread", number)
    bond = screw.interface(name, face)
    if interfaces.get(name_of_bond, bond) != bond:
        what = f"the bond of the thread of bolt {screw.name} has this name"
        screw.problems.add(f"interface.{name_of_bond}", what, name_of_bond, None, "rename one of the two")
    interfaces[name_of_bond] = bond
    for body, cylinder in ((screw.body.name, engagement.shank), (name, engagement.hole)):
        bodies[body] = _with(bodies[body], face, engagement.bonded(cylinder, length))


def _line(name: str, bolt: Bolt, body: Body, problems: Problems) -> ShankLine | None:
    """The axis of a bolt; None with a problem."""
    if bolt.axis is not None and (bolt.thread is None or bolt.thread.part is None):
        return ShankLine(np.asarray(bolt.axis), np.zeros(3))
    axis = None
    if bolt.axis is not None:
        axis = np.asarray(bolt.axis) / np.abs(bolt.axis).max()
        axis /= np.linalg.norm(axis)
    line = BoundaryFacets(body).line(axis)
    if line is None:
        problems.add(
            f"bolt.{name}.axis",
            f"{body.name} has no round faces about one axis, so that the axis does not follow from the mesh",
            None,
            "a direction [x, y, z]",
            "give the axis of the shank",
        )
    return line


def _words(screw: _Screw, found: Mapping[str, Engagement], said: str) -> tuple[str, list[str]]:
    """What ``check`` says of the threads of a screw, and a warning for each whose length was not reached."""
    unit, wanted = screw.length_unit, screw.thread.length
    bonds, warnings = [], []
    for part, engagement in found.items():
        reached = engagement.reached(wanted)
        short = wanted is not None and reached < (1.0 - _EXACT) * wanted
        aim = ""
        if short:
            aim = f" of {wanted:.4g} asked for"
        bonds.append(f"{part} over {reached:.4g} {unit}" + aim)
        if wanted is not None and reached < (1.0 - _OFF) * wanted:
            warnings.append(
                f"bolt {screw.name}: its thread is bonded over {reached:.4g} {unit} in the place of {wanted:.4g}: "
                f"shank and hole of {part} overlap over {reached:.4g} {unit}"
            )
    if screw.bolt.shank == "free":
        free = "the free shank has no contact"
    else:
        free = "the free shank is in contact"
    if screw.bolt.shank == "free":
        free += ' (shank = "contact" gives it one)'
    return f"thread bonded to {' and '.join(bonds)}; {free}; {said}", warnings


def _with(body: Body, name: str, facets: FacetSet) -> Body:
    """The body with one more face."""
    return replace(body, mesh=replace(body.mesh, faces={**body.mesh.faces, name: facets}))


@dataclass(frozen=True)
class _Free:
    """The free shank of a screw: facets (n_facet,) that take part in searches, relative moduli (n_cell,) or None."""

    skin: BoundaryFacets
    touching: Mask
    moduli: Array | None

    def also(self, touching: Mask, moduli: Array | None) -> _Free:
        """With those of another thread of the same body."""
        both = [m for m in (self.moduli, moduli) if m is not None]
        return _Free(self.skin, self.touching & touching, np.minimum.reduce(both) if both else None)

    def of(self, body: Body) -> Body:
        """The body with this shank."""
        shape = Shape(body.shape.mesh, body.shape.material, body.shape.bending_modes, self.moduli)
        named = _with(replace(body, shape=shape), _BESIDE, self.skin.picked(self.touching))
        return replace(named, touching=_BESIDE)


def _plain(body: Body) -> Body:
    """A body without what the threads of a scene solved before left on it."""
    if body.touching == ALL_OF_IT and body.shape.moduli is None:
        return body
    shape = Shape(body.shape.mesh, body.shape.material, body.shape.bending_modes)
    return replace(body, shape=shape, touching=ALL_OF_IT)
