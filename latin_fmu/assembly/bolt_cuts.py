"""Where the shanks of bolts are cut: search for a section free of interfaces and held nodes.

The plane of the cut divides the elements by their centres. The cut is the connected set of facets between elements on
both sides of it that is nearest to the point of the bolt. Without a point the plane is in the middle of the longest
stretch of the thinnest sections, where no node of the cut would belong to an interface or be held along the axis; if
there is one, between such nodes: the tip of a screw below its thread has no tension.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import replace
from typing import Final

import numpy as np
import scipy.sparse as sp
from scipy.sparse.csgraph import connected_components

from ..errors import Problems, listed, shown
from ..fem.elements import stiffness
from ..fem.mesh import Array, Index
from ..latin.assembly import InterfaceUnit
from ..scene.bolts import Bolt
from ..scene.schema import Scene
from .body import Body, body_sides
from .bolt_sections import with_sections
from .bolt_shares import share_of
from .bolts import BoltCut, check_diameter, check_yield
from .conditions import Conditions
from .shank_facets import SAME, ShankFacets, chosen_elements, width_of

_ALONG = 1e-6  # share of the axis along which a held direction counts
_MOST_SAID: Final = 6  # interfaces in a message
_THIN = 1.1  # times the smallest section: sections of the same shank


def cuts_of(
    scene: Scene,
    bodies: Mapping[str, Body],
    conditions: Mapping[str, Conditions],
    units: Sequence[InterfaceUnit],
    problems: Problems,
    notes: Mapping[str, str],
) -> dict[str, BoltCut]:
    """Cuts of all bolts of a scene, with ``notes`` on their threads; shanks that cannot be cut are added to
    ``problems``."""
    cuts, held = dict[str, BoltCut](), dict[str, np.ndarray]()
    for name, bolt in scene.bolt.items():
        body = bodies[bolt.substructure]
        joined = _joined_nodes(body, units)
        axis = np.asarray(bolt.axis, dtype=float)
        axis /= np.abs(axis).max()  # squares of any direction are numbers
        axis /= np.linalg.norm(axis)
        fixed = held_nodes(conditions[body.name], axis, body.mesh.n_node)
        cut = _CutSearch(name, bolt, body, axis).cut(fixed, joined, problems)
        if cut is not None:
            share = share_of(name, scene, body, axis, cut.nodes, problems)
            cuts[name] = cut = replace(cut, share=share, note=notes.get(name, ""), scaled=body.shape.moduli is not None)
            held[name] = fixed
            check_diameter(name, cut, body, problems)
            check_yield(name, cut.tension, cut, body, problems)
    if problems:
        return cuts
    return with_sections(cuts, bodies, held, units)


def _joined_nodes(body: Body, units: Sequence[InterfaceUnit]) -> dict[str, np.ndarray]:
    """(n_node,) nodes of a body that take part in each of its interfaces, by name."""
    joined: dict[str, np.ndarray] = {}
    for i, side, name in body_sides(units):
        trace = units[i].geometry.traces[side]
        if name == body.name and trace is not None:
            nodes = joined.setdefault(units[i].name, np.zeros(body.mesh.n_node, dtype=bool))
            nodes[np.unique(trace.indices) // 3] = True
    return joined


def held_nodes(conditions: Conditions, axis: Array, n_node: int) -> np.ndarray:
    """(n_node,) nodes that a boundary condition holds, drives or ties along the axis."""
    columns = sp.csc_array(conditions.expansion)
    used = columns.data != 0.0
    owner = np.repeat(np.arange(columns.shape[1]), np.diff(columns.indptr))[used]
    nodes = columns.indices[used] // 3
    # one reduced dof of several nodes
    first = np.full(columns.shape[1], n_node)
    np.minimum.at(first, owner, nodes)
    tied = np.zeros(columns.shape[1], dtype=bool)
    tied[owner[nodes != first[owner]]] = True
    # part of the axis that is among the motions of a node alone: their directions are orthonormal, along any axes
    along = np.tile(axis, n_node)
    squares = np.asarray(columns.multiply(columns).sum(axis=0)).ravel()
    share = np.divide(columns.T @ along, squares, out=np.zeros_like(squares), where=~tied & (squares > 0.0))
    residual = np.abs(along - columns @ share).reshape(n_node, 3).max(axis=1) > _ALONG
    driven = (conditions.pattern.any(axis=1).reshape(n_node, 3) & (np.abs(axis) > _ALONG)).any(axis=1)
    return np.asarray(residual | driven)


class _CutSearch:
    """Search for the cut of a bolt: of a shank, free of interfaces and held nodes."""

    def __init__(self, name: str, bolt: Bolt, body: Body, axis: Array) -> None:
        self._name, self._bolt, self._body, self._axis = name, bolt, body, axis
        self._shank = ShankFacets(body, axis)

    # -- where to cut -----------------------------------------------------------------------------------------------
    def cut(self, fixed: np.ndarray, joined: Mapping[str, np.ndarray], problems: Problems) -> BoltCut | None:
        """The cut of the bolt, or None with a problem; nodes ``fixed`` or ``joined`` by interfaces may not be on it."""
        where, point = f"bolt.{self._name}", self._bolt.point
        blocked = np.logical_or.reduce([fixed, *joined.values()])
        level = self._middle(blocked) if point is None else float(self._shank.level(np.asarray(point) @ self._axis))
        if level is None:
            named = {f"interface {name}": nodes for name, nodes in joined.items()}
            problems.add(
                where,
                f"no section of {self._body.name} across the axis is free of interfaces and held nodes: "
                f"{_stretches(self._body, self._axis, named | {'held nodes': fixed})}",
                shown(self._bolt.axis),
                "a shank with a layer of free nodes between its ends, without interface or boundary condition",
                "check the axis; let the interface cover the threaded faces alone, not the full shank; or refine the "
                "mesh of the shank along the axis",
            )
            return None
        chosen = self._shank.at(level)
        if not len(chosen):
            low, high = self._shank.heights.min(), self._shank.heights.max()
            height = level * self._shank.length + self._shank.bottom
            problems.add(
                where,
                f"the plane of the cut meets no element of {self._body.name}",
                f"plane at {height:.6g} {self._body.units['m']} along the axis",
                f"between {low:.6g} and {high:.6g} {self._body.units['m']}, half an element inside",
                "move the point, or omit it",
            )
            return None
        facets = self._one_section(chosen, problems)
        if facets is None or not self._fits(facets, fixed, joined, problems):
            return None
        return self._bolt_cut(facets, level)

    def _middle(self, blocked: np.ndarray) -> float | None:
        """Level in the middle of the longest stretch of the thinnest sections without blocked nodes; None where there
        is none. The elements at both ends of the body are left out: planes through them cut a part of the section."""
        areas = self._shank.projected_areas()
        shut = np.where(self._shank.facets >= 0, blocked[self._shank.facets], False).any(axis=1)
        stops = np.unique(self._shank.levels)
        # differences at the levels; their running sums hold between a level and the next
        first, last = np.searchsorted(stops, self._shank.low), np.searchsorted(stops, self._shank.high)
        area, closed = np.zeros(len(stops) + 1), np.zeros(len(stops) + 1)
        # sums over the facets that a plane meets, from the levels at which they begin and end
        for values, total in ((areas, area), (shut.astype(float), closed)):
            np.add.at(total, first, values)
            np.add.at(total, last, -values)
        area, closed = np.cumsum(area)[: len(stops) - 1], np.cumsum(closed)[: len(stops) - 1]
        heights = [self._shank.heights[c] for c in self._shank.cells]
        spans = np.concatenate([self._shank.level(np.stack([z.min(1), z.max(1)])) for z in heights], axis=1)
        low_end = spans[1][spans[0] <= SAME].max(initial=0.0)
        high_end = spans[0][spans[1] >= 1.0 - SAME].min(initial=1.0)
        inside = (stops[1:] > low_end) & (stops[:-1] < high_end)
        # closed is a count, summed up in floating point
        usable = (closed < 0.5) & (area > 0.0) & inside
        if not usable.any():
            return None
        usable = _between(stops, self._shank.level(self._shank.heights[blocked]), usable)
        thin = usable & (area <= _THIN * area[usable].min())
        # edges of runs of True, in pairs: first and behind the last
        edges = np.flatnonzero(np.diff(np.concatenate([[False], thin, [False]]).astype(int)))
        starts, ends = stops[edges[::2]], stops[edges[1::2]]
        longest = int(np.argmax(ends - starts))
        return float(0.5 * (starts[longest] + ends[longest]))

    def _one_section(self, chosen: Index, problems: Problems) -> Index | None:
        """Facets of the connected section that is nearest to the point of the bolt, or the only one."""
        shank, where, point = self._shank, f"bolt.{self._name}.point", self._bolt.point
        if point is None:
            label = shank.labels(chosen)
            if (label == label[0]).all():
                return chosen
            problems.add(
                where,
                f"the plane cuts {len(np.unique(label))} separate sections of {self._body.name}",
                None,
                "a point [x, y, z] on the shank of this bolt",
                "give the point",
            )
            return None
        section, distance, width, centre = shank.nearest(chosen, np.asarray(point))
        if distance <= max(width, np.sqrt(shank.area(section))):
            return section
        near = ", ".join(f"{x:.6g}" for x in centre)
        problems.add(
            where,
            f"the nearest section of {self._body.name} on the plane of the cut is {distance:.4g} "
            f"{self._body.units['m']} away",
            shown(point),
            "a point on the shank, or within one width of the shank",
            f"the section has a point at [{near}]",
        )
        return None

    def _fits(self, facets: Index, fixed: np.ndarray, joined: Mapping[str, np.ndarray], problems: Problems) -> bool:
        """Whether the section is that of a shank: free of interfaces and held nodes, no wider than the body is long."""
        nodes = self._shank.nodes_of(facets)
        where, width = f"bolt.{self._name}", width_of(self._body.mesh.nodes[nodes], self._axis)
        # wider than long: the axis runs across a plate, or the body is no bolt
        if width > self._shank.length:
            length = self._body.units["m"]
            problems.add(
                f"{where}.axis",
                f"no shank along the axis: the section of {self._body.name} is {width:.4g} {length} wide, the body "
                f"{self._shank.length:.4g} {length} long along the axis",
                shown(self._bolt.axis),
                "a section that is not wider than the length of the body",
                "give the axis of the shank",
            )
            return False
        names = [name for name, taken in joined.items() if taken[nodes].any()]
        blocked = np.logical_or.reduce([fixed, *joined.values()])[nodes]
        if blocked.any():
            why = f"of interfaces: {listed(names)}" if names else "held along the axis by a boundary condition"
            problems.add(
                where,
                f"{int(blocked.sum())} of the {len(nodes)} nodes of the cut of {self._body.name} are {why}",
                shown(self._bolt.point),
                "a cut between them",
                "move the point along the axis, omit it, or refine the mesh of the shank along the axis",
            )
            return False
        return True

    # -- the cut ----------------------------------------------------------------------------------------------------
    def _bolt_cut(self, facets: Index, level: float) -> BoltCut:
        body, axis = self._body, self._axis
        nodes = self._shank.nodes_of(facets)
        # the side that the jump moves: chi is 1 at the nodes of the cut, 0 elsewhere
        beyond = self._shank.touching(nodes) & (self._shank.levels > level)
        jump = np.zeros((body.mesh.n_node, 3))
        jump[nodes] = axis
        elements = chosen_elements(body.mesh, body.shape.moduli, beyond)
        matrix = stiffness(elements, body.shape.elasticity, body.shape.bending_modes)
        pattern = np.asarray(matrix @ jump.ravel())
        # forces that cancel, but for round-off
        pattern[np.abs(pattern) <= 1e-14 * np.abs(pattern).max()] = 0.0
        return BoltCut(
            self._name,
            self._bolt,
            axis,
            body.mesh.nodes[nodes].mean(axis=0),
            self._shank.area(facets),
            nodes,
            beyond,
            self._moving(facets, beyond),
            pattern,
            float(jump.ravel() @ pattern),
            float(pattern @ (body.mesh.nodes @ body.shape.elasticity.expansion).ravel()),
            thread_area=self._bolt.thread_area(body.units),
        )

    def _moving(self, facets: Index, beyond: np.ndarray) -> np.ndarray:
        """(n_node,) nodes of the elements joined to those beyond the cut through facets that are not cut."""
        whole = np.ones(len(self._shank.facets), dtype=bool)
        whole[facets] = False
        n = len(self._shank.levels)
        pairs = (np.ones(int(whole.sum())), (self._shank.below[whole], self._shank.above[whole]))
        label = connected_components(sp.coo_array(pairs, shape=(n, n)), directed=False)[1]
        cells = np.isin(label, label[beyond])
        moving, first = np.zeros(self._body.mesh.n_node, dtype=bool), 0
        for block in self._body.mesh.blocks:
            moving[block.cells[cells[first : first + len(block.cells)]].ravel()] = True
            first += len(block.cells)
        # all elements: a ring, which one cut does not divide
        return moving if not cells.all() else np.zeros_like(moving)


def _between(stops: Array, blocked: Array, usable: np.ndarray) -> np.ndarray:
    """Of the usable stretches between levels those between blocked nodes, if there are any: beyond the last one that
    something takes, as in the tip of a screw below its thread, there is no tension."""
    tight = usable & (stops[:-1] >= blocked.min(initial=1.0)) & (stops[1:] <= blocked.max(initial=0.0))
    if tight.any():
        return np.asarray(tight)
    return usable


def _stretches(body: Body, axis: Array, blocking: Mapping[str, np.ndarray]) -> str:
    """Stretches of blocked nodes (n_node,) along the axis, by what blocks them, in words; the longest first."""
    heights, unit = body.mesh.nodes @ axis, body.units["m"]
    blocked = [(what, heights[nodes]) for what, nodes in blocking.items() if nodes.any()]
    found = sorted(blocked, key=lambda p: -np.ptp(p[1]))
    parts = [f"{what} from {z.min():.4g} to {z.max():.4g} {unit}" for what, z in found[:_MOST_SAID]]
    parts += [f"{len(found) - _MOST_SAID} more"] * (len(found) > _MOST_SAID)
    parts.append(f"{body.name} from {heights.min():.4g} to {heights.max():.4g} {unit} along the axis")
    return ", ".join(parts)
