"""What holds the two ends of a bolt against its tension.

The cut of a shank divides its body into two ends, and the tension pulls each towards the other. An end is held where
one of these takes it along the axis:

* a bond (a perfect interface, a thread, a layer with a stiffness along the axis, a coupling) or a spring,
* nodes that a condition holds along the axis,
* a contact on facets of the bolt within 60 degrees of the axis, turned the way that the tension pulls: the seat of a
  head, a cone,
* a contact whose sides are pressed before the bolt is tightened, by a press fit or a preload, with friction or along
  the axis.

Other contacts do not hold an end. A screw in a hole of its own diameter touches it all around, but nothing there takes
the tension: chords of a cylinder are tilted against the axis, and only seem to. Their tilts cancel all around, those of
a cone do not: of facets that are inclined to the axis, what counts is what is left of their areas across it.
"""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass
from typing import Final

import numpy as np
import scipy.sparse as sp

from ..assembly.body import Body, body_sides
from ..assembly.bolt_cuts import held_nodes
from ..assembly.bolts import BoltCut
from ..assembly.conditions import Conditions
from ..assembly.press_fits import interference
from ..errors import Problem
from ..fem.faces import Surface
from ..fem.mesh import Array, FacetBlock, FacetSet
from ..interface.laws import coulomb_coefficient
from ..latin.assembly import InterfaceUnit
from ..scene.fields import split_face

_TURNED: Final = 0.5  # cosine between normal and axis from which on a contact counts: 60 degrees
_FLAT: Final = 0.966  # the same of facets that lie across the axis, 15 degrees: no cylinder has such chords
_LEAST: Final = 0.01  # of the section of the cut: area across the axis below which a contact is a touch
_ALONG: Final = 1e-3  # cosine between a spring and the axis below which it is across the axis
_WIDER: Final = 1.2  # times the radius of the cut: an end with a head
_SAME: Final = 1e-6  # of the size of the body: nodes at one height
_NEAR: Final = 5e-3  # the same: a coordinate that is written as 0


@dataclass(frozen=True)
class BoltEnd:
    """One of the two ends of a bolt.

    Attributes
    ----------
    cut : of its shank. body : the one of the shank. nodes : (n_node,) of this end. fixed : (n_node,) nodes that a
        condition holds along the axis. pull : (3,) unit vector along which the tension pulls it.
    """

    cut: BoltCut
    body: Body
    nodes: np.ndarray
    fixed: np.ndarray
    pull: Array

    @classmethod
    def both(cls, cut: BoltCut, body: Body, fixed: np.ndarray) -> tuple[BoltEnd, BoltEnd]:
        """The two ends of a bolt, the one beyond the cut first; ``fixed`` : (n_node,) nodes that a condition holds
        along the axis."""
        on_cut = np.zeros(body.mesh.n_node, dtype=bool)
        on_cut[cut.nodes] = True
        # the part beyond the cut lies along the axis, and is pulled back
        beyond, before = cut.moving & ~on_cut, ~cut.moving & ~on_cut
        return cls(cut, body, beyond, fixed, -cut.axis), cls(cut, body, before, fixed, cut.axis)

    def problem(self, units: Sequence[InterfaceUnit]) -> Problem | None:
        """A problem where nothing holds the end; ``units`` : the interfaces that carry something at rest."""
        if (self.fixed & self.nodes).any():
            return None
        touching = []
        for i, side, name in body_sides(units):
            nodes = self._nodes_in(units[i], side, name)
            if nodes is None:
                continue
            if self._holds(units[i], side, nodes):
                return None
            touching.append(units[i].attached or f"interface.{units[i].name}")
        if touching:
            why = f"{', '.join(touching)} there, but not along the axis"
        else:
            why = "no interface is there"
        remedy = 'bond its thread: thread = {part = "...", length = ...}, or an [interface.NAME] with behaviour = '
        remedy += '"perfect"; or support it by a seat, nut, spring or boundary'
        return Problem(
            f"bolt.{self.cut.name}.thread",
            f"nothing holds {self._words()} against the tension",
            why,
            "a bond, spring or held face; a contact within 60 degrees of the axis on the side that resists; a press "
            "fit with friction",
            remedy,
        )

    def _words(self) -> str:
        """Which end it is."""
        places = self.body.mesh.nodes
        section = places[self.cut.nodes]
        radius = _reach(section, self.cut.point, self.cut.axis).max()
        points = places[self.nodes]
        wide = _reach(points, self.cut.point, self.cut.axis).max() > _WIDER * radius
        height = points @ self.pull
        tip = points[height <= height.min() + _SAME * self.body.mesh.size]
        middle, near = 0.5 * (tip.min(axis=0) + tip.max(axis=0)), _NEAR * self.body.mesh.size
        at = ", ".join(f"{x:.4g}" for x in np.where(np.abs(middle) < near, 0.0, middle).tolist())
        return f"the {'head' if wide else 'end'} of {self.body.name} at [{at}] {self.body.units['m']}"

    def _nodes_in(self, unit: InterfaceUnit, side: int, name: str) -> np.ndarray | None:
        """(n_node,) nodes of this end that take part in a side of an interface; None where there are none."""
        trace = unit.geometry.traces[side]
        if name != self.body.name or trace is None:
            return None
        nodes = np.zeros(len(self.nodes), dtype=bool)
        nodes[np.unique(sp.csr_array(trace).indices) // 3] = True
        nodes &= self.nodes
        if nodes.any():
            return nodes
        return None

    def _holds(self, unit: InterfaceUnit, side: int, nodes: np.ndarray) -> bool:
        """Whether an interface takes the end along the axis."""
        law = unit.behaviour
        if law.opens:
            seat = self._across(unit, side, nodes, both_ways=False)
            return seat > _LEAST * self.cut.area or self._pressed(unit, side, nodes)
        # a bond has neither: nothing gives way
        along = float(getattr(law, "normal_stiffness", np.inf))
        aside = float(getattr(law, "tangential_stiffness", np.inf))
        if along > 0.0 and aside > 0.0:
            return True
        # a layer without one of the two, or a spring with a direction
        cosines = np.abs(unit.geometry.frames[:, 0] @ self.pull)
        if unit.attached:
            return bool(((along > 0.0) & (cosines > _ALONG)).any() or ((aside > 0.0) & (cosines < 1.0 - _ALONG)).any())
        if aside > 0.0:
            return bool((cosines < _TURNED).any())
        return along > 0.0 and self._across(unit, side, nodes, both_ways=True) > _LEAST * self.cut.area

    def _pressed(self, unit: InterfaceUnit, side: int, nodes: np.ndarray) -> bool:
        """Whether points of the end are pressed before the bolt is tightened, with friction or along the axis."""
        pressed = (interference(unit) > 0.0) | (unit.preload > 0.0)
        if coulomb_coefficient(unit.behaviour) == 0.0:
            pressed &= np.abs(unit.geometry.frames[:, 0] @ self.pull) >= _TURNED
        trace = unit.geometry.traces[side]
        assert trace is not None
        mine = np.asarray(abs(trace) @ np.repeat(nodes, 3).astype(float)).reshape(-1, 3).any(axis=1)
        return bool((pressed & mine).any())

    def _across(self, unit: InterfaceUnit, side: int, nodes: np.ndarray, both_ways: bool) -> float:
        """Area across the axis, m2, of the facets of this end in an interface that are turned the way of the pull, or
        against it, too."""
        blocks = []
        for block in self.body.facets(split_face(unit.sides[side])[1]).blocks:
            taken = nodes[block.corners].all(axis=1)
            if taken.any():
                blocks.append(FacetBlock(block.kind, block.facets[taken]))
        if not blocks:
            return 0.0
        pieces = Surface(self.body.mesh.nodes, FacetSet(tuple(blocks))).pieces
        cosine = np.concatenate([piece.normals @ self.pull for piece in pieces])
        area = np.concatenate([piece.areas for piece in pieces]) * cosine
        flat, inclined = np.abs(cosine) >= _FLAT, (np.abs(cosine) >= _TURNED) & (np.abs(cosine) < _FLAT)
        if both_ways:
            return float(np.abs(area[flat]).sum() + abs(area[inclined].sum()))
        return float(area[flat & (cosine > 0.0)].sum() + max(0.0, area[inclined].sum()))


def _reach(points: Array, middle: Array, axis: Array) -> Array:
    """Distance (n,) of points from the line through ``middle`` along the axis, m."""
    arm = points - middle
    return np.asarray(np.linalg.norm(arm - np.outer(arm @ axis, axis), axis=1))


def unheld_ends(
    cuts: Iterable[BoltCut],
    bodies: Mapping[str, Body],
    conditions: Mapping[str, Conditions],
    units: Sequence[InterfaceUnit],
) -> Iterator[Problem]:
    """A problem for every end of a bolt with a tension that nothing holds; ``units`` : those that carry something at
    rest. A cut that leaves the body in one piece, of a frame, has no ends."""
    for cut in cuts:
        if cut.tension is None or not cut.moving.any():
            continue
        body = bodies[cut.table.substructure]
        fixed = held_nodes(conditions[body.name], cut.axis, body.mesh.n_node)
        for end in BoltEnd.both(cut, body, fixed):
            if (problem := end.problem(units)) is not None:
                yield problem
