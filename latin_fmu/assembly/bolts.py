"""Bolts: a shank cut across its axis, whose two sides have a uniform jump of displacement along the axis.

The elements of the shank are divided by the plane of the cut. At the nodes common to both sides the elements beyond
the plane have the displacement u - delta chi a, the others u: a is the unit axis, chi is 1 at the nodes of the cut, and
delta > 0 shortens the shank. With the stiffness K' of the elements beyond the plane alone,

    K u = f + delta g,      g = K' chi a,      F = k delta - g . u,      k = chi a . K' chi a,

where F is the resultant along a of the stresses on the cut. The forces delta g are in equilibrium by themselves. The
cut follows facets of elements; a jump of a translation is equivalent on every cut through the same shank, so that
neither their steps nor the place of the plane matter. The mesh and its unknowns stay what they are.

While a bolt is tightened F is given and delta is not. Eliminated,

    (K - g g^T / k) u = f + F g / k,      delta = (F + g . u) / k.

A change of temperature T strains a free body by alpha T, so that u is u - alpha x T in F. A shank that yields has a
plastic elongation q, and the shortening delta - q (``yielding_bolts``).

The plane of the cut divides the elements by their centres. The cut is the connected set of facets between elements on
both sides of it that is nearest to the point of the bolt. Without a point the plane is in the middle of the longest
stretch of the thinnest sections, where no node of the cut would belong to an interface or be held along the axis; if
there is one, between such nodes: the tip of a screw below its thread has no tension.
"""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from typing import Final

import numpy as np
import scipy.sparse as sp
from scipy.sparse.csgraph import connected_components

from ..errors import Problems, listed, shown
from ..fem.elasticity import Elasticity
from ..fem.elements import Elements, MeanStress, Recovery, stiffness
from ..fem.faces import face_of
from ..fem.mesh import Array, FacetSet, Index, Mesh
from ..fem.reference_cells import CELL_FACES, FACET_CORNERS, FACET_KIND, N_CORNER, Rule
from ..latin.assembly import InterfaceUnit
from ..propagator import LoadTerm
from ..scene.bolts import LARGEST_STRESS, NUT_FACTOR, Bolt
from ..scene.schema import Scene
from ..scene.units import UnitSystem
from .body import Body, Shape, body_sides
from .bolt_shares import fraction, share_of
from .conditions import Conditions

FITTING: Final = 0.75, 1.2
"""Diameter of the meshed shank over the nominal one, from core to nominal, with some play for sections not round."""
WAISTED: Final = 0.5
"""The same of a shank whose thread has no size, from."""
SECTION: Final = 0.85, 1.4
"""Meshed section over the stress area of the thread, of the modelled part, from and up to which the two agree."""
_CONE = 3.0  # radii of a shank around its axis within which points are clamped by it


@dataclass(frozen=True)
class BoltCut:
    """Cut of a shank (module docstring).

    Attributes
    ----------
    name, table : of the bolt in the scene. axis : (3,) unit vector a. point : (3,) centre of the cut, m.
    area : of the cut across the axis, m2. nodes : of the cut. beyond : (n_cell,) elements beyond the plane that touch
        it. moving : (n_node,) nodes joined to those elements when the cut is open.
    pattern : (n_full,) g, N m-1. stiffness : k, N m-1. heated : tension per change of temperature where u = 0, N K-1.
    loose : whether F is given and delta is not, while tightened.
    thread_area : tensile stress area of the whole thread, m2; None where the bolt names none.
    share : of the whole screw that is modelled. note : what ``check`` says of its thread.
    scaled : whether the modulus of the free shank is scaled to the core of its thread.
    """

    name: str
    table: Bolt
    axis: Array
    point: Array
    area: float
    nodes: Index
    beyond: np.ndarray
    moving: np.ndarray
    pattern: Array
    stiffness: float
    heated: float = 0.0
    loose: bool = False
    thread_area: float | None = None
    share: float = 1.0
    note: str = ""
    scaled: bool = False

    @property
    def tension(self) -> float | None:
        """Force that the modelled part is tightened to, N; None where the shortening is given."""
        return self.table.tension(self.share)

    @property
    def load(self) -> str:
        """Name of its load term."""
        return load_name(self.name)

    @property
    def stress_area(self) -> float:
        """Section of the modelled part whose stress is compared with a yield stress, m2: that of the thread, else of
        the cut."""
        if self.thread_area is None:
            return self.area
        return self.share * self.thread_area

    def stressed(self, pattern: Array, stiffness: float) -> BoltCut:
        """The cut of a shank whose stress adds (n_full,) to g and a number, N m-1, to k."""
        return replace(self, pattern=self.pattern + pattern, stiffness=self.stiffness + stiffness)

    def loads(self) -> LoadTerm:
        """Load term of the bolt: amplitude delta, F while it is loose."""
        return LoadTerm(self.load, self.pattern / self.stiffness if self.loose else self.pattern)

    def stress(self, body: Body) -> float:
        """Mean stress of the shank when tightened, Pa; with a given shortening, of a shank as long as its body and held
        at both ends."""
        if self.table.shortening is not None:
            return (
                float(body.shape.elasticity.moduli_along(self.axis)[0])
                * self.table.shortening
                / float(np.ptp(body.mesh.nodes @ self.axis))
            )
        return (self.tension or 0.0) / self.area

    def line(self, units: UnitSystem) -> str:
        """Section and place of the cut, and target, for the command ``check``."""
        at = ", ".join(f"{round(float(x), 9) + 0.0:.6g}" for x in self.point)
        force = self.tension
        target = ""
        if force is not None:
            target = (
                f"{force:.6g} {units['N']}{self._torque(units)}{self._whole(force, units)}, "
                f"mean stress {force / self.stress_area:.4g} "
                f"{units['Pa']}{self._thread(units)}, "
            )
        section = f"{self.area:.6g} {units['m2']} of {self.table.substructure}"
        note = ""
        if self.note:
            note = f"; {self.note}"
        return f"  bolt {self.name}: section {section} at [{at}], {target}order {self.table.order}{note}"

    def _thread(self, units: UnitSystem) -> str:
        """The section that the stress is of, where it is not the meshed one, in words."""
        if self.thread_area is None:
            return ""
        part = _of_share(self, "{} of ")
        return f" over {part}the stress area of {self.table.size}, {self.thread_area:.4g} {units['m2']}"

    def _whole(self, force: float, units: UnitSystem) -> str:
        """The force of the whole screw, where a part of it is modelled, in words."""
        if self.share == 1.0:
            return ""
        return f" on {fraction(self.share)} of the screw ({force / self.share:.6g} {units['N']} as a whole)"

    def _torque(self, units: UnitSystem) -> str:
        """The torque that the target is of, in words."""
        table = self.table
        if table.torque is None:
            return ""
        return f" of {table.torque:.6g} {units['N m']}, nut factor {table.nut_factor or NUT_FACTOR:g}"

    def clamp(self, nodes: Array, shortening: float) -> Clamp:
        """Where the bolt clamps; ``nodes`` (n, 3) of its body, m."""
        along = nodes @ self.axis
        return Clamp(self, (float(along.min()), float(along.max())), shortening)

    @property
    def motion(self) -> Array:
        """Motion (3 n_node,) of the part beyond the cut by 1 along the axis, the rest of the body at rest."""
        return np.outer(self.moving, self.axis).ravel()

    def softening(self) -> sp.csr_array:
        """g g^T / k, (n_full, n_full): what the stiffness loses while delta is free."""
        at = np.flatnonzero(self.pattern)
        block = np.outer(self.pattern[at], self.pattern[at]) / self.stiffness
        rows, columns = np.repeat(at, len(at)), np.tile(at, len(at))
        return sp.csr_array(sp.coo_array((block.ravel(), (rows, columns)), shape=2 * (len(self.pattern),)))

    def force(self, shortening: float, displacement: Array) -> float:
        """Tension F, N; ``displacement`` (n_full,), m."""
        return float(self.stiffness * shortening - self.pattern @ displacement)

    def shortening(self, force: float, displacement: Array) -> float:
        """delta, m, under a tension, N."""
        return float((force + self.pattern @ displacement) / self.stiffness)


@dataclass(frozen=True)
class Clamp:
    """A bolt as tightened. It clamps within ``_CONE`` times the radius of its section around the axis, along its body
    and as far beyond.

    Attributes
    ----------
    cut : of its shank. ends : first and last coordinate of its body along the axis, m. shortening : m.
    """

    cut: BoltCut
    ends: tuple[float, float]
    shortening: float

    def holds(self, points: Array) -> np.ndarray:
        """Whether the bolt clamps points (n, 3), (n,)."""
        arm = points - self.cut.point
        arm = arm - np.outer(arm @ self.cut.axis, self.cut.axis)
        along = points @ self.cut.axis
        reach = _CONE * float(np.sqrt(self.cut.area / np.pi))
        near: np.ndarray = np.linalg.norm(arm, axis=1) <= reach
        return near & (along >= self.ends[0] - reach) & (along <= self.ends[1] + reach)

    def shifts(self, cells: np.ndarray) -> np.ndarray:
        """Motion (n_cell, n, 3), m, of the nodes of cells (n_cell, n) by the cut, beyond it alone."""
        beyond = self.cut.beyond[:, None] & np.isin(cells, self.cut.nodes)
        return np.where(beyond[:, :, None], -self.shortening * self.cut.axis, 0.0)


def load_name(bolt: str) -> str:
    """Name of the load term of a bolt; no load of a scene has a dot in its name."""
    return f"bolt.{bolt}"


def check_yield(name: str, force: float | None, cut: BoltCut, body: Body, problems: Problems) -> None:
    """Refuse a tension whose mean stress is above the yield stress of the material or of the property class; above
    ``LARGEST_STRESS`` where neither is given."""
    units = body.units
    part = _of_share(cut, " ({} of the screw is modelled)")
    section = "shank"
    if cut.thread_area is not None:
        section = f"thread {cut.table.size}"
    limit, of = _limit(cut.table, body)
    if force is None or limit is None or force <= limit * cut.stress_area:
        return
    problems.add(
        f"bolt.{name}",
        f"the mean stress of the {section}, "
        f"{force:.6g} {units['N']} / {cut.stress_area:.6g} {units['m2']}{part}, is above {of}",
        f"{force / cut.stress_area:.4g} {units['Pa']}",
        f"at most {limit:.4g} {units['Pa']}, a force of {limit * cut.stress_area:.4g} {units['N']}",
        "tighten the bolt less, or choose a larger section or another material; are the units of force, torque and "
        "diameter right?",
    )


def _of_share(cut: BoltCut, words: str) -> str:
    """The share of the screw that is modelled, in these ``words``; nothing of a whole one."""
    if cut.share == 1.0:
        return ""
    return words.format(fraction(cut.share))


def _limit(table: Bolt, body: Body) -> tuple[float | None, str]:
    """Largest mean stress of a bolt, Pa, and what it is of, in words; None of numbers without units."""
    of_material, of_class = body.shape.material.yield_stress, table.class_stress(body.units)
    limits = []
    if of_material is not None:
        limits.append((of_material, "the yield stress of the material"))
    if of_class is not None:
        limits.append((of_class, f"the yield stress of class {table.property_class}"))
    if limits:
        return min(limits)
    if not body.units.measurable:
        return None, ""
    return LARGEST_STRESS / body.units.size("Pa"), "that of any screw: no property_class and no yield_stress is given"


def check_diameter(name: str, cut: BoltCut, body: Body, problems: Problems) -> None:
    """Refuse a nominal diameter that is not that of the meshed shank."""
    nominal, units = cut.table.nominal(body.units), body.units["m"]
    if nominal is None:
        return
    # of a round section of this area
    drawn = 2.0 * float(np.sqrt(cut.area / (cut.share * np.pi)))
    value = f"{nominal:.4g} {units}"
    if cut.table.size is not None:
        key, least = "thread", FITTING[0]
        value = f"{value}, {cut.table.size}"
    else:
        # a waisted shank is thinner than its core, and is no thread
        key, least = "diameter", WAISTED
    if least <= drawn / nominal <= FITTING[1]:
        return
    part = _of_share(cut, " ({} of it is modelled)")
    problems.add(
        f"bolt.{name}.{key}",
        f"the section of the cut of {body.name} is that of a diameter of {drawn:.4g} {units}{part}",
        value,
        f"a shank of {least:g} to {FITTING[1]:g} of the nominal diameter",
        "check thread, diameter, share and the scale of the mesh; of a waisted shank give the diameter without thread",
    )


def section_remarks(cuts: Iterable[BoltCut], units: UnitSystem) -> Iterator[str]:
    """Remarks on meshed sections that are not those of the threads."""
    for cut in cuts:
        # where the moduli of the free shank are scaled its section does not count
        if cut.thread_area is None or cut.scaled or SECTION[0] <= (ratio := cut.area / cut.stress_area) <= SECTION[1]:
            continue
        part = _of_share(cut, " times the share {} that is modelled")
        yield (
            f"bolt {cut.name}: its meshed section, {cut.area:.4g} {units['m2']}, is {ratio:.3g} of the stress area of "
            f"{cut.table.size}{part} ({SECTION[0]:g} to {SECTION[1]:g} are usual): its stiffness is that of another "
            "screw; are the thread, the share and the length unit right?"
        )


# -- stresses of a body with bolts ------------------------------------------------------------------------------------
class OpenedMesh:
    """Mesh of a body with its cuts opened: the elements beyond have nodes of their own on the cut.

    Parameters
    ----------
    mesh : of the body. cuts : of its bolts. shortening : of every bolt, m.
    """

    def __init__(self, mesh: Mesh, cuts: Iterable[BoltCut], shortening: Mapping[str, float]) -> None:
        blocks = [block.cells.copy() for block in mesh.blocks]
        added = []
        shifts = []
        n = mesh.n_node
        self._jumps: dict[str, tuple[slice, Array]] = {}
        for cut in cuts:
            copies = np.arange(mesh.n_node)
            copies[cut.nodes] = n + np.arange(len(cut.nodes))
            first = 0
            for cells in blocks:
                rows = np.flatnonzero(cut.beyond[first : first + len(cells)])
                corners = cells[rows]
                # nodes that an earlier cut has doubled stay
                cells[rows] = np.where(corners < mesh.n_node, copies[np.minimum(corners, mesh.n_node - 1)], corners)
                first += len(cells)
            self._jumps[cut.name] = slice(n, n + len(cut.nodes)), cut.axis
            n += len(cut.nodes)
            added.append(cut.nodes)
            shifts.append(np.tile(-shortening.get(cut.name, 0.0) * cut.axis, (len(cut.nodes), 1)))
        self._twins, self._shift = np.concatenate(added), np.concatenate(shifts)
        # twins stand where their nodes do: the mesh is open in its connectivity alone
        nodes = np.concatenate([mesh.nodes, mesh.nodes[self._twins]])
        pairs = zip(mesh.blocks, blocks, strict=True)
        self.mesh = Mesh(nodes, tuple(replace(block, cells=cells) for block, cells in pairs), {})

    @property
    def merging(self) -> sp.csr_array:
        """(n_node and nodes beyond the cuts, n_node) from values at the nodes to those of the opened mesh, no jump."""
        n = len(self.mesh.nodes) - len(self._twins)
        owners = np.concatenate([np.arange(n), self._twins])
        return sp.csr_array((np.ones(len(owners)), (np.arange(len(owners)), owners)), shape=(len(owners), n))

    def jumps(self) -> Iterator[tuple[str, Array]]:
        """Motion (n_node and nodes beyond the cuts, 3) of the nodes beyond each cut by 1 along its axis, by bolt."""
        for name, (twins, axis) in self._jumps.items():
            jump = np.zeros((len(self.mesh.nodes), 3))
            jump[twins] = axis
            yield name, jump

    def recovery(self, shape: Shape) -> Recovery:
        """Strains of the elements and stresses at the nodes."""
        return _OpenedRecovery(Elements(self.mesh, shape.moduli), shape.elasticity, shape.bending_modes, self)

    def closed(self, values: Array) -> Array:
        """Values at the nodes (..., n_node, k), on the cuts means of both sides, from those of the opened mesh."""
        means = values[..., : values.shape[-2] - len(self._twins), :].copy()
        means[..., self._twins, :] = 0.5 * (means[..., self._twins, :] + values[..., means.shape[-2] :, :])
        return means

    def displacement(self, displacement: Array) -> Array:
        """Displacements (..., n_node and nodes beyond the cuts, 3), m, from those of the nodes (..., n_node, 3)."""
        twins = displacement[..., self._twins, :] + self._shift  # u - delta a beyond the cut
        return np.concatenate([displacement, twins], axis=-2)


class OpenedStress:
    """Mean stress of the elements of a body with bolts (as ``MeanStress``)."""

    def __init__(self, opened: OpenedMesh, shape: Shape) -> None:
        self._opened = opened
        self._mean = MeanStress(Elements(opened.mesh, shape.moduli), shape.elasticity)

    def __call__(self, displacement: Array) -> Array:
        """Mean stress (n_cell, 6), Pa, of displacements (n_node, 3), m."""
        return self._mean(self._opened.displacement(displacement))


class _OpenedRecovery(Recovery):
    """``Recovery`` of a body with bolts, from the displacements of its nodes."""

    def __init__(self, elements: Elements, material: Elasticity, bending_modes: bool, opened: OpenedMesh) -> None:
        super().__init__(elements, material, bending_modes)
        self._opened = opened

    def strain(self, displacement: Array) -> Array:
        """Mean strain (n_time, n_cell, 6) of displacements (n_time, n_node, 3), m."""
        return super().strain(self._opened.displacement(displacement))

    def nodal_stress(self, displacement: Array) -> Array:
        """Stress at the nodes (n_time, n_node, 6), Pa, of displacements (n_time, n_node, 3), m."""
        return self._opened.closed(super().nodal_stress(self._opened.displacement(displacement)))

    def at_points(self, displacement: Array, number: int, rows: Index, rule: Rule) -> tuple[Array, Array, Array]:
        """Strain, stress and volumes at points of cells, of displacements (n_node, 3) of the body, m."""
        if len(displacement) < len(self._opened.mesh.nodes):
            displacement = self._opened.displacement(displacement)
        return super().at_points(displacement, number, rows, rule)

    def nodal_forces(self, displacement: Array, unstrained: Array | None = None) -> Array:
        """Forces (n_node, 3), N, that hold the body; on the cuts those of both sides together."""
        forces = super().nodal_forces(self._opened.displacement(displacement), unstrained)
        return np.asarray(self._opened.merging.T @ forces)


_WIDEST: Final = 9  # nodes of a facet
_SAME = 1e-9  # of the length of the body: levels that are equal
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
    cuts = {}
    for name, bolt in scene.bolt.items():
        body = bodies[bolt.substructure]
        joined = _joined_nodes(body, units)
        axis = np.asarray(bolt.axis, dtype=float)
        axis /= np.abs(axis).max()  # squares of any direction are numbers
        axis /= np.linalg.norm(axis)
        fixed = held_nodes(conditions[body.name], axis, body.mesh.n_node)
        cut = _Section(name, bolt, body, axis).cut(fixed, joined, problems)
        if cut is not None:
            share = share_of(name, scene, body, axis, cut.nodes, problems)
            cuts[name] = cut = replace(cut, share=share, note=notes.get(name, ""), scaled=body.shape.moduli is not None)
            check_diameter(name, cut, body, problems)
            check_yield(name, cut.tension, cut, body, problems)
    return cuts


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


class _Section:
    """Sections of a body across an axis, along facets between its elements.

    A facet between two elements is cut by the planes between their centres.
    """

    def __init__(self, name: str, bolt: Bolt, body: Body, axis: Array) -> None:
        self._name, self._bolt, self._body, self._axis = name, bolt, body, axis
        mesh = body.mesh
        self._heights = mesh.nodes @ axis
        self._bottom, self._length = float(self._heights.min()), float(np.ptp(self._heights))
        self._cells = [block.cells[:, : N_CORNER[block.cell_type]] for block in mesh.blocks]
        self._levels = self._level(np.concatenate([self._heights[c].mean(axis=1) for c in self._cells]))
        self._below, self._above, self._facets = self._inner_facets(mesh)
        self._low, self._high = self._levels[self._below], self._levels[self._above]

    def _level(self, height: Array) -> Array:
        """Heights as shares of the length of the body, equal where they differ by round-off."""
        return np.asarray(np.round((height - self._bottom) / (self._length * _SAME)) * _SAME)

    def _inner_facets(self, mesh: Mesh) -> tuple[Index, Index, Index]:
        """Elements below and above each facet between two elements, and its nodes (n, 9), oriented out of the lower
        element, filled with -1."""
        tables, owners, first = [], [], 0
        for block in mesh.blocks:
            for local in CELL_FACES[block.cell_type]:
                nodes = np.full((len(block.cells), _WIDEST), -1, dtype=np.int64)
                nodes[:, : len(local)] = block.cells[:, list(local)]
                tables.append(nodes)
                # the number of an element counts through all blocks
                owners.append(first + np.arange(len(block.cells)))
            first += len(block.cells)
        facets, owner = np.concatenate(tables), np.concatenate(owners)
        width = (facets >= 0).sum(axis=1)
        corners = np.array([FACET_CORNERS[FACET_KIND[n]] if n in FACET_KIND else 0 for n in range(_WIDEST + 1)])[width]
        # the corners, sorted: both elements have them, in different order
        keys = np.sort(np.where(np.arange(4) < corners[:, None], facets[:, :4], -1), axis=1)
        order = np.lexsort(keys.T)
        same = np.flatnonzero((keys[order[1:]] == keys[order[:-1]]).all(axis=1))
        one, two = order[same], order[same + 1]
        upside = self._levels[owner[one]] > self._levels[owner[two]]
        one, two = np.where(upside, two, one), np.where(upside, one, two)
        return owner[one], owner[two], facets[one]

    # -- where to cut -----------------------------------------------------------------------------------------------
    def cut(self, fixed: np.ndarray, joined: Mapping[str, np.ndarray], problems: Problems) -> BoltCut | None:
        """The cut of the bolt, or None with a problem; nodes ``fixed`` or ``joined`` by interfaces may not be on it."""
        where, point = f"bolt.{self._name}", self._bolt.point
        blocked = np.logical_or.reduce([fixed, *joined.values()])
        level = self._middle(blocked) if point is None else float(self._level(np.asarray(point) @ self._axis))
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
        # half open: a plane through the centre of an element is behind it
        chosen = np.flatnonzero((self._low <= level) & (level < self._high))
        if not len(chosen):
            low, high = self._heights.min(), self._heights.max()
            problems.add(
                where,
                f"the plane of the cut meets no element of {self._body.name}",
                f"plane at {level * self._length + self._bottom:.6g} {self._body.units['m']} along the axis",
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
        areas = self._projected_areas()
        shut = np.where(self._facets >= 0, blocked[self._facets], False).any(axis=1)
        stops = np.unique(self._levels)
        # differences at the levels; their running sums hold between a level and the next
        first, last = np.searchsorted(stops, self._low), np.searchsorted(stops, self._high)
        area, closed = np.zeros(len(stops) + 1), np.zeros(len(stops) + 1)
        # sums over the facets that a plane meets, from the levels at which they begin and end
        for values, total in ((areas, area), (shut.astype(float), closed)):
            np.add.at(total, first, values)
            np.add.at(total, last, -values)
        area, closed = np.cumsum(area)[: len(stops) - 1], np.cumsum(closed)[: len(stops) - 1]
        spans = np.concatenate(
            [self._level(np.stack([self._heights[c].min(1), self._heights[c].max(1)])) for c in self._cells], axis=1
        )
        low_end = spans[1][spans[0] <= _SAME].max(initial=0.0)
        high_end = spans[0][spans[1] >= 1.0 - _SAME].min(initial=1.0)
        inside = (stops[1:] > low_end) & (stops[:-1] < high_end)
        # closed is a count, summed up in floating point
        usable = (closed < 0.5) & (area > 0.0) & inside
        if not usable.any():
            return None
        usable = _between(stops, self._level(self._heights[blocked]), usable)
        thin = usable & (area <= _THIN * area[usable].min())
        # edges of runs of True, in pairs: first and behind the last
        edges = np.flatnonzero(np.diff(np.concatenate([[False], thin, [False]]).astype(int)))
        starts, ends = stops[edges[::2]], stops[edges[1::2]]
        longest = int(np.argmax(ends - starts))
        return float(0.5 * (starts[longest] + ends[longest]))

    def _projected_areas(self) -> Array:
        """Area of each inner facet across the axis, positive out of the lower element, m2."""
        areas = np.zeros(len(self._facets))
        width = (self._facets >= 0).sum(axis=1)
        for n in np.unique(width):
            same_width = np.flatnonzero(width == n)
            places = self._body.mesh.nodes[self._facets[same_width][:, : FACET_CORNERS[FACET_KIND[int(n)]]]]
            arms = places - places[:, :1]
            # a fan of triangles from the first corner
            areas[same_width] = 0.5 * np.cross(arms[:, 1:-1], arms[:, 2:]).sum(axis=1) @ self._axis
        return areas

    def _one_section(self, chosen: Index, problems: Problems) -> Index | None:
        """Facets of the connected section that is nearest to the point of the bolt, or the only one."""
        nodes = self._facets[chosen]
        # facets of all kinds in one table, -1 where one has fewer nodes
        rows, columns = np.nonzero(nodes >= 0)
        n_node = self._body.mesh.n_node
        # connected where facets share nodes: facets and nodes are the two kinds of vertices of the graph
        links = sp.coo_array(
            (np.ones(len(rows)), (rows, len(chosen) + nodes[rows, columns])), shape=2 * (len(chosen) + n_node,)
        )
        # labels of the facets come first
        label = connected_components(links, directed=False)[1][: len(chosen)]
        where, point = f"bolt.{self._name}.point", self._bolt.point
        centres = np.stack([self._body.mesh.nodes[row[row >= 0]].mean(axis=0) for row in nodes])
        if point is None:
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
        # across the axis alone: the plane fixes the place along it
        distances = np.linalg.norm(_across(centres - np.asarray(point), self._axis), axis=1)
        nearest = int(np.argmin(distances))
        section: Index = chosen[label == label[nearest]]
        width = _width(centres[label == label[nearest]], self._axis)
        if distances[nearest] <= max(width, np.sqrt(self._area(section))):
            return section
        near = ", ".join(f"{x:.6g}" for x in centres[nearest])
        problems.add(
            where,
            f"the nearest section of {self._body.name} on the plane of the cut is {distances[nearest]:.4g} "
            f"{self._body.units['m']} away",
            shown(point),
            "a point on the shank, or within one width of the shank",
            f"the section has a point at [{near}]",
        )
        return None

    def _fits(self, facets: Index, fixed: np.ndarray, joined: Mapping[str, np.ndarray], problems: Problems) -> bool:
        """Whether the section is that of a shank: free of interfaces and held nodes, no wider than the body is long."""
        nodes = np.unique(self._facets[facets])
        nodes = nodes[nodes >= 0]
        where, width = f"bolt.{self._name}", _width(self._body.mesh.nodes[nodes], self._axis)
        # wider than long: the axis runs across a plate, or the body is no bolt
        if width > self._length:
            length = self._body.units["m"]
            problems.add(
                f"{where}.axis",
                f"no shank along the axis: the section of {self._body.name} is {width:.4g} {length} wide, the body "
                f"{self._length:.4g} {length} long along the axis",
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
        nodes = np.unique(self._facets[facets])
        nodes = nodes[nodes >= 0]
        on_cut = np.zeros(body.mesh.n_node, dtype=bool)
        on_cut[nodes] = True
        touches = np.concatenate([on_cut[block.cells].any(axis=1) for block in body.mesh.blocks])
        # the side that the jump moves: chi is 1 at the nodes of the cut, 0 elsewhere
        beyond = touches & (self._levels > level)
        jump = np.zeros((body.mesh.n_node, 3))
        jump[nodes] = axis
        matrix = stiffness(_part(body, beyond), body.shape.elasticity, body.shape.bending_modes)
        pattern = np.asarray(matrix @ jump.ravel())
        # forces that cancel, but for round-off
        pattern[np.abs(pattern) <= 1e-14 * np.abs(pattern).max()] = 0.0
        return BoltCut(
            self._name,
            self._bolt,
            axis,
            body.mesh.nodes[nodes].mean(axis=0),
            self._area(facets),
            nodes,
            beyond,
            self._moving(facets, beyond),
            pattern,
            float(jump.ravel() @ pattern),
            float(pattern @ (body.mesh.nodes @ body.shape.elasticity.expansion).ravel()),
            thread_area=self._bolt.thread_area(body.units),
        )

    def _area(self, facets: Index) -> float:
        """Area of facets across the axis, m2."""
        rows = self._facets[facets]
        width = (rows >= 0).sum(axis=1)
        section = FacetSet.of(*(rows[width == n][:, :n] for n in np.unique(width)))
        # facets of a stepped cut: their projections on the plane add up to the section
        return float(abs((face_of(self._body.mesh.nodes, section).vector_areas @ self._axis).sum()))

    def _moving(self, facets: Index, beyond: np.ndarray) -> np.ndarray:
        """(n_node,) nodes of the elements joined to those beyond the cut through facets that are not cut."""
        whole = np.ones(len(self._facets), dtype=bool)
        whole[facets] = False
        n = len(self._levels)
        pairs = (np.ones(int(whole.sum())), (self._below[whole], self._above[whole]))
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


def _part(body: Body, cells: np.ndarray) -> Elements:
    """Some of the elements of a body, (n_cell,)."""
    mesh, moduli = body.mesh, body.shape.moduli
    ends = np.cumsum([len(block.cells) for block in mesh.blocks])[:-1]
    parts = zip(mesh.blocks, np.split(cells, ends), strict=True)
    blocks = tuple(replace(block, cells=block.cells[members]) for block, members in parts if members.any())
    return Elements(Mesh(mesh.nodes, blocks, {}), None if moduli is None else moduli[cells])


def _across(vectors: Array, axis: Array) -> Array:
    """Parts (n, 3) of vectors across the axis."""
    return np.asarray(vectors - np.outer(vectors @ axis, axis))


def _width(places: Array, axis: Array) -> float:
    """Twice the largest distance of points from their middle, across the axis, m."""
    flat = _across(places, axis)
    middle = 0.5 * (flat.min(axis=0) + flat.max(axis=0))
    return float(2.0 * np.linalg.norm(flat - middle, axis=1).max())
