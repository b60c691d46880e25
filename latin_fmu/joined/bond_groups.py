"""Bodies that are joined by perfect interfaces as one substructure of the march: a group.

The sides of a perfect interface move together. With the free dofs E of the bodies of a group side by side, the bonds
J u = 0 determine some of these by the others (``tied_assembly.eliminated``),

    u = E Q q + D d,        J E Q = 0,   J D = 0,

so that a group is a substructure with the dofs q, the matrices Q^T E^T (.) E Q, the loads of its bodies one below the
other, and the traces of the interfaces that are left. It is integrated as any other: weighted sums of M a, C v, K u and
f at the same instants, in which the tractions of bonds cancel. Time schemes, laws, search directions and energies are
those of bodies. Bodies whose strains relax and others that do not may be in one group: its branches have springs of
their own then (``SubstructureModel.unrelaxed``).

An interface between two bodies of one group has relative motions for its unknowns: those of side E over E', which
stands for the ground.

Groups follow from the bonds alone, not from names, order or processes.
"""

from __future__ import annotations

import hashlib
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field, replace
from functools import cached_property
from typing import Final

import numpy as np
import scipy.sparse as sp
from scipy.sparse.csgraph import connected_components

from ..assembly.body import Body, body_sides, consecutive
from ..assembly.initial_state import InitialState
from ..assembly.models import ModelClass
from ..interface.laws import bonds
from ..latin.assembly import Array, Index, InterfaceUnit, Layout
from ..propagator import SubstructureModel
from ..propagator.model import unrelaxed_part
from ..time_scheme import MaxwellBranches
from .hierarchical_dofs import HierarchicalDofs
from .static_assembly import against_ground, joined_loads, ordered
from .tied_assembly import Joints, TieError, channel_trace, eliminated, joint_rows, jump_rows

_APART: Final = 1e-9  # of the largest initial value, by which the sides of a bond may differ at t = 0


@dataclass(frozen=True)
class GroupPlace:
    """Where a body is in the march: its substructure, and its full dofs among those of this."""

    substructure: str
    part: slice


@dataclass(frozen=True)
class BondGroup:
    """Bodies that are one substructure.

    Attributes
    ----------
    models : of the bodies. bonded : numbers of the bonds between them. inner : of other interfaces between them.
    where : of their full dofs. trace : (n_flat, n_full) to the channels of all interfaces. model : the substructure.
    channels : flat indices (n_channel,) of its channels in the layout of all interfaces. shares : strengths of the
    branches of each body over those of the substructure, by name.
    """

    models: list[SubstructureModel]
    bonded: tuple[int, ...]
    inner: tuple[int, ...]
    where: Mapping[str, slice]
    trace: sp.csr_array
    model: SubstructureModel
    channels: Index
    shares: Mapping[str, float]


@dataclass(frozen=True)
class GroupedAssembly:
    """The substructures of a march in which bonds are no interfaces.

    Attributes
    ----------
    groups : those of several bodies, or bonded to the ground. classes : of all substructures, with channels in
    ``layout``. remaining : numbers of the interfaces that are left. units, layout : these. places : of the bodies.
    """

    groups: list[BondGroup]
    classes: list[ModelClass]
    remaining: tuple[int, ...]
    units: list[InterfaceUnit]
    layout: Layout
    places: Mapping[str, GroupPlace] = field(default_factory=dict)

    def displaced(self, start: InitialState) -> GroupedAssembly:
        """The same with these initial displacements, and a layout of its own, whose gaps a start changes."""
        displacement = {
            group.model.name: np.concatenate([start.displacement.get(m.name, m.displacement) for m in group.models])
            for group in self.groups
        }
        whole = replace(start, displacement={**start.displacement, **displacement})
        classes = whole.displaced(self.classes)
        models = {m.name: m for c in classes for m in c.members}
        groups = [replace(group, model=models[group.model.name]) for group in self.groups]
        return replace(self, groups=groups, classes=classes, layout=Layout(self.units))

    def check_start(self, units: Sequence[InterfaceUnit], layout: Layout) -> None:
        """Make sure that the sides of the bonds are together at t = 0; ``units``, ``layout`` : all interfaces.

        Raises
        ------
        TieError : names one whose sides are apart, or move apart.
        """
        for group in self.groups:
            starts = {"apart": group.model.displacement, "moving apart": group.model.velocity}
            for i in group.bonded:
                jump = jump_rows(layout, group.trace, i)
                for kind, values in starts.items():
                    if np.abs(jump @ values).max(initial=0.0) > _APART * np.abs(values).max(initial=0.0):
                        raise TieError(f"the sides of interface {units[i].name} are {kind} at t = 0")

    def pairs(self, outer: Layout, layout: Layout) -> tuple[Index, Index]:
        """Channels of the interfaces that are left in a layout of theirs, and in that of all, (n,) each."""
        none = np.zeros(0, dtype=np.int64)
        numbers = list(enumerate(self.remaining))
        return (
            np.concatenate([none, *(outer.channels(j, side).ravel() for j, _ in numbers for side in (0, 1))]),
            np.concatenate([none, *(layout.channels(i, side).ravel() for _, i in numbers for side in (0, 1))]),
        )

    @property
    def n_bond(self) -> int:
        """Number of bonds that are eliminated."""
        return sum(len(group.bonded) for group in self.groups)

    @cached_property
    def in_words(self) -> str:
        """What is marched as one."""
        many = len(self.groups)
        bodies = sum(len(group.models) for group in self.groups)
        return f"{bodies} bodies in {many} group{'s' if many > 1 else ''}, {self.n_bond} bonds eliminated"

    @staticmethod
    def of(
        classes: Sequence[ModelClass],
        units: Sequence[InterfaceUnit],
        layout: Layout,
        bodies: Mapping[str, Body],
        bonded: Sequence[int],
    ) -> GroupedAssembly:
        """The assembly with these of its interfaces ``bonded``.

        Raises
        ------
        TieError : bonds between faces that are driven apart, or sides that are apart or move apart at t = 0.
        """
        members = {m.name: (m, c.channels[:, j], c.key) for c in classes for j, m in enumerate(c.members)}
        remaining = tuple(i for i in range(len(units)) if i not in set(bonded))
        groups, grouped = list[BondGroup](), set[str]()
        order = {name: n for n, name in enumerate(bodies)}
        for names, joints in connected(units, bonded):
            names.sort(key=order.__getitem__)
            grouped.update(names)
            groups.append(_group(names, joints, (units, layout, remaining), members, bodies))
        inner = {i for group in groups for i in group.inner}
        outer_units = [against_ground(units[i]) if i in inner else units[i] for i in remaining]
        outer = Layout(outer_units)
        into = _renumbered(layout, outer, remaining)
        outer_classes = [rest for c in classes if (rest := _without(c, grouped, into)) is not None]
        keys: dict[bytes, list[BondGroup]] = {}
        for group in groups:
            keys.setdefault(_key(group, members), []).append(group)
        for key, alike in keys.items():
            channels = np.stack([into[group.channels] for group in alike], axis=1)
            outer_classes.append(ModelClass([group.model for group in alike], channels, key=key))
        places = {name: GroupPlace(name, slice(0, members[name][0].n_full)) for name in members if name not in grouped}
        places |= {n: GroupPlace(g.model.name, part) for g in groups for n, part in g.where.items()}
        return GroupedAssembly(groups, outer_classes, remaining, outer_units, outer, places)


def suited(
    units: Sequence[InterfaceUnit], models: Mapping[str, SubstructureModel], moving: Mapping[int, Array]
) -> tuple[list[int], str]:
    """Numbers of the bonds that can be eliminated, and why others cannot, in words; ``moving`` : velocities (n_time, 3)
    of the ground by interface."""
    found, why = list[int](), ""
    for i, unit in enumerate(units):
        if not bonds(unit.behaviour):
            continue
        sides = [models[name] for _, _, name in body_sides([unit])]
        reasons = {
            "of springs and couplings": bool(unit.attached),
            "to a ground that moves": unit.against_ground and bool(moving[i].any()),
            "of rigid bodies": any(m.nodal is not None for m in sides),
            "of bodies with modal damping": any(m.modal is not None for m in sides),
        }
        reason = next((words for words, holds in reasons.items() if holds), "")
        if not reason:
            found.append(i)
        why = why or reason
    alike = list[int]()
    for names, joints in connected(units, found):
        if _relax_alike([models[name].branches for name in names]):
            alike += joints
        else:
            why = why or "of bodies that relax in unlike times"
    return sorted(alike), why


def _relax_alike(branches: Sequence[MaxwellBranches]) -> bool:
    """Whether branches of bodies have the same relaxation times, and strengths in one ratio; those without any do."""
    kinds = [b for b in branches if len(b)]
    ratios = [np.array(b.strengths) / _strength(b) for b in kinds]
    return all(
        b.times == kinds[0].times and np.allclose(r, ratios[0], 1e-12, 0.0) for b, r in zip(kinds, ratios, strict=True)
    )


def connected(units: Sequence[InterfaceUnit], bonded: Sequence[int]) -> list[tuple[list[str], list[int]]]:
    """Names of the bodies of every group, and numbers of its bonds."""
    sides = {i: [name for _, _, name in body_sides([units[i]])] for i in bonded}
    names = list(dict.fromkeys(name for bodies in sides.values() for name in bodies))
    number = {name: n for n, name in enumerate(names)}
    pairs = np.array([(number[bodies[0]], number[bodies[-1]]) for bodies in sides.values()]).reshape(-1, 2).T
    graph = sp.coo_array((np.ones(pairs.shape[1]), (pairs[0], pairs[1])), shape=(len(names), len(names)))
    count, label = connected_components(graph, directed=False)
    groups: list[tuple[list[str], list[int]]] = [([], []) for _ in range(count)]
    for name, group in zip(names, label.tolist(), strict=True):
        groups[group][0].append(name)
    for i, bodies in sides.items():
        groups[int(label[number[bodies[0]]])][1].append(i)
    return groups


def _group(
    names: Sequence[str],
    bonded: Sequence[int],
    interfaces: tuple[Sequence[InterfaceUnit], Layout, Sequence[int]],
    members: Mapping[str, tuple[SubstructureModel, Index, bytes]],
    bodies: Mapping[str, Body],
) -> BondGroup:
    """The group of these bodies and bonds; ``interfaces`` : all of them, their layout, and numbers of those left."""
    units, layout, remaining = interfaces
    models = [members[name][0] for name in names]
    where, n_full = consecutive({m.name: m.n_full for m in models})
    trace = channel_trace([ModelClass([m], members[m.name][1][:, None]) for m in models], layout, where, n_full)
    expansion = sp.csr_array(sp.block_diag([m.expansion for m in models], format="csr"))
    # of the bonds alone: points of contacts stay as they are
    hierarchical = HierarchicalDofs.of([units[i] for i in bonded], where, expansion)
    by_corners = hierarchical.expanded(expansion)
    driven: Array = sp.block_diag([sp.coo_array(m.imposed_pattern) for m in models]).toarray()
    rows, weights, _ = joint_rows(units, layout, trace, Joints(tuple(bonded), (), ()))
    elimination = eliminated(sp.csr_array(rows @ by_corners), np.asarray(rows @ driven), weights)
    q_part = sp.csr_array(hierarchical.reduced(elimination.q_part))
    sides = [(i, side) for i, side, name in body_sides(units) if name in set(names) and i in set(remaining)]
    inner = tuple(i for i, side in sides if side == 1 and (i, 0) in set(sides))
    sides = [(i, side) for i, side in sides if side == 0 or i not in set(inner)]
    picked = [np.zeros(0, dtype=np.int64), *(layout.channels(i, side).ravel() for i, side in sides)]
    channels = np.concatenate(picked)
    moved = [sp.csr_array((0, n_full))]
    moved += [jump_rows(layout, trace, i) if i in inner else trace[layout.channels(i, s).ravel()] for i, s in sides]
    strongest = max((m.branches for m in models), key=_strength)
    shares = {m.name: _strength(m.branches) / _strength(strongest) if len(strongest) else 1.0 for m in models}
    rest = {name: 1.0 - share for name, share in shares.items()}
    some_rest = any(rest.values()) or any(m.unrelaxed is not None for m in models)
    model = SubstructureModel(
        name="+".join(names),
        mass=_diagonal([m.inertia for m in models]),
        damping=_damping(models, "damping"),
        stiffness=_diagonal([m.stiffness for m in models]),
        expansion=sp.csr_array(expansion @ q_part),
        trace=sp.csr_array(sp.vstack(moved)),
        channel_area=layout.area[channels],
        loads=joined_loads(models, where, n_full),
        displacement=np.concatenate([m.displacement for m in models]),
        velocity=np.concatenate([m.velocity for m in models]),
        imposed_pattern=driven + by_corners @ elimination.driven,
        imposed_start=np.concatenate([m.imposed_start for m in models]),
        imposed_speed=_speeds(models),
        landing=_damping(models, "landing"),
        branches=strongest,
        unrelaxed=_diagonal(_unrelaxed(models, rest, _of_full)) if some_rest else None,
        geometric=_damping(models, "geometric"),
        store=models[0].store,
    )
    mass, damping, stiffness = (list(part) for part in zip(*(m.reduced for m in models), strict=True))
    sizes = [m.shape[0] for m in mass]
    reduced = [
        _eliminated_product(q_part, [_filled(m, n) for m, n in zip(part, sizes, strict=True)])
        for part in (mass, damping, stiffness)
    ]
    none = all(c is None for c in damping)
    model.__dict__["reduced"] = (reduced[0], None if none else reduced[1], reduced[2])
    model.__dict__["reduced_stiffness"] = model.__dict__["stiffness_by_nodes"] = reduced[2]
    if some_rest:
        parts = _unrelaxed(models, rest, _of_reduced)
        model.__dict__["_unrelaxed"] = _eliminated_product(q_part, parts)
    ordered(model, models, bodies)
    return BondGroup(models, tuple(bonded), inner, where, trace, model, channels, shares)


def _strength(branches: MaxwellBranches) -> float:
    """Sum of the strengths."""
    return sum(branches.strengths)


def _of_full(model: SubstructureModel) -> tuple[sp.csr_array, sp.csr_array | None]:
    """Stiffness of the full dofs of a body, and the part of it without branches."""
    return model.stiffness, model.unrelaxed


def _of_reduced(model: SubstructureModel) -> tuple[sp.csr_array, sp.csr_array | None]:
    """The same of its reduced dofs."""
    return model.reduced_stiffness, unrelaxed_part(model)


def _unrelaxed(
    models: Sequence[SubstructureModel],
    rest: Mapping[str, float],
    kind: Callable[[SubstructureModel], tuple[sp.csr_array, sp.csr_array | None]],
) -> list[sp.csr_array]:
    """Parts of the stiffnesses of bodies on which the branches of their substructure do not act; ``rest`` : the share
    of those that have weaker branches of their own."""
    parts = []
    for model in models:
        stiffness, unrelaxed = kind(model)
        part = rest[model.name] * stiffness
        if unrelaxed is not None:
            part = part + (1.0 - rest[model.name]) * unrelaxed
        part = sp.csr_array(part)
        part.eliminate_zeros()
        parts.append(part)
    return parts


def _filled(matrix: sp.csr_array | None, n: int) -> sp.csr_array:
    """The matrix, or one without entries."""
    if matrix is None:
        return sp.csr_array((n, n))
    return matrix


def _diagonal(matrices: Sequence[sp.csr_array]) -> sp.csr_array:
    """Matrices of bodies as blocks of one."""
    return sp.csr_array(sp.block_diag(matrices, format="csr"))


def _damping(models: Sequence[SubstructureModel], kind: str) -> sp.csr_array | None:
    """Damping of all, or its part of the contact layers; None where no body has any."""
    matrices = [getattr(m, kind) for m in models]
    if all(matrix is None for matrix in matrices):
        return None
    return _diagonal([_filled(matrix, m.n_full) for matrix, m in zip(matrices, models, strict=True)])


def _eliminated_product(q_part: sp.csr_array, matrices: Sequence[sp.csr_array]) -> sp.csr_array:
    """Q^T A Q of the blocks A."""
    product = sp.csr_array(q_part.T @ _diagonal(matrices) @ q_part)
    product.eliminate_zeros()
    product.sort_indices()
    return product


def _speeds(models: Sequence[SubstructureModel]) -> Array | None:
    """Velocities of the prescribed motions at the start; None where no body says any."""
    if all(m.imposed_speed is None for m in models):
        return None
    pairs = [(m.imposed_start, m.imposed_speed) for m in models]
    return np.concatenate([np.zeros_like(start) if speed is None else speed for start, speed in pairs])


def _renumbered(layout: Layout, outer: Layout, remaining: Sequence[int]) -> Index:
    """Flat index in ``outer`` of every channel of all interfaces; -1 of those that are eliminated."""
    into = np.full(layout.n_flat, -1, dtype=np.int64)
    for j, i in enumerate(remaining):
        for side in (0, 1):
            into[layout.channels(i, side)] = outer.channels(j, side)
    return into


def _without(c: ModelClass, grouped: set[str], into: Index) -> ModelClass | None:
    """A class without the bodies in groups, its channels renumbered; None where none is left."""
    rest = [j for j, m in enumerate(c.members) if m.name not in grouped]
    if not rest:
        return None
    return ModelClass([c.members[j] for j in rest], into[c.channels[:, rest]], key=c.key)


def _key(group: BondGroup, members: Mapping[str, tuple[SubstructureModel, Index, bytes]]) -> bytes:
    """Equal for groups whose operators are equal: of equal bodies in their order, with equal bonds and traces."""
    digest, model = hashlib.sha256(), group.model
    for member in group.models:
        digest.update(members[member.name][2])
    for matrix in (model.expansion, model.trace):
        matrix.sort_indices()
        for part in (matrix.indptr, matrix.indices):
            digest.update(part.astype(np.int64).tobytes())
        # + 0.0: no negative zeros, whose bits differ
        digest.update((np.round(matrix.data, 9) + 0.0).tobytes())
    digest.update((np.round(model.channel_area / model.channel_area.max(initial=1e-300), 9) + 0.0).tobytes())
    digest.update((np.round(model.imposed_pattern, 9) + 0.0).tobytes())
    return digest.digest()
