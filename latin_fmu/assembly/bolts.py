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
"""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from dataclasses import dataclass

import numpy as np
import scipy.sparse as sp

from ..errors import Problems
from ..fem.elements import Elements
from ..fem.mesh import Array, CellBlock, Index, Mesh
from ..fem.stress import MeanStress, Recovery
from ..propagator import LoadTerm
from ..scene.substructures import Bolt, MaterialTable
from ..scene.units import UnitSystem
from .body import Body, Shape

_CONE = 3.0  # radii of a shank around its axis within which points are clamped by it


@dataclass(frozen=True)
class BoltCut:
    """Cut of a shank (module docstring).

    Attributes
    ----------
    name, table : of the bolt in the scene. axis : (3,) unit vector a. point : (3,) centre of the cut, m.
    area : of the cut across the axis, m2. nodes : of the cut. beyond : (n_cell,) elements beyond the plane that touch
        it. moving : (n_node,) nodes joined to those elements when the cut is open.
    pattern : (n_full,) g, N m-1. stiffness : k, N m-1.
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

    @property
    def load(self) -> str:
        """Name of its load term."""
        return load_name(self.name)

    def loads(self, free: bool) -> LoadTerm:
        """Load term of the bolt: amplitude delta; ``free`` : amplitude F."""
        return LoadTerm(self.load, self.pattern / self.stiffness if free else self.pattern)

    def stress(self, body: Body) -> float:
        """Mean stress of the shank when tightened, Pa; with a given shortening, of a shank as long as its body and held
        at both ends."""
        if self.table.shortening is not None:
            return (
                body.shape.material.young_modulus * self.table.shortening / float(np.ptp(body.mesh.nodes @ self.axis))
            )
        return (self.table.force or 0.0) / self.area

    def line(self, shortening: float, units: UnitSystem) -> str:
        """Section and place of the cut, target and shortening, for the command ``check``."""
        at = ", ".join(f"{round(float(x), 9) + 0.0:.6g}" for x in self.point)
        force = self.table.force
        target = ""
        if force is not None:
            target = f"{force:.6g} {units['N']}, mean stress {force / self.area:.4g} {units['Pa']}, "
        section = f"{self.area:.6g} {units['m2']} of {self.table.substructure}"
        return (
            f"  bolt {self.name}: section {section} at [{at}], {target}"
            f"shortened by {shortening:.4g} {units['m']}, order {self.table.order}"
        )

    def clamp(self, nodes: Array, shortening: float) -> Clamp:
        """Where the bolt clamps; ``nodes`` (n, 3) of its body, m."""
        along = nodes @ self.axis
        ends = float(along.min()), float(along.max())
        return Clamp(self.name, self.axis, self.point, float(np.sqrt(self.area / np.pi)), ends, shortening)

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
    """Where a bolt clamps: within ``_CONE`` times the radius of its section around the axis, along its body and as
    far beyond.

    Attributes
    ----------
    bolt : its name. axis : (3,) unit vector. point : (3,) on it, m. radius : of the section, m.
    ends : first and last coordinate of its body along the axis, m. shortening : m.
    """

    bolt: str
    axis: Array
    point: Array
    radius: float
    ends: tuple[float, float]
    shortening: float

    def holds(self, points: Array) -> np.ndarray:
        """Whether the bolt clamps points (n, 3), (n,)."""
        arm = points - self.point
        arm = arm - np.outer(arm @ self.axis, self.axis)
        along = points @ self.axis
        reach = _CONE * self.radius
        near: np.ndarray = np.linalg.norm(arm, axis=1) <= reach
        return near & (along >= self.ends[0] - reach) & (along <= self.ends[1] + reach)


def load_name(bolt: str) -> str:
    """Name of the load term of a bolt; no load of a scene has a dot in its name."""
    return f"bolt.{bolt}"


def check_yield(name: str, force: float | None, cut: BoltCut, body: Body, problems: Problems) -> None:
    """Refuse a tension whose mean stress is above the yield stress of the material."""
    limit, units = body.shape.material.yield_stress, body.units
    if force is None or limit is None or force <= limit * cut.area:
        return
    problems.add(
        f"bolt.{name}",
        f"the mean stress of the shank, {force:.6g} {units['N']} / {cut.area:.6g} {units['m2']}, is above the yield "
        "stress of the material",
        f"{force / cut.area:.4g} {units['Pa']}",
        f"at most {limit:.4g} {units['Pa']}, a force of {limit * cut.area:.4g} {units['N']}",
        "tighten the bolt less, or choose a larger section or another material",
    )


# -- stresses of a body with bolts ------------------------------------------------------------------------------------
class OpenedMesh:
    """Mesh of a body with its cuts opened: the elements beyond have nodes of their own on the cut.

    Parameters
    ----------
    mesh : of the body. cuts : of its bolts. shortening : of every bolt, m.
    """

    def __init__(self, mesh: Mesh, cuts: Iterable[BoltCut], shortening: Mapping[str, float]) -> None:
        blocks, added, shifts, n = [block.cells.copy() for block in mesh.blocks], [], [], mesh.n_node
        for cut in cuts:
            own = np.arange(mesh.n_node)
            own[cut.nodes] = n + np.arange(len(cut.nodes))
            first = 0
            for cells in blocks:
                rows = np.flatnonzero(cut.beyond[first : first + len(cells)])
                kept = cells[rows]
                cells[rows] = np.where(kept < mesh.n_node, own[np.minimum(kept, mesh.n_node - 1)], kept)
                first += len(cells)
            n += len(cut.nodes)
            added.append(cut.nodes)
            shifts.append(np.tile(-shortening.get(cut.name, 0.0) * cut.axis, (len(cut.nodes), 1)))
        self._twins, self._shift = np.concatenate(added), np.concatenate(shifts)
        nodes = np.concatenate([mesh.nodes, mesh.nodes[self._twins]])
        types = mesh.cell_types
        self.mesh = Mesh(nodes, tuple(CellBlock(t, c) for t, c in zip(types, blocks, strict=True)), {})

    def recovery(self, shape: Shape) -> Recovery:
        """Strains of the elements and stresses at the nodes."""
        m = shape.material
        return _OpenedRecovery(Elements(self.mesh), m.young_modulus, m.poisson_ratio, shape.bending_modes, self)

    def closed(self, values: Array) -> Array:
        """Values at the nodes (..., n_node, k), on the cuts means of both sides, from those of the opened mesh."""
        own = values[..., : values.shape[-2] - len(self._twins), :].copy()
        own[..., self._twins, :] = 0.5 * (own[..., self._twins, :] + values[..., own.shape[-2] :, :])
        return own

    def displacement(self, displacement: Array) -> Array:
        """Displacements (..., n_node and nodes beyond the cuts, 3), m, from those of the nodes (..., n_node, 3)."""
        twins = displacement[..., self._twins, :] + self._shift
        return np.concatenate([displacement, twins], axis=-2)


class OpenedStress:
    """Mean stress of the elements of a body with bolts (as ``MeanStress``)."""

    def __init__(self, opened: OpenedMesh, material: MaterialTable) -> None:
        self._opened = opened
        self._mean = MeanStress(Elements(opened.mesh), material.young_modulus, material.poisson_ratio)

    def __call__(self, displacement: Array) -> Array:
        """Mean stress (n_cell, 6), Pa, of displacements (n_node, 3), m."""
        return self._mean(self._opened.displacement(displacement))


class _OpenedRecovery(Recovery):
    """``Recovery`` of a body with bolts, from the displacements of its nodes."""

    def __init__(
        self, elements: Elements, young_modulus: float, poisson_ratio: float, bending_modes: bool, opened: OpenedMesh
    ) -> None:
        super().__init__(elements, young_modulus, poisson_ratio, bending_modes)
        self._opened = opened

    def strain(self, displacement: Array) -> Array:
        """Mean strain (n_time, n_cell, 6) of displacements (n_time, n_node, 3), m."""
        return super().strain(self._opened.displacement(displacement))

    def nodal_stress(self, displacement: Array) -> Array:
        """Stress at the nodes (n_time, n_node, 6), Pa, of displacements (n_time, n_node, 3), m."""
        return self._opened.closed(super().nodal_stress(self._opened.displacement(displacement)))
