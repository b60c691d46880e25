"""Substructures that nothing holds: rigid motions without relative motion at any interface, and what acts on them.

The rigid motions q of each body that its conditions allow, at most six, are free where all relative motions at the
interfaces (normal ones; tangential ones with friction) vanish: the null space of their sum of squares. No contact force
does work on them. There is an equilibrium where the loads do none either; it determines strains and contact forces,
but not the place of the bodies. As many displacements of nodes are held then as there are free motions: the support is
statically determinate, its reactions are zero, and it strains nothing.
"""

from __future__ import annotations

from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass, replace

import numpy as np
import scipy.linalg as la
import scipy.sparse as sp
from scipy.sparse.csgraph import connected_components

from ..errors import Problems
from ..fem.mesh import Array, Index
from ..latin.assembly import InterfaceUnit
from ..propagator.model import closest_reduced
from ..scene.laws import InputLaw
from ..scene.schema import Scene
from .body import Body, body_sides, consecutive
from .conditions import Conditions, RigidConditions
from .limit_load import HELD, allowed_motions
from .models import load_terms

BALANCED = 1e-8
"""Work of the loads on a free motion, over what all of them would do where it is largest, up to which it is none."""
_SAME_GROUP = 1e-9  # entry of the projection onto the free motions that couples two bodies
_WELL_HELD = 1e-3  # pivot of the last held displacement over that of the first, for nodes inside bodies
_HELD_AT_ALL = 1e-9  # the same for any nodes


@dataclass(frozen=True)
class FreeGroup:
    """Substructures that move together as rigid bodies.

    Attributes
    ----------
    motions : displacements of the nodes (3 n_node, n) for the n free motions of the group, by substructure.
    """

    motions: Mapping[str, Array]

    @property
    def n(self) -> int:
        """Number of free motions."""
        return int(next(iter(self.motions.values())).shape[1])

    def work(self, forces: Iterable[tuple[str, Array, Array]]) -> tuple[float, Array]:
        """Largest work of nodal forces on a free motion, over what all of them would do where it is largest, and their
        resultant (3,), N, at that instant, along the axes that the group can move along; forces as of ``acting``."""
        net, gross, resultant = np.zeros((1, self.n)), np.zeros((1, self.n)), np.zeros((1, 3))
        widest = np.max([np.linalg.norm(_nodal(m), axis=1).max(axis=0) for m in self.motions.values()], axis=0)
        for name, pattern, amplitude in forces:
            if name in self.motions:
                size = float(np.linalg.norm(pattern.reshape(-1, 3), axis=1).sum())
                net = net + np.outer(amplitude, pattern @ self.motions[name])
                gross = gross + np.outer(np.abs(amplitude), size * widest)
                resultant = resultant + np.outer(amplitude, pattern.reshape(-1, 3).sum(axis=0))
        worst = int(np.abs(net).max(axis=1).argmax())
        largest = np.maximum(gross.max(axis=0), 1e-300)
        own = next(iter(self.motions.values()))
        moves = np.array([float(_contains(own, axis)) for axis in range(3)])
        left = moves * resultant[worst]
        return float((np.abs(net) / largest).max()), np.where(np.abs(left) > 1e-6 * np.abs(left).max(), left, 0.0)


def _nodal(motions: Array) -> Array:
    """Motions (3 n_node, n) as vectors (n_node, 3, n)."""
    return motions.reshape(-1, 3, motions.shape[1])


def free_groups(
    bodies: Mapping[str, Body], conditions: Mapping[str, Conditions], units: Sequence[InterfaceUnit]
) -> list[FreeGroup]:
    """Groups of substructures that could move as rigid bodies without relative motion at any interface, open or
    closed."""
    motions = {name: allowed_motions(body, conditions[name]) for name, body in bodies.items()}
    return _groups(free_motions(motions, units), motions)


def free_motions(motions: Mapping[str, Array], units: Sequence[InterfaceUnit]) -> dict[str, Array]:
    """Factors (n_motion, n_free) of the motions of every body (3 n_node, n_motion) in the motions without relative
    motion at any interface."""
    where, total = consecutive({n: m.shape[1] for n, m in motions.items()})
    if not total:
        return {n: np.zeros((0, 0)) for n in motions}
    squares = np.zeros((total, total))
    for unit in units:
        relative = np.zeros((unit.geometry.n_point * unit.behaviour.n_component, total))
        for _, side, name in body_sides([unit]):
            trace = unit.geometry.local_trace(side, unit.behaviour.n_component)
            if trace is not None:
                relative[:, where[name]] += (1 - 2 * side) * (trace @ motions[name])
        squares += relative.T @ relative / unit.geometry.n_point
    values, vectors = la.eigh(squares)
    free = vectors[:, values < HELD * max(float(values[-1]), 1e-300)] if values[-1] > 0 else vectors
    return {name: free[rows] for name, rows in where.items()}


def _groups(factors: Mapping[str, Array], motions: Mapping[str, Array]) -> list[FreeGroup]:
    """Free motions of bodies, by the bodies that they couple; ``factors`` as of ``free_motions``."""
    names, free = list(factors), np.concatenate([*factors.values()])
    where, _ = consecutive({n: len(f) for n, f in factors.items()})
    projection = free @ free.T
    coupled = [[float(np.abs(projection[where[a], where[b]]).max(initial=0.0)) for b in names] for a in names]
    moving = [i for i in range(len(names)) if coupled[i][i] > _SAME_GROUP]
    graph = sp.csr_array((np.array(coupled) > _SAME_GROUP).astype(float))
    label = connected_components(graph, directed=False)[1]
    groups = []
    for number in dict.fromkeys(label[moving].tolist()):
        members = [names[i] for i in moving if label[i] == number]
        rows = np.concatenate([np.arange(where[n].start, where[n].stop) for n in members])
        values, vectors = la.eigh(projection[np.ix_(rows, rows)])
        own, at = vectors[:, values > 0.5], 0
        parts = {}
        for name in members:
            size = where[name].stop - where[name].start
            parts[name] = motions[name] @ own[at : at + size]
            at += size
        groups.append(FreeGroup(parts))
    return groups


def acting(scene: Scene, bodies: Mapping[str, Body], time: Array) -> list[tuple[str, Array, Array]]:
    """Substructure, pattern (3 n_node,), N, and amplitudes (n_row,) of everything that acts on nodes: rows for the
    instants ``time``, then one for each law that is set from outside, whose amplitude is not known."""
    laws = scene.force_laws
    inputs = [name for name, law in laws.items() if isinstance(law, InputLaw)]
    forces = []
    for name, body in bodies.items():
        for term in load_terms(scene, name, body, None):
            known = np.zeros(len(time)) if term.name in inputs else laws[term.name].sample(time)
            forces.append((name, term.pattern, np.concatenate([known, [float(term.name == n) for n in inputs]])))
    return forces


def unheld(
    groups: Sequence[FreeGroup],
    forces: Sequence[tuple[str, Array, Array]],
    conditions: Mapping[str, Conditions],
    because: str,
) -> Problems:
    """A problem for every substructure of a free group whose loads are not in balance, or which is rigid.

    forces : see ``acting``. because : the key that requests statics.
    """
    problems = Problems()
    for group in groups:
        share, resultant = group.work(forces)
        if share <= BALANCED and not all(isinstance(conditions[n], RigidConditions) for n in group.motions):
            continue
        by = f"by [{', '.join(f'{f:.3g}' for f in resultant + 0.0)}] N" if resultant.any() else "by a couple"
        loads = f"; its loads are out of balance by {share:.2g} of their sum (at most {BALANCED:g}), {by}"
        for name, own in group.motions.items():
            ways = _ways(own)
            problems.add(
                f"substructure.{name}",
                "nothing holds it, so that a static position does not exist",
                f"it can {ways}{loads if share > BALANCED else ''}",
                remedy="hold it with a boundary (fixed or symmetry with one component is enough), give it an interface "
                f"with friction or a perfect one, balance its loads, or leave {because} out",
            )
    return problems


def free_remarks(groups: Sequence[FreeGroup]) -> list[str]:
    """A sentence for every group whose position is chosen."""
    return [
        f"substructure {', '.join(group.motions)}: nothing holds it, and its loads are in balance: where it "
        f"can {_ways(next(iter(group.motions.values())))}, {group.n} displacements of nodes are held, without reactions"
        for group in groups
    ]


def with_place(
    groups: Sequence[FreeGroup],
    bodies: Mapping[str, Body],
    conditions: Mapping[str, Conditions],
    units: Sequence[InterfaceUnit],
) -> dict[str, Conditions]:
    """The conditions with as many displacements of elastic bodies held as there are free motions."""
    held = dict(conditions)
    for group in groups:
        elastic = {n: m for n, m in group.motions.items() if not isinstance(conditions[n], RigidConditions)}
        moved = {n: closest_reduced(conditions[n].expansion, motions) for n, motions in elastic.items()}
        inner = {n: _off_interfaces(bodies[n], conditions[n].expansion, units) for n in moved}
        chosen = _pivots({n: (inner[n], m[inner[n]]) for n, m in moved.items()}, group.n, _WELL_HELD)
        if chosen is None:
            everything = {n: (np.arange(len(m)), m) for n, m in moved.items()}
            chosen = _pivots(everything, group.n, _HELD_AT_ALL) or {}
        for name, columns in chosen.items():
            expansion = conditions[name].expansion
            kept = np.setdiff1d(np.arange(expansion.shape[1]), columns)
            held[name] = replace(conditions[name], expansion=sp.csr_array(expansion[:, kept]))
    return held


def _off_interfaces(body: Body, expansion: sp.csr_array, units: Sequence[InterfaceUnit]) -> Index:
    """Reduced dofs that no interface takes part in."""
    taken = np.zeros(expansion.shape[1], dtype=bool)
    for unit in units:
        for _, side, name in body_sides([unit]):
            trace = unit.geometry.traces[side]
            if name == body.name and trace is not None:
                taken[sp.csr_array(trace @ expansion).indices] = True
    return np.flatnonzero(~taken)


def _pivots(moved: Mapping[str, tuple[Index, Array]], n: int, least: float) -> dict[str, Index] | None:
    """Reduced dofs whose displacements determine n free motions, by substructure; None where they do not.

    moved : numbers of reduced dofs and their values in the free motions (n_dof, n).
    """
    rows = np.concatenate([np.zeros((0, n)), *(values for _, values in moved.values())])
    if len(rows) < n:
        return None
    triangle, order = la.qr(rows.T, mode="r", pivoting=True)
    if abs(triangle[n - 1, n - 1]) <= least * abs(triangle[0, 0]):
        return None
    chosen, first = {}, 0
    for name, (numbers, values) in moved.items():
        own = order[:n][(order[:n] >= first) & (order[:n] < first + len(values))] - first
        chosen[name] = numbers[own]
        first += len(values)
    return chosen


def _ways(motions: Array) -> str:
    """What motions (3 n_node, n) are, in words."""
    along = [f"along {axis}" for i, axis in enumerate("xyz") if _contains(motions, i)]
    turns = motions.shape[1] > len(along) and np.linalg.matrix_rank(motions, tol=1e-6) > len(along)
    moves = f"move {', '.join(along)}"
    return "turn" if not along else f"{moves} and turn" if turns else moves


def _contains(motions: Array, axis: int) -> bool:
    """Whether a translation along an axis is a combination of the motions (3 n_node, n)."""
    translation = np.tile(np.eye(3)[axis], len(motions) // 3)
    rest = translation - motions @ la.lstsq(motions, translation)[0]
    return bool(np.linalg.norm(rest) < 1e-6 * np.linalg.norm(translation))
