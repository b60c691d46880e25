"""The assembly as one body without inertia: the linear stage of statics over all bodies together.

Bodies that are bonded by perfect interfaces move together: their dofs x = Q q + D d follow from those that are left, q,
and from driven faces d (``tied_assembly``). The others meet at points with the relative motions r = T_E u_E - T_E' u_E'
of their sides. With the springs k of the search direction between the sides of every point, one linear stage is

    (K + T^T a k/dt T) (q_{n+1} - q_n) = f_{n+1} - K q_n + T^T a p,      T r-rows of q, a areas, p incoming tractions

a single factor of the whole assembly: bonds are not iterated, a load reaches every body within one iteration, and no
coarse problem is needed. It is that of one substructure whose points meet the ground (``propagator.static``), with the
traction on side E and the motion of E over E'. Laws act point by point as they do between bodies.

Up to ``MOST_CHANNELS`` channels the relative motions are dofs themselves, x = Q q + R r + D d, eliminated last: what is
left is a dense matrix of r alone, which many static problems of one set-up share, and with which an iteration takes a
sixth of the time of a substitution. Beyond, and where contacts hold nodes twice, r follows from the dofs of the bodies.

The springs are the stiffness of a point of its size, E sqrt(a) per point of area a, of both sides in series; those of
elastic layers are the layers themselves, which one iteration solves then.
"""

from __future__ import annotations

import hashlib
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, replace
from typing import Any, Final

import numpy as np
import scipy.sparse as sp

from ..assembly.body import Body, body_sides, consecutive
from ..assembly.models import Kept, ModelClass
from ..fem.dissection import dissected
from ..interface.laws import bonds
from ..latin.assembly import Array, Index, InterfaceUnit, Layout
from ..propagator import LoadTerm, SubstructureModel
from ..propagator.model import closest_reduced
from .hierarchical_dofs import HierarchicalDofs
from .tied_assembly import Joints, TieError, channel_trace, eliminated, joint_rows, jump_rows

NAME: Final = "assembly"
"""Name of the one substructure."""
MOST_CHANNELS: Final = 4000
"""Of the relative motions that are dofs: a dense matrix of 128 MB, which takes two seconds."""
_STIFFEST: Final = 30.0
"""Times the stiffness of a point up to which the springs are those of a layer: beyond, layers are as rigid as bonds."""


@dataclass(frozen=True)
class StaticShapes:
    """Motions of an assembly without inertia, whose loads and laws may differ.

    Attributes
    ----------
    expansion : (n_full, n) of all bodies by the dofs. driven : (n_full, n_motion) shapes of driven faces. stiffness :
    (n, n), N m-1. jump : (n_channel, n_full) relative motions. free : numbers of the first dofs among the reduced dofs
    of all bodies, made ``hierarchical``. there : channels whose relative motions are the other dofs; None where these
    follow from the first. ordering : interface dofs, their trace, elimination order and parts of the dissection, once
    they were found.
    """

    expansion: sp.csr_array
    driven: Array
    stiffness: sp.csr_array
    jump: sp.csr_array
    free: Index
    there: Index | None
    hierarchical: HierarchicalDofs
    ordering: dict[str, Any] = field(default_factory=dict)

    @staticmethod
    def of(
        classes: Sequence[ModelClass], units: Sequence[InterfaceUnit], layout: Layout, trace: sp.csr_array
    ) -> StaticShapes:
        """Of an assembly with the ``trace`` (n_flat, n_full) to its channels.

        Raises
        ------
        TieError : bonds between faces that are driven apart.
        """
        bonded, relative = _bonded_and_relative(units)
        models = [m for c in classes for m in c.members]
        where, _ = consecutive({m.name: m.n_full for m in models})
        expansion = sp.csr_array(sp.block_diag([m.expansion for m in models], format="csr"))
        hierarchical = HierarchicalDofs.of(units, where, expansion)
        jumps = [sp.csr_array((0, trace.shape[1])), *(jump_rows(layout, trace, i) for i in relative)]
        jump = sp.csr_array(sp.vstack(jumps))
        if relative and few_contacts(units):
            try:
                rows = joint_rows(units, layout, trace, Joints(bonded, (), relative))
                return _shapes(classes, (expansion, hierarchical), rows[:2], jump, True)
            except TieError:
                # contacts that hold nodes twice have no relative motions of their own
                pass
        rows = joint_rows(units, layout, trace, Joints(bonded, (), ()))
        return _shapes(classes, (expansion, hierarchical), rows[:2], jump, False)

    def model(self, models: Sequence[SubstructureModel], areas: Array, bodies: Mapping[str, Body]) -> SubstructureModel:
        """The assembly as one substructure; ``areas`` (n_channel,) of the channels, m2."""
        where, n_full = consecutive({m.name: m.n_full for m in models})
        model = SubstructureModel(
            name=NAME,
            mass=None,
            damping=None,
            stiffness=sp.csr_array(sp.block_diag([m.stiffness for m in models], format="csr")),
            expansion=self.expansion,
            trace=self.jump,
            channel_area=areas,
            loads=joined_loads(models, where, n_full),
            # set by ``static_run``, which knows which dofs are left
            displacement=np.zeros(n_full),
            velocity=np.zeros(n_full),
            imposed_pattern=self.driven,
            imposed_start=np.concatenate([np.zeros(0), *(m.imposed_start for m in models)]),
            swept=self.there is None and bool(self.jump.shape[0]),
            store=models[0].store,
        )
        model.__dict__["reduced_stiffness"] = self.stiffness
        if self.there is not None:
            n, size = self.expansion.shape[1], len(self.there)
            last = np.arange(n - size, n)
            rows = sp.coo_array((np.ones(size), (self.there, last)), shape=(self.jump.shape[0], n))
            model.__dict__["reduced_trace"] = sp.csr_array(rows)
        if not self.ordering:
            ordered(model, models, bodies)
            self.ordering.update({name: model.__dict__.get(name) for name in ("at_interface", "reduced_parts")})
        model.__dict__.update(self.ordering)
        return model


def _shapes(
    classes: Sequence[ModelClass],
    dofs: tuple[sp.csr_array, HierarchicalDofs],
    joints: tuple[sp.csr_array, sp.csr_array],
    jump: sp.csr_array,
    related: bool,
) -> StaticShapes:
    """Motions of the bodies by the dofs that are left with ``joints``, rows and their weights; ``dofs`` : the expansion
    of the reduced dofs and what makes them hierarchical; ``related`` : whether relative motions are dofs."""
    models = [m for c in classes for m in c.members]
    expansion, hierarchical = dofs[1].expanded(dofs[0]), dofs[1]
    driven: Array = sp.block_diag([sp.coo_array(m.imposed_pattern) for m in models]).toarray()
    # members of a class have equal matrices, which are reduced once
    stiffness = sp.block_diag([c.members[0].reduced_stiffness for c in classes for _ in c.members], format="csr")
    stiffness = hierarchical.congruent(sp.csr_array(stiffness))
    free, there = np.arange(expansion.shape[1], dtype=np.int64), None
    rows, weights = joints
    if rows.shape[0]:
        found = eliminated(sp.csr_array(rows @ expansion), np.asarray(rows @ driven), weights)
        parts, free = [found.q_part], found.free
        if related:
            there = np.flatnonzero(found.exists)
            parts.append(sp.csr_array(found.r_part[:, there]))
        both = sp.csr_array(sp.hstack(parts))
        driven = driven + expansion @ found.driven
        expansion, stiffness = sp.csr_array(expansion @ both), sp.csr_array(both.T @ stiffness @ both)
    stiffness = sp.csr_array(stiffness)
    stiffness.sort_indices()
    return StaticShapes(expansion, driven, stiffness, jump, free, there, hierarchical)


def few_contacts(units: Sequence[InterfaceUnit]) -> bool:
    """Whether the relative motions of contacts and layers are so few that they are dofs."""
    _, relative = _bonded_and_relative(units)
    return sum(units[i].geometry.n_point * units[i].behaviour.n_component for i in relative) <= MOST_CHANNELS


def _bonded_and_relative(units: Sequence[InterfaceUnit]) -> tuple[tuple[int, ...], tuple[int, ...]]:
    """Numbers of the interfaces that are eliminated, and of those with relative motions."""
    bonded = tuple(i for i, unit in enumerate(units) if bonds(unit.behaviour))
    return bonded, tuple(i for i in range(len(units)) if i not in bonded)


@dataclass(frozen=True)
class StaticAssembly:
    """The assembly as one substructure (module docstring).

    Attributes
    ----------
    models : of the bodies. where : slices of their full dofs among those of all. model : the one substructure, with the
    full dofs of all bodies. shapes : what its dofs are. trace : (n_flat, n_full) from the full dofs to the channels of
    all interfaces. bonded, relative : numbers of the interfaces that are eliminated, and of those with relative
    motions. units : the latter, against ground. springs : (n_channel,) of the search direction, Pa m-1. key : of what
    the operators depend on.
    """

    models: list[SubstructureModel]
    where: Mapping[str, slice]
    model: SubstructureModel
    shapes: StaticShapes
    trace: sp.csr_array
    bonded: tuple[int, ...]
    relative: tuple[int, ...]
    units: list[InterfaceUnit]
    layout: Layout
    springs: Array
    key: bytes

    @staticmethod
    def of(
        classes: Sequence[ModelClass],
        units: Sequence[InterfaceUnit],
        layout: Layout,
        bodies: Mapping[str, Body],
        operators: Kept | None = None,
    ) -> StaticAssembly:
        """The assembly of classes of bodies and interfaces. operators : by ``key``, of equal assemblies, whose shapes
        are used again and added to.

        Raises
        ------
        TieError : bonds between faces that are driven apart.
        """
        models = [m for c in classes for m in c.members]
        where, n_full = consecutive({m.name: m.n_full for m in models})
        trace = channel_trace(classes, layout, where, n_full)
        bonded, relative = _bonded_and_relative(units)
        channels = np.concatenate([np.zeros(0, dtype=np.int64), *(layout.channels(i, 0).ravel() for i in relative)])
        springs = point_springs(units, layout, bodies)[channels]
        key = _key(models, units, trace, springs)
        kept = [] if operators is None else operators.setdefault(b"shapes " + key, [])
        if not kept:
            kept.append((0.0, StaticShapes.of(classes, units, layout, trace)))
        shapes: StaticShapes = kept[0][1]
        model = shapes.model(models, layout.area[channels], bodies)
        against = [against_ground(units[i]) for i in relative]
        return StaticAssembly(
            models, where, model, shapes, trace, bonded, relative, against, Layout(against), springs, key
        )

    def reduced(self, full: Array) -> Array:
        """Dofs (n,) of displacements (n_full,) of all bodies, those of driven faces taken away."""
        parts = [closest_reduced(m.expansion, full[self.where[m.name], None]) for m in self.models]
        first: Array = self.shapes.hierarchical.of_reduced(np.concatenate(parts))[self.shapes.free]
        if self.shapes.there is None:
            return first
        return np.concatenate([first, (self.shapes.jump @ full)[self.shapes.there, None]])

    @property
    def joints(self) -> Joints:
        """The interfaces by what they are here: layers are among those with relative motions."""
        return Joints(self.bonded, (), self.relative)

    @property
    def channels(self) -> Index:
        """Channels (n_channel,) of the relative motions in the layout of ``units``."""
        parts = [self.layout.channels(j, 0).ravel() for j in range(len(self.relative))]
        return np.concatenate([np.zeros(0, dtype=np.int64), *parts])


def against_ground(unit: InterfaceUnit) -> InterfaceUnit:
    """The interface with the motion of side E relative to E' in the place of that of E, and ground for E'."""
    n = 3 * unit.geometry.n_point
    geometry = replace(unit.geometry, traces=(sp.csr_array(sp.eye_array(n)), None), owner=0)
    return replace(unit, sides=(unit.sides[0], "ground"), geometry=geometry)


def joined_loads(models: Sequence[SubstructureModel], where: Mapping[str, slice], n_full: int) -> list[LoadTerm]:
    """Loads of all bodies, those of one law together."""
    patterns: dict[str, Array] = {}
    for model in models:
        for load in model.loads:
            patterns.setdefault(load.name, np.zeros(n_full))[where[model.name]] += load.pattern
    return [LoadTerm(name, pattern) for name, pattern in patterns.items()]


def ordered(model: SubstructureModel, models: Sequence[SubstructureModel], bodies: Mapping[str, Body]) -> None:
    """Give a model its interface dofs and the elimination order of its dofs, by nested dissection of their places."""
    trace = sp.csc_array(model.reduced_trace)
    dofs = np.flatnonzero(np.diff(trace.indptr)).astype(np.int64)
    if not model.expansion.shape[1]:  # all bodies are held
        model.__dict__["at_interface"] = dofs, sp.csr_array(trace), None
        return
    positions = [_positions(m, bodies[m.name]) for m in models]
    # a dof has the place of the first full dof that it moves
    columns = sp.csc_array(model.expansion)
    places = np.concatenate(positions)[columns.indices[columns.indptr[:-1]]]
    rounded = np.round(places / max(float(np.ptp(places, axis=0).max(initial=0.0)), 1e-300), 9)
    # dofs of one place are one node of the graph
    _, first, node = np.unique(rounded, axis=0, return_index=True, return_inverse=True)
    node = node.ravel()
    touching = sp.csr_array((np.ones(trace.nnz), trace.indices, trace.indptr), shape=trace.shape[::-1])
    by_points = sp.csr_array(touching @ touching.T)
    n, matrices = len(first), (model.reduced_stiffness, by_points)
    pairs = [(np.repeat(node, np.diff(matrix.indptr)), node[matrix.indices]) for matrix in matrices]
    rows, others = (np.concatenate([a, b, np.arange(n)]) for a, b in zip(*pairs, strict=True))
    graph = sp.csr_array(sp.coo_array((np.ones(len(rows), dtype=np.int8), (rows, others)), shape=(n, n)))
    rank, parts = dissected(places[first], graph)
    model.__dict__["at_interface"] = dofs, sp.csr_array(trace[:, dofs]), rank[node]
    model.__dict__["reduced_parts"] = parts[node]


def _positions(model: SubstructureModel, body: Body) -> Array:
    """Places (n_full, 3) of the full dofs of a body, m: of a rigid one its middle."""
    if model.positions is None:
        return np.tile(body.mesh.nodes.mean(axis=0), (model.n_full, 1))
    return np.repeat(model.positions, 3, axis=0)


def point_springs(units: Sequence[InterfaceUnit], layout: Layout, bodies: Mapping[str, Body]) -> Array:
    """Springs per area of every channel (n_flat,), Pa m-1: E / sqrt(area) of both sides in series, or those of a
    layer."""
    softness = np.zeros(layout.n_flat)
    stiffest = max(b.shape.elasticity.young_moduli[1] for b in bodies.values())
    for i, side, name in body_sides(units):
        modulus = bodies[name].shape.elasticity.young_moduli[0]
        if not bodies[name].rigid:
            softness[layout.channels(i, side)] += 1.0 / modulus
    springs = np.zeros(layout.n_flat)
    for i, unit in enumerate(units):
        first, second = layout.channels(i, 0), layout.channels(i, 1)
        both = softness[first] + softness[second]
        both = np.where(both > 0.0, both, 1.0 / stiffest)
        stiffness = 1.0 / (both * np.sqrt(unit.geometry.areas)[:, None])
        springs[first] = springs[second] = _of_layer(unit, stiffness)
    return springs


def _of_layer(unit: InterfaceUnit, springs: Array) -> Array:
    """Springs (n_point, n_component) of a law: those of an elastic layer where it has any."""
    if not unit.behaviour.elastic or unit.behaviour.opens or not unit.behaviour.compliant:
        return springs
    layer = unit.behaviour.point_parameters(unit.geometry.n_point)[:, [0, *[1] * (springs.shape[1] - 1)]]
    return np.where(layer > 0.0, np.minimum(layer, _STIFFEST * springs), springs)


def _key(
    models: Sequence[SubstructureModel], units: Sequence[InterfaceUnit], trace: sp.csr_array, springs: Array
) -> bytes:
    """Equal for assemblies of equal bodies and joints, which may differ in loads and in laws of contacts."""
    digest = hashlib.sha256()
    for m in models:
        digest.update(repr((m.name, m.n_full, m.expansion.shape)).encode())
        for part in (m.stiffness, m.expansion, m.imposed_pattern, m.positions):
            _add(digest, part)
    for unit in units:
        digest.update(repr((unit.name, unit.sides, unit.behaviour.n_component, bonds(unit.behaviour))).encode())
        for array in (unit.geometry.areas, unit.geometry.frames):
            _add(digest, array)
    _add(digest, trace)
    _add(digest, springs)
    return digest.digest()


def _add(digest: Any, part: sp.csr_array | Array | None) -> None:
    """Add the numbers of a matrix to a digest."""
    arrays = (part.indptr, part.indices, part.data) if isinstance(part, sp.csr_array) else (part,)
    for array in arrays:
        if array is not None:
            digest.update(np.ascontiguousarray(array).tobytes())
