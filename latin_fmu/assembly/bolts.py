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

The stresses on any section of the shank have a resultant, three forces along the axis and across it and three moments
about them through the centre of the section. With the stiffness K' of the elements on one side of the section and the
six motions P of a rigid plane at its nodes, a x (x - c) for a moment along a,

    r = sum delta G chi a - G u,      G = P^T K',

of the elements beyond the section; those before it have the opposite forces. It is in equilibrium with all that acts on
that side to the last digit. The first row at the cut is g.

A change of temperature T strains a free body by alpha T, so that u is u - alpha x T in F. A shank that yields has a
plastic elongation q, and the shortening delta - q (``yielding_bolts``). Where the cut is: ``bolt_cuts``.
"""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Mapping
from dataclasses import dataclass, replace
from functools import cached_property
from typing import Final

import numpy as np
import scipy.sparse as sp

from ..errors import Problems
from ..fem.elasticity import Elasticity
from ..fem.elements import Elements, MeanStress, Recovery
from ..fem.mesh import Array, Index, Mesh
from ..fem.reference_cells import Rule
from ..interface.geometry import local_frames
from ..latin.bolt_sections import ClampedFace, ScrewData, ShankSections
from ..propagator import LoadTerm
from ..scene.bolts import LARGEST_STRESS, NUT_FACTOR, Bolt
from ..scene.units import UnitSystem
from .body import Body, Shape
from .bolt_shares import fraction

FITTING: Final = 0.75, 1.2
"""Diameter of the meshed shank over the nominal one, from core to nominal, with some play for sections not round."""
WAISTED: Final = 0.5
"""The same of a shank whose thread has no size, from."""
SECTION: Final = 0.85, 1.4
"""Meshed section over the stress area of the thread, of the modelled part, from and up to which the two agree."""
_CANCELLED: Final = 1e-14  # of the largest of a row: round-off
_CONE = 3.0  # radii of a shank around its axis within which points are clamped by it


N_RESULTANT: Final = 6
"""Rows of a section: axial and two shear forces, torsion and two bending moments."""


@dataclass(frozen=True)
class ShankSection:
    """A section of a shank, with the resultant of the stresses on it (module docstring).

    Attributes
    ----------
    nodes : of the section. side : (n_cell,) elements that K' is of, on the side of the cut. sense : 1 where they come
        before the section along the axis, -1 where they lie beyond it. centre : (3,) m. area : across the axis, m2.
    pattern : (6, n_full) G, N m-1 and N. jumps : (6,) resultants per shortening of each bolt of the body, by name.
    heated : (6,) resultants per change of temperature where u = 0.
    """

    nodes: Index
    side: np.ndarray
    sense: float
    centre: Array
    area: float
    pattern: sp.csr_array
    jumps: Mapping[str, Array]
    heated: Array

    @classmethod
    def of(cls, facets: tuple[Index, np.ndarray, float, Array, float]) -> ShankSection:
        """A section without rows: nodes, side, sense, centre and area."""
        return cls(*facets, sp.csr_array((N_RESULTANT, 0)), {}, np.zeros(N_RESULTANT))

    def rows(
        self, opened: OpenedMesh, matrix: sp.csr_array, directions: Array
    ) -> tuple[sp.csr_array, dict[str, Array]]:
        """G and the jumps of a stiffness (3 n_opened, 3 n_opened) of the elements at the side."""
        places, owners = opened.mesh.nodes, opened.owners
        here = np.isin(owners, self.nodes)
        motion = np.zeros((len(places), 3, N_RESULTANT))
        motion[here, :, :3] = directions.T
        motion[here, :, 3:] = np.cross(directions, (places[here] - self.centre)[:, None]).transpose(0, 2, 1)
        pulled = -self.sense * np.asarray(matrix @ motion.reshape(-1, N_RESULTANT))
        pattern = np.asarray(opened.together.T @ pulled).T
        # forces that cancel, but for round-off
        pattern[np.abs(pattern) <= _CANCELLED * np.abs(pattern).max(axis=1, keepdims=True)] = 0.0
        return sp.csr_array(pattern), {name: jump.ravel() @ pulled for name, jump in opened.jumps()}

    def stressed(self, pattern: sp.csr_array, jumps: Mapping[str, Array]) -> ShankSection:
        """The section of a shank whose stress adds this to its rows."""
        summed = {name: own + jumps[name] for name, own in self.jumps.items()}
        return replace(self, pattern=sp.csr_array(self.pattern + pattern), jumps=summed)


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
    sections : of the shank, each once, that of the cut first. named : their names and places. clamped : interfaces of
        the parts around the shank. screw : what margins take; None where the thread has no size.
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
    sections: tuple[ShankSection, ...] = ()
    named: ShankSections | None = None
    clamped: tuple[ClampedFace, ...] = ()
    screw: ScrewData | None = None

    @property
    def tension(self) -> float | None:
        """Force that the modelled part is tightened to, N; None where the shortening is given."""
        return self.table.tension(self.share)

    @property
    def directions(self) -> Array:
        """(3, 3) unit vectors: the axis, and two across it that follow the global axes where it does."""
        return np.asarray(local_frames(self.axis[None])[0])

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

    def stressed(self, by: CutStress) -> BoltCut:
        """The cut of a shank with its stress."""
        sections = tuple(s.stressed(*rows) for s, rows in zip(self.sections, by.sections, strict=True))
        pattern, stiffness = self.pattern + by.pattern, self.stiffness + by.stiffness
        return replace(self, pattern=pattern, stiffness=stiffness, sections=sections)

    @cached_property
    def rows(self) -> sp.csr_array:
        """G of all sections one below the other, (6 n_section, n_full); the first row is g."""
        first, *others = (section.pattern for section in self.sections)
        return sp.csr_array(sp.vstack([sp.csr_array(self.pattern[None]), first[1:], *others]))

    def terms(self, changes: Mapping[str, float]) -> dict[str, Array]:
        """Resultants (6 n_section,) where u = 0 by load terms of amplitude 1: of bolts, per shortening, and of
        ``changes`` of temperature, K, by load term."""
        names = {name: None for section in self.sections for name in section.jumps}
        terms = {load_name(name): np.concatenate([s.jumps[name] for s in self.sections]) for name in names}
        terms[self.load][0] = self.stiffness
        heated = np.concatenate([section.heated for section in self.sections])
        heated[0] = self.heated
        return terms | {load: change * heated for load, change in changes.items()}

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
        turned = f" of {table.torque:.6g} {units['N m']}"
        if table.thread_friction is None:
            return f"{turned}, nut factor {table.nut_factor or NUT_FACTOR:g}"
        head = table.head_friction or table.thread_friction
        return f"{turned}, friction {table.thread_friction:g} of the thread and {head:g} under the head"

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
class CutStress:
    """What the stress of a body adds to the cut of a bolt: (n_full,) to g, a number to k, N m-1, and to the rows and
    jumps of each section."""

    pattern: Array
    stiffness: float
    sections: tuple[tuple[sp.csr_array, Mapping[str, Array]], ...]


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
        self.cuts = tuple(cuts)
        blocks = [block.cells.copy() for block in mesh.blocks]
        added = []
        shifts = []
        n = mesh.n_node
        self._jumps: dict[str, tuple[slice, Array]] = {}
        for cut in self.cuts:
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

    @cached_property
    def owners(self) -> Index:
        """(n_node and nodes beyond the cuts,) node that each stands for."""
        return np.concatenate([np.arange(len(self.mesh.nodes) - len(self._twins)), self._twins])

    @cached_property
    def together(self) -> sp.csr_array:
        """(3 of all nodes and those beyond the cuts, 3 n_node) from vectors at the nodes to those of the opened mesh,
        no jump."""
        n, m = len(self.owners) - len(self._twins), len(self.owners)
        merging = sp.csr_array((np.ones(m), (np.arange(m), self.owners)), shape=(m, n))
        return sp.csr_array(sp.kron(merging, sp.eye_array(3)))

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
        return np.asarray(self._opened.together.T @ forces.ravel()).reshape(-1, 3)
