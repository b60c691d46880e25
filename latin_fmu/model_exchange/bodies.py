"""Bodies of a reduced model: bonded substructures as one body, patches and bonds of interfaces, Ritz coordinates."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np
import scipy.sparse as sp
from scipy.sparse.csgraph import connected_components

from ..assembly.merged_assembly import merge, placed
from ..assembly.problem import DiscretisedProblem
from ..errors import Problem, SceneError
from ..latin.assembly import Array, Index, InterfaceUnit
from ..latin.probes import SensorPlace
from ..propagator import SubstructureModel
from ..propagator.reduction import ReducedModel, reduce_model
from ..scene.fields import GROUND, split_face
from .system import Bond

_SAME = 1e-9  # of the extent: coordinates closer than this are equal, whatever the round-off


@dataclass(frozen=True)
class BondedBody:
    """One or more substructures that perfect interfaces hold together.

    Attributes
    ----------
    name : names of the substructures, joined by ``_``. model : matrices of all of it.
    members : the substructures. where : their full dofs among those of ``model``.
    """

    name: str
    model: SubstructureModel
    members: dict[str, SubstructureModel]
    where: dict[str, slice]


def is_bond(unit: InterfaceUnit) -> bool:
    """Whether an interface neither opens nor slides."""
    return unit.behaviour.name == "perfect"


def bonded_bodies(discretised: DiscretisedProblem) -> list[BondedBody]:
    """Bodies of a scene, in the order of its substructures."""
    models = {m.name: m for c in discretised.classes for m in c.members}
    names = [n for n in discretised.scene.substructure if n in models]
    place = {n: i for i, n in enumerate(names)}
    bonds = [u for u in discretised.units if is_bond(u)]
    ends = np.array([[place[split_face(s)[0]] for s in u.sides] for u in bonds if GROUND not in u.sides])
    ends = ends.reshape(-1, 2)
    graph = sp.coo_array((np.ones(len(ends)), (ends[:, 0], ends[:, 1])), shape=(len(names), len(names)))
    _, label = connected_components(graph, directed=False)
    bodies = []
    for number in dict.fromkeys(label):
        members = [models[n] for n, i in zip(names, label, strict=True) if i == number]
        held = {m.name for m in members}
        joined = [u for u in bonds if split_face(u.sides[0])[0] in held]
        bodies.append(_body(members, joined, discretised))
    return bodies


def _body(members: list[SubstructureModel], bonds: list[InterfaceUnit], discretised: DiscretisedProblem) -> BondedBody:
    by_name = {m.name: m for m in members}
    if not bonds:
        only = members[0]
        return BondedBody(only.name, only, by_name, {only.name: slice(0, only.n_full)})
    try:
        merged = merge(members, bonds, discretised.info)
    except ValueError as error:
        where = ", ".join(f"interface.{unit.name}" for unit in bonds)
        problem = Problem(
            where,
            f"perfect connections that no reduced model holds: {error}",
            remedy="mesh the two faces alike, or solve the scene itself",
        )
        raise SceneError([problem], "the scene has no reduced model") from error
    return BondedBody("_".join(by_name), merged.model, by_name, merged.where)


def patches(points: Array, areas: Array, n: int) -> list[Index]:
    """Points of each patch: the largest patch is halved across its longest direction until there are n.

    points : (n_point, 3), m. areas : (n_point,), m2. n : wanted number, >= 1; no more than points.
    """
    parts = [np.arange(len(points))]
    while len(parts) < n:
        order = sorted(range(len(parts)), key=lambda i: (-areas[parts[i]].sum(), i))
        largest = next((i for i in order if len(parts[i]) > 1), None)
        if largest is None:
            break
        parts[largest : largest + 1] = _halves(parts[largest], points, areas)
    return parts


def _halves(members: Index, points: Array, areas: Array) -> list[Index]:
    inside = points[members]
    extent = np.ptp(inside, axis=0)
    axis = int(np.argmax(extent > (1.0 - _SAME) * extent.max()))
    along = np.round(inside[:, axis] / max(float(extent.max()), np.finfo(float).tiny) / _SAME) * _SAME
    order = np.argsort(along, kind="stable")
    reached = np.cumsum(areas[members[order]])
    cut = int(np.searchsorted(reached, reached[-1] / 2 * (1.0 + _SAME)))
    cut = min(max(cut, 1), len(members) - 1)
    return [members[order[:cut]], members[order[cut:]]]


@dataclass(frozen=True)
class Cut:
    """An interface that may open, cut into patches. ``number`` counts the interfaces of the scene."""

    number: int
    unit: InterfaceUnit
    members: list[Index]

    @classmethod
    def of(cls, number: int, unit: InterfaceUnit, n_patch: int) -> Cut:
        """Cut an interface into patches."""
        return cls(number, unit, patches(unit.geometry.points, unit.geometry.areas, n_patch))

    @property
    def areas(self) -> Array:
        """Areas of the patches, (n_patch,), m2."""
        return np.array([self.unit.geometry.areas[m].sum() for m in self.members])

    def mean(self, values: Array) -> Array:
        """Means of values (n_point, ...) over the patches, weighted by area."""
        weights = self.unit.geometry.areas
        return np.stack([np.tensordot(weights[m] / weights[m].sum(), values[m], axes=1) for m in self.members])

    def trace(self, side: int) -> sp.csr_array | None:
        """(3 n_patch, n_full) mean motion of a side in local axes; None for the ground."""
        local = self.unit.geometry.local_trace(side, 3)
        if local is None:
            return None
        weights, n_point = self.unit.geometry.areas, self.unit.geometry.n_point
        rows = np.repeat(np.arange(len(self.members)), [len(m) for m in self.members])
        points = np.concatenate(self.members)
        share = weights[points] / self.areas[rows]
        mean = sp.csr_array((share, (rows, points)), shape=(len(self.members), n_point))
        return sp.csr_array(sp.kron(mean, sp.eye_array(3)) @ local)


def body_trace(body: BondedBody, cuts: Sequence[Cut]) -> tuple[sp.csr_array, Array]:
    """Mean motion of the patches of all interfaces on a body, E' counted positive and E negative.

    Returns
    -------
    (3 n_patch of all cuts, n_full), zero where the body has no part in it, and the areas (3 n_patch,) of its rows.
    """
    blocks, areas = [], []
    for cut in cuts:
        block = sp.csr_array((3 * len(cut.members), body.model.n_full))
        for side, face in enumerate(cut.unit.sides):
            trace = None if face == GROUND else cut.trace(side)
            if trace is not None and (name := split_face(face)[0]) in body.where:
                sign = 1.0 if side else -1.0
                block = sp.csr_array(block + sign * placed(trace, body.where[name].start, body.model.n_full))
        blocks.append(block)
        areas.append(np.repeat(cut.areas, 3))
    if not blocks:
        return sp.csr_array((0, body.model.n_full)), np.zeros(0)
    return sp.csr_array(sp.vstack(blocks)), np.concatenate(areas)


def face_means(body: BondedBody, units: Sequence[InterfaceUnit]) -> Array:
    """(n_interface, 2, 3, n_full) mean motion of both sides of every interface in global axes, weighted by area."""
    means = np.zeros((len(units), 2, 3, body.model.n_full))
    for i, unit in enumerate(units):
        share = sp.csr_array(unit.geometry.areas[None, :] / unit.geometry.areas.sum())
        for side, face in enumerate(unit.sides):
            trace = unit.geometry.traces[side]
            if trace is not None and (name := split_face(face)[0]) in body.where:
                mean = sp.csr_array(sp.kron(share, sp.eye_array(3)) @ trace)
                means[i, side] = placed(mean, body.where[name].start, body.model.n_full).toarray()
    return means


Part = tuple[BondedBody, Array, sp.csr_array]
"""A body, its basis (n_full, size), its traces of patches (3 n_patch, n_full)."""


def bond_of(interface: int, unit: InterfaceUnit, parts: Sequence[Part], load_names: Sequence[str]) -> Bond:
    """Force through a perfect interface inside a body: equilibrium of side E under translations of its nodes.

    parts : all bodies, in the order of their coordinates.
    """
    name = split_face(unit.sides[0])[0]
    sizes = [basis.shape[1] for _, basis, _ in parts]
    number = next(i for i, (body, _, _) in enumerate(parts) if name in body.where)
    body, basis, trace = parts[number]
    model = body.members[name]
    test = _translations(unit, model.expansion)
    here = basis[body.where[name]]

    def rows(matrix: sp.csr_array | None) -> Array:
        wide = np.zeros((3, sum(sizes)))
        if matrix is not None:
            start = sum(sizes[:number])
            wide[:, start : start + sizes[number]] = (test @ matrix) @ here
        return wide

    loads = np.zeros((3, len(load_names)))
    for load in model.loads:
        loads[:, load_names.index(load.name)] += test @ load.pattern
    pushed = (trace[:, body.where[name]] @ test.T).reshape(-1, 3, 3)  # patch, component, direction
    normal = unit.geometry.areas @ unit.geometry.frames[:, 0]
    return Bond(
        interface=interface,
        inertia=rows(model.mass),
        damping=rows(model.damping),
        stiffness=rows(model.stiffness),
        loads=loads,
        pressure=pushed[:, 0].T,
        shear=pushed[:, 1:].transpose(1, 2, 0),
        normal=normal / np.linalg.norm(normal),
    )


def _translations(unit: InterfaceUnit, expansion: sp.csr_array) -> Array:
    """(3, n_full of side E): one along each axis at the nodes of the interface, 0 where a direction is held."""
    trace = unit.geometry.traces[0]
    test = np.zeros((3, trace.shape[1]))
    test[trace.indices % 3, trace.indices] = 1.0
    free = np.diff(expansion.indptr) > 0
    return test * free


@dataclass(frozen=True)
class ReducedBody:
    """A body in its Ritz coordinates.

    Attributes
    ----------
    trace : (3 n_patch of all interfaces, n_full) motion of the patches, E' positive, E negative. mass : kg.
    """

    body: BondedBody
    model: ReducedModel
    trace: sp.csr_array
    mass: float

    @classmethod
    def of(cls, body: BondedBody, cuts: Sequence[Cut], n_mode: int) -> ReducedBody:
        """Reduce a body to its Ritz coordinates."""
        trace, area = body_trace(body, cuts)
        needed = np.flatnonzero(_transmits(cuts) & (np.diff(trace.indptr) > 0))
        here = replace(body.model, trace=sp.csr_array(trace[needed]), channel_area=area[needed])
        reduced = reduce_model(here, n_mode, exciting=_uniform(cuts)[needed])
        return cls(body, reduced, trace, float(body.model.inertia.sum()) / 3.0)

    @property
    def size(self) -> int:
        """Number of Ritz coordinates."""
        return len(self.model.eigenvalues)

    @property
    def basis(self) -> Array:
        """Ritz vectors (n_full, size), scaled to the size of a displacement."""
        scaled: Array = self.model.basis * np.sqrt(self.mass)
        return scaled

    def rows(self, place: SensorPlace) -> Array:
        """(3, size) displacement of a sensor from the coordinates, 0 where it is on another body."""
        if place.substructure not in self.body.where:
            return np.zeros((3, self.size))
        here = self.basis[self.body.where[place.substructure]]
        return np.asarray(place.matrix(len(here) // 3) @ here)


def _transmits(cuts: Sequence[Cut]) -> np.ndarray[tuple[int], np.dtype[np.bool_]]:
    """Rows of a trace of patches that carry traction: no tangential ones where there is no friction."""
    rows = [np.tile(np.arange(3) < c.unit.behaviour.n_component, len(c.members)) for c in cuts]
    return np.concatenate([np.zeros(0, dtype=bool), *rows])


def _uniform(cuts: Sequence[Cut]) -> Array:
    """Uniform tractions on every interface, one a column, (3 n_patch of all, 3 n_cut)."""
    blocks = [np.tile(np.eye(3), (len(c.members), 1)) for c in cuts]
    columns: Array = sp.block_diag([*blocks, np.zeros((0, 0))]).toarray()
    return columns


def loads_of(bodies: Sequence[ReducedBody], root: Array) -> tuple[list[str], Array]:
    """Names of the load terms, each once, and their forces on the coordinates (n, n_load)."""
    names = list(dict.fromkeys(load.name for b in bodies for load in b.body.model.loads))
    table = np.zeros((len(root), len(names)))
    start = 0
    for b in bodies:
        for load, column in zip(b.body.model.loads, b.model.loads.T, strict=True):
            table[start : start + b.size, names.index(load.name)] += column
        start += b.size
    return names, table * root[:, None]


def damping_of(bodies: Sequence[ReducedBody]) -> Array | None:
    """(n, n) damping of all bodies, N s m-1; None where there is none."""
    if all(b.model.damping is None for b in bodies):
        return None
    parts = [np.zeros((b.size, b.size)) if b.model.damping is None else b.mass * b.model.damping for b in bodies]
    blocks: Array = sp.block_diag(parts).toarray()
    return blocks
