"""Initial gap of an interface: clearances, faces that touch, press fits, bonds over a distance.

The distance of two faces is known up to the distance of their facets from the smooth surfaces that these stand for
(``Surface.sags``). Quadratic facets of round faces are curved as the faces are, and what is left of the error is small:
within it faces touch. Flat facets of a round face are chords, and the distance of two of them says nothing about a
clearance below their deviation. Whether it is zero follows from smooth surfaces through the nodes
(``fem.smooth_faces``); if it is not, the number has to be given.

An overlap of the faces is the interference of a press fit: a negative gap, which the static start closes. It is one up
to ``LARGEST_SHARE`` of the radius, of round faces, or of the thickness behind the faces. More is no fit that elastic
bodies carry: parts in the wrong place, or a screw drawn at its nominal diameter in a hole drawn as drilled, which is
bonded.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property
from typing import Final

import numpy as np
import scipy.sparse as sp

from ..errors import Problem, Problems
from ..fem.faces import Surface
from ..fem.location import thicknesses
from ..fem.mesh import Array, FacetBlock, FacetSet, nearest
from ..fem.mortar import Mortar, mortar
from ..fem.smooth_faces import smoothed
from ..remarks import Remark
from ..scene.fields import ALL_OF_IT
from ..scene.interfaces import TAKES, Interface
from .body import Body
from .face_pairs import MATCHING, FacePair, Side

LARGEST_SHARE: Final = 5e-3
"""Largest interference over the smaller one of radius and thickness."""
TOUCHING: Final = 1e-9
"""A distance along N below this fraction of the face is no gap."""
_CLOSABLE = 1.0  # gap = "closed" spans distances up to this share of the spacing of points
_CAD_ROUND_OFF = 0.05  # of the search
_CHORDS = 2.0  # times the deviation of flat facets: distances up to there are those of chords
_SMOOTH = 0.05  # of the deviation of flat facets: the error of smooth surfaces through their nodes, at least
_THREAD = 0.25  # of the radius: depth of a thread, within which bonded faces may overlap
_AS_WRITTEN = 1e-6  # relative difference of a number from the meshes that is not worth a word
_MOST_RAYS = 30  # on each side, for the thickness behind its face


@dataclass(frozen=True)
class Opening:
    """Initial gap (n_point,) along N, m, and what ``check`` says on how it was found."""

    gap: Array
    note: str = ""


def initial_opening(
    name: str, interface: Interface, pair: FacePair, sides: Sequence[Side], problems: Problems, remarks: list[Remark]
) -> Opening | None:
    """The gap of an interface with these faces; None, with its problem reported, where they do not fit."""
    if interface.against_ground and interface.ground is None:
        # the ground lies behind each point
        gap = (interface.number_gap or 0.0) - interface.interference
        return Opening(np.full(len(pair.points), gap))
    return _Gap(name, interface, pair, sides, problems, remarks).opening()


@dataclass(frozen=True)
class _Faces:
    """Two faces, or one and a plane of the ground; see ``initial_opening``."""

    name: str
    interface: Interface
    pair: FacePair
    sides: Sequence[Side]
    problems: Problems
    remarks: list[Remark]

    @property
    def length(self) -> str:
        """Unit of length."""
        return self.sides[0][0].units["m"]

    @cached_property
    def size(self) -> float:
        """Extent of the faces, m."""
        # one point has no extent
        return max(float(np.ptp(self.pair.points, axis=0).max()), float(np.sqrt(self.pair.areas.sum())))

    @property
    def negligible(self) -> float:
        """Distance that is round-off, m."""
        return TOUCHING * self.size

    @cached_property
    def within(self) -> Array:
        """Error of the distance (n_point,), m."""
        return (_CHORDS if self.pair.chord > 0.0 else 1.0) * self.pair.sags + self.negligible

    def _say(self, code: str, text: str) -> None:
        self.remarks.append(Remark(code, f"interface {self.name}: {text}"))

    @cached_property
    def _touched(self) -> list[tuple[Body, Surface]]:
        """The facets of each side that have a part in the interface."""
        surfaces = []
        for (body, facets), trace in zip(self.sides, self.pair.traces, strict=False):
            assert trace is not None
            nodes = np.zeros(body.mesh.n_node, dtype=bool)
            nodes[np.unique(sp.csr_array(trace).indices) // 3] = True
            blocks = [FacetBlock(b.kind, b.facets[nodes[b.corners].all(axis=1)]) for b in facets.blocks]
            blocks = [block for block in blocks if len(block.facets)]
            if blocks:
                facets = FacetSet(tuple(blocks))
            surfaces.append((body, Surface(body.mesh.nodes, facets)))
        return surfaces

    @cached_property
    def _radius(self) -> float:
        """Smaller radius of round faces, m; 0 where both are plane."""
        curvature = max(surface.curvature for _, surface in self._touched)
        if curvature * self.size > 1e-3:
            return 1.0 / curvature
        return 0.0

    @cached_property
    def _smaller(self) -> tuple[float, str]:
        """The smaller one of radius and thickness of the parts, m, and which it is."""
        found = []
        if self._radius > 0.0:
            found = [(self._radius, "radius")]
        for body, surface in self._touched:
            middles = np.concatenate([p.centres for p in surface.pieces])
            normals = np.concatenate([p.normals for p in surface.pieces])
            some = np.linspace(0, len(middles) - 1, min(_MOST_RAYS, len(middles))).astype(int)
            through = thicknesses(body.surface(ALL_OF_IT), middles[some], -normals[some])
            # fillets and edges are no measure of a wall
            if np.isfinite(np.median(through)):
                thick = float(np.median(through))
            else:
                thick = body.mesh.size
            found.append((thick, f"thickness of {body.name}"))
        return min(found)


@dataclass(frozen=True)
class _Distance(_Faces):
    """How far the faces are apart, as far as the meshes tell."""

    def _measured(self) -> Opening | None:
        """The distance of the faces, 0 where it is within its error; None where flat facets hide it."""
        distance, note = self.pair.distance, ""
        touching = np.abs(distance) <= self.within
        if touching.all():
            largest = float(np.abs(distance).max())
            if largest > self.negligible and self._by_meshes:
                if self.pair.chord > 0.0 and not self._smooth_ones_touch():
                    return None
                if self.pair.chord > 0.0:
                    what = "chords of their facets"
                else:
                    what = "error of the measure"
                note = f"faces within {largest:.2g} {self.length} of each other touch ({what}: "
                note += f"{float(self.within.max()):.2g} {self.length})"
            return Opening(np.zeros(len(distance)), note)
        if self.pair.chord > 0.0 and (distance < -self.within).any():
            # of an overlap, chords would leave the points between them open
            distance = self._smooth_distance(distance)
        # an overlap of chords, as of two meshes of one cylinder, is none
        closed = (touching & (distance < 0.0)) | (np.abs(distance) <= self.negligible)
        return Opening(np.where(closed, 0.0, distance))

    @property
    def _by_meshes(self) -> bool:
        """Whether the gap is that of the meshes."""
        prescribed = self.interface.number_gap is not None or self.interface.interference > 0.0
        return self.interface.behaves_open and self.interface.gap != "closed" and not prescribed

    @cached_property
    def _smooth(self) -> tuple[Mortar, Array] | None:
        """The integrals between smooth surfaces through the nodes, and the places of their points, m."""
        if len(self.sides) < 2 or self.pair.matching:
            return None
        surface, other = (smoothed(Surface(self.sides[i][0].mesh.nodes, self.sides[i][1])) for i in self._order)
        pair = mortar(surface, other, self.interface.search)
        if pair is None:
            return None
        return (pair, pair.owner @ surface.nodes)

    @property
    def _order(self) -> tuple[int, int]:
        return self.pair.owner, 1 - self.pair.owner

    def _smooth_distance(self, chords: Array) -> Array:
        """Distance of smooth surfaces at the points; that of the chords where there are none."""
        if self._smooth is None:
            return chords
        pair, places = self._smooth
        return np.asarray(pair.distance[nearest(self.pair.points, places)[1]])

    def _smooth_ones_touch(self) -> bool:
        """Whether smooth surfaces through the nodes touch; else a problem: how far apart they are is not known."""
        if self._smooth is None:
            return True
        pair, places = self._smooth
        # plane parts of the faces have no chords
        chords = self.pair.sags[nearest(places, self.pair.points)[1]]
        round_ones = chords > 0.5 * chords.max()
        apart = float(np.median(pair.distance[round_ones]))
        error = max(_CHORDS * float(np.median(pair.sags[round_ones])), _SMOOTH * self.pair.chord)
        if abs(apart) <= error + self.negligible:
            return True
        if apart > 0.0:
            kind = "a clearance"
        else:
            kind = "an interference"
        remedy = "give interference"
        if apart > 0.0:
            remedy = "give gap, the clearance"
        self.problems.add(
            f"interface.{self.name}.gap",
            f"{kind} of round faces with flat facets, which are up to {self.pair.chord:.3g} {self.length} from the "
            f"round faces: below that it is not known from the meshes",
            f"about {abs(apart):.2g} {self.length} by smooth surfaces through the nodes",
            f"{kind} above {self.pair.chord:.3g} {self.length}, or quadratic elements with middle nodes on the face",
            f'{remedy} (gap = "closed": the faces touch), or mesh with quadratic elements',
        )
        return False


@dataclass(frozen=True)
class _Gap(_Distance):
    """The gap by the behaviour, by what is given, and by the meshes."""

    def opening(self) -> Opening | None:
        """The gap; None, with its problem reported, where the faces do not fit."""
        measured = self._measured()
        if measured is None:
            return None
        distance, note = measured.gap, measured.note
        if self.interface.behaviour == "perfect":
            return self._bonded(distance)
        if self.interface.gap == "closed":
            return self._closed()
        if self.interface.interference > 0.0:
            return self._number(-self.interface.interference, "interference", distance)
        if self.interface.number_gap is not None:
            return self._number(self.interface.number_gap, "gap", distance)
        depth = -float(distance.min())
        if self.negligible < depth <= _CAD_ROUND_OFF * (self.interface.search or 0.0):
            self._say(
                "overlap",
                f"its faces overlap by {depth:.3g} {self.length}, closed as round-off of the geometry (below search / "
                "20)",
            )
            distance = np.maximum(distance, 0.0)
        elif depth > self.negligible:
            if (fit := self._overlapping(distance)) is None:
                return None
            distance, note = fit.gap, fit.note
        # a layer fills the distance of its faces
        if not self.interface.behaves_open:
            return Opening(np.zeros(len(distance)))
        return Opening(np.where(np.abs(distance) < self.negligible, 0.0, distance), note)

    def _number(self, value: float, key: str, distance: Array) -> Opening:
        """The number given, whatever the distance of the meshes, which is said where it is another one."""
        if not distance.any():
            return Opening(np.full(len(distance), value))
        meshes = f"the meshes are {distance.min():.6g} to {distance.max():.6g} {self.length} apart"
        if distance.min() < 0.0:
            meshes += " (below 0: into each other)"
        differs = np.abs(distance - value) > self.within + _AS_WRITTEN * np.abs(distance).max()
        if differs.any():
            self._say("gap", f"{key} = {abs(value):g} {self.length} counts; {meshes}")
        return Opening(np.full(len(distance), value), f"{key} as given; {meshes}")

    def _closed(self) -> Opening | None:
        """Gap 0 where the distance is below the spacing of the nodes; else None and a problem."""
        distance = self.pair.distance
        far, spacing = float(np.abs(distance).max()), float(np.sqrt(np.median(self.pair.areas)))
        if far <= _CLOSABLE * spacing:
            return Opening(np.zeros(len(distance)))
        self.problems.add(
            f"interface.{self.name}.gap",
            "gap or overlap of the faces too large for closed faces",
            f"{distance.min():.4g} to {distance.max():.4g} {self.length}",
            f"up to the node spacing, {spacing:.4g} {self.length}",
            'move the meshes together, or use gap = "measured"',
        )
        return None

    def _bonded(self, distance: Array) -> Opening | None:
        """No gap: faces that touch, are nearer than a ``search`` that is given, or overlap by no more than a thread."""
        apart, depth = float(distance.max()), -float(distance.min())
        most = self.interface.search or 0.0
        apart_at_most = max(MATCHING * self.size, most)
        if self.interface.overlap == "ignore":
            deepest = np.inf
        else:
            deepest = max(apart_at_most, _THREAD * self._radius)
        if self.interface.overlap == "refuse":
            deepest = MATCHING * self.size
        largest = max(apart, depth)
        if apart <= apart_at_most and depth <= deepest:
            if largest <= MATCHING * self.size:
                return Opening(np.zeros(len(distance)))
            if depth >= apart:
                how = "overlap"
            else:
                how = "are apart"
            note = f"bonded where its faces {how} by up to {largest:.4g} {self.length}"
            # asked for, as of a thread in a hole drawn at its core or as drilled
            if self.interface.overlap != "ignore":
                self._say("overlap", note)
                note = ""
            return Opening(np.zeros(len(distance)), note)
        which, remedy = "apart", "move the meshes together, give search (faces nearer than this are bonded)"
        if depth > apart:
            which, remedy = "into each other", f'{remedy}, overlap = "ignore"'
        self.problems.add(
            f"interface.{self.name}.sides",
            "bonded faces must touch",
            f"{largest:.6g} {self.length} {which}",
            None,
            f'{remedy}, or behaviour = "contact"',
        )
        return None

    def _overlapping(self, distance: Array) -> Opening | None:
        """The gap of faces that overlap: negative for a press fit, 0 where overlaps are ignored; else a problem."""
        depth, rule = -float(distance.min()), self.interface.overlap
        if rule == "ignore":
            return Opening(np.maximum(distance, 0.0), f"an overlap of up to {depth:.4g} {self.length} ignored")
        if rule == "refuse" or not self.interface.behaves_open:
            self._refused(f"by {depth:.6g} {self.length}", None)
            return None
        limit, of = self._smaller
        if depth > LARGEST_SHARE * limit:
            share = f"{100.0 * depth / limit:.2g} % of the {of}, {limit:.4g} {self.length}"
            self._refused(
                f"by {depth:.6g} {self.length}, {share}",
                f"up to {100.0 * LARGEST_SHARE:g} %, {LARGEST_SHARE * limit:.3g} {self.length}, which is a press fit",
            )
            return None
        share = f"{100.0 * depth / limit:.2g} % of the {of}"
        self._say(
            "overlap",
            f"its faces overlap by up to {depth:.4g} {self.length} ({share}): a press fit of this interference, "
            'carried from the static start on; overlap = "ignore" if it is none',
        )
        return Opening(distance, "interference of the meshes")

    def _refused(self, depth: str, allowed: str | None) -> None:
        """A problem of faces that overlap."""
        if self.interface.against_ground:
            self.problems.add(
                f"interface.{self.name}.ground",
                "the face and the ground overlap at the start",
                depth,
                allowed,
                "move the plane, or turn the normal (it points out of the ground)",
            )
            return
        remedy = "move the meshes apart"
        if self.interface.behaves_open:
            remedy = "if it is a press fit: draw its true diameters, or give interference; if a thread, to be bonded: "
            remedy += 'behaviour = "perfect"; else move the meshes apart, or set gap = "closed" or overlap = "ignore"'
        elif "overlap" in TAKES[self.interface.behaviour]:
            remedy += ', or set overlap = "ignore"'
        self.problems.append(
            Problem(f"interface.{self.name}.sides", "the two faces overlap at the start", depth, allowed, remedy)
        )
