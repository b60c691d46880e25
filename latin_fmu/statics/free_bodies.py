"""Bodies that nothing holds, and loads that nothing holds.

Limit loads say where an equilibrium is lost, which body moves then, and how. An equilibrium needs contact forces that
hold every body against its rigid motions q, the elasticity of the bodies aside. With the pressure P and the friction T
of the points and the relative motions w = w_n N + w_t of the sides there, the balance of virtual power

    p . q + sum (P w_n(q) - T . w_t(q)) = 0   for all q,      P >= 0,   |T| <= mu P,

is linear in the forces. On the way of the loads p from one state to the next, p = p_0 + s (p_1 - p_0), the largest s is
a linear program in s and the forces. Cones are spanned by generators; further ones are added against the sliding of the
mechanism until none does negative work, so that the cone is exact (column generation). The multipliers of the balance
are the rigid motions of the mechanism: the loads do work on it, the contact forces cannot.

Two facts keep the program small. Forces at the corners of the convex hull of a plane face give the resultants of all
forces on it, so that only corners take part. The loads that can be held form a convex set, so that only the corners of
the path of the loads are examined.

This is a bound from above: friction is not an associated law, and a path may fail before. Points count as touching
whatever their gap.

Substructures that nothing holds have rigid motions without relative motion at any interface. The rigid motions q of
each body that its conditions allow, at most six, are free where all relative motions at the interfaces (normal ones;
tangential ones with friction) vanish: the null space of their sum of squares. No contact force does work on them. There
is an equilibrium where the loads do none either; it determines strains and contact forces, but not the place of the
bodies. As many displacements of nodes are held then as there are free motions: the support is statically determinate,
its reactions are zero, and it strains nothing.
"""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from typing import Any

import numpy as np
import scipy.linalg as la
import scipy.sparse as sp
from scipy.sparse.csgraph import connected_components

from ..assembly.body import Body, body_sides, consecutive
from ..assembly.conditions import Conditions, RigidConditions
from ..assembly.models import load_terms
from ..assembly.problem import DiscretisedProblem
from ..errors import Problem, Problems
from ..fem.elements import rigid_modes
from ..interface.laws import coulomb_coefficient
from ..latin.assembly import Array, Index, InterfaceUnit, NoEquilibrium
from ..propagator import SubstructureModel
from ..propagator.model import closest_reduced
from ..scene.laws import InputLaw
from ..scene.schema import Scene, straining_loads

HELD = 1e-10
"""A rigid motion with less relative motion at interfaces than this (squared) is free."""
_FIRST = 8  # generators of a friction cone at first
_ROUNDS = 40  # of added generators
_EXACT = 1e-9  # negative work of a generator over the largest relative motion; s that counts as 1
_FEW = 12  # points of a face that all take part
_LARGE = 1500  # points beyond which the program is too large
_MOST = 60  # states of the loads that are examined
_PLANE = 1e-6  # deviation of normals and points of a plane face
_NAMED = 3  # bodies of a mechanism that are named
_TURNS = 0.3  # share of a rotation in the motion of a body from which on it turns


def allowed_motions(body: Body, conditions: Conditions, more: Array | None = None) -> Array:
    """Rigid motions of the nodes that the conditions allow, prescribed ones at rest, (3 n_node, 0 ... 6); ``more``:
    motions (3 n_node, n) which the body can make beside."""
    if isinstance(conditions, RigidConditions):
        return conditions.nodal[:, : conditions.expansion.shape[1]]
    nodes, p = body.mesh.nodes, conditions.expansion
    full = rigid_modes(nodes, nodes.mean(axis=0), body.mesh.size)
    if more is not None:
        full = np.hstack([full, more])
    against = full - p @ closest_reduced(p, full)  # what held and tied nodes do not allow
    values, vectors = la.eigh(against.T @ against / len(nodes))
    return np.asarray(full @ vectors[:, values < HELD])  # mean squares over the nodes, of motions of unit size


@dataclass(frozen=True)
class _ContactPoint:
    """Generalised forces of a point: (n_motion,) of unit pressure, (2, n_motion) of unit friction; mu, infinite where
    nothing slides; ``tied``: whether it can be pulled."""

    pressure: Array
    friction: Array
    mu: float
    tied: bool


class LimitLoad:
    """Rigid motions of the bodies of a static problem, its contact forces and the path of its loads.

    Attributes
    ----------
    path : (n_time, n_motion) generalised forces of the loads at the instants; those of preloads alone at the first.
    motions : displacements of the nodes (3 n_node, n) for unit rigid motions, by substructure. where : their places.
    """

    def __init__(self, problem: DiscretisedProblem) -> None:
        self._problem = problem
        self.motions = {n: allowed_motions(b, problem.conditions[n]) for n, b in problem.bodies.items()}
        self.where, total = consecutive({n: m.shape[1] for n, m in self.motions.items()})
        self.path = np.zeros((len(problem.time), total))
        self.varying: dict[str, Array] = {}  # amplitudes of the loads
        self.raised = True  # whether all loads start from zero
        for c in problem.classes:
            for member in c.members:
                self._add_loads(member)
        self.points = [point for unit in problem.units for point in self._points_of(unit)]
        self._scale = float(np.abs(self.path).max(initial=0.0))

    def _add_loads(self, member: SubstructureModel) -> None:
        """Loads of a substructure from the first increment on."""
        conditions, motions = self._problem.conditions[member.name], self.motions[member.name]
        if isinstance(conditions, RigidConditions):  # its forces are on its own unknowns
            # full dofs of a rigid body are its motions, the free ones first
            motions = np.eye(conditions.expansion.shape[0])[:, : conditions.expansion.shape[1]]
        histories = self._problem.timeline.histories(member, self._problem.time)
        for load, amplitude in zip(member.loads, histories.amplitudes, strict=True):
            if load.name in straining_loads(self._problem.scene):  # it moves no rigid body, but for round-off
                continue
            self.path[1:, self.where[member.name]] += np.outer(amplitude[1:], load.pattern @ motions)
            # loads that start from zero can be named as shares of their amplitudes
            self.raised &= amplitude[0] == 0.0 or not np.any(load.pattern @ motions)
            if load.name:
                self.varying[load.name] = amplitude

    def _points_of(self, unit: InterfaceUnit) -> Iterator[_ContactPoint]:
        """Points of an interface that can carry all its resultants; its preload belongs to the first state."""
        geometry, n = unit.geometry, self.path.shape[1]
        relative, places = np.zeros((geometry.n_point, 3, n)), geometry.points
        for _, side, name in body_sides([unit]):
            trace = geometry.local_trace(side, 3)
            if trace is None:
                continue
            moved = (trace @ self.motions[name]).reshape(geometry.n_point, 3, -1)
            relative[:, :, self.where[name]] += (2 * side - 1) * moved  # motion of E' less that of E
            if side == geometry.owner and not self._problem.bodies[name].rigid:
                nodal = geometry.traces[side]
                assert nodal is not None
                places = (nodal @ self._problem.bodies[name].mesh.nodes.ravel()).reshape(-1, 3)
        if unit.preload:
            # the loads that the preload alone holds in balance
            self.path[0] -= unit.preload * np.einsum("p,pm->m", geometry.areas, relative[:, 0])
        mu = coulomb_coefficient(unit.behaviour)
        tied = not (unit.behaviour.opens and getattr(unit.behaviour, "compiled", False))  # a law of one's own may pull
        if unit.behaviour.n_component == 1:
            mu = 0.0
        else:
            if tied or mu is None:
                mu = np.inf
        for p in _corners(places, geometry.frames[:, 0]):
            yield _ContactPoint(relative[p, 0], -relative[p, 1:], mu, tied)  # signs of the virtual power above

    # -- the linear program -----------------------------------------------------------------------------------------
    def largest(self, start: Array, end: Array) -> tuple[float, Array]:
        """Largest s <= 1 for which start + s (end - start) can be held, and the motions (n_motion,) of the mechanism
        beyond it; s < 0 where nothing on the way can be held."""
        from scipy.optimize import linprog

        directions = [_directions(point) for point in self.points]
        s, motion = -1.0, np.zeros_like(start)
        for _ in range(_ROUNDS):
            columns, free = self._columns(directions)
            # scaled: multipliers and tolerances of the program are absolute
            matrix = np.column_stack([(end - start) / self._scale, *columns])
            bounds = [(None, 1.0), *((None, None) if f else (0.0, None) for f in free)]
            cost = np.zeros(matrix.shape[1])
            cost[0] = -1.0  # linprog minimises
            solved: Any = linprog(cost, A_eq=matrix, b_eq=-start / self._scale, bounds=bounds, method="highs")
            if solved.status != 0:
                return -1.0, motion
            # marginals are those of -s: turned round, the loads do positive work on the mechanism
            s, motion = float(solved.x[0]), -np.asarray(solved.eqlin["marginals"])
            if s > 1.0 - _EXACT or not self._refined(directions, motion):
                break
        return s, motion

    def _columns(self, directions: list[list[Array]]) -> tuple[list[Array], list[bool]]:
        """Generalised forces of the generators, and whether they may be negative."""
        columns, free = list[Array](), list[bool]()
        for point, chosen in zip(self.points, directions, strict=True):
            # without a cone, mu = 0: the pressure alone
            generators = []
            if not chosen:
                generators = [(point.pressure, point.tied)]
            generators += [(point.pressure + point.mu * (d @ point.friction), False) for d in chosen]
            if np.isinf(point.mu):
                # nothing slides: friction of either sign, without bound
                generators = [(point.pressure, point.tied), *((row, True) for row in point.friction)]
            columns += [column for column, _ in generators]
            free += [either for _, either in generators]
        return columns, free

    def slides(self, point: _ContactPoint, motion: Array) -> bool:
        """Whether a point that may open opens no more than the sliding of the mechanism requires."""
        size = max(float(np.abs(p.friction @ motion).max()) for p in self.points)
        # of a point without slip the friction does no work
        if np.isinf(point.mu):
            sliding = 0.0
        else:
            sliding = point.mu * float(np.linalg.norm(point.friction @ motion))
        return not point.tied and bool(point.pressure @ motion - sliding < 1e-6 * max(size, 1e-300))

    def _refined(self, directions: list[list[Array]], motion: Array) -> bool:
        """Add the generators against the sliding of the mechanism; whether there were any that do negative work."""
        size = max((float(np.abs(p.friction @ motion).max()) for p in self.points), default=0.0)
        added = False
        for point, chosen in zip(self.points, directions, strict=True):
            if not chosen:
                continue
            work = point.friction @ motion
            length = float(np.linalg.norm(work))
            # work of the generator whose friction is against the sliding
            if point.pressure @ motion - point.mu * length < -_EXACT * size and length > 0.0:
                chosen.append(-work / length)
                added = True
        return added


def _directions(point: _ContactPoint) -> list[Array]:
    """First directions of friction (2,) of a point; none where it has no cone."""
    if point.mu == 0.0 or np.isinf(point.mu):
        return []
    angles = 2.0 * np.pi * np.arange(_FIRST) / _FIRST
    return list(np.column_stack([np.cos(angles), np.sin(angles)]))


def _corners(points: Array, normals: Array) -> Index:
    """Corners of the convex hull of a plane face; all points of others, and of small ones."""
    centred, everything = points - points.mean(axis=0), np.arange(len(points))
    size = float(np.abs(centred).max(initial=0.0))
    if len(points) <= _FEW or np.abs(normals - normals[0]).max() > _PLANE:
        return everything
    if np.abs(centred @ normals[0]).max() > _PLANE * size:
        return everything
    values, axes = np.linalg.svd(centred, full_matrices=False)[1:]
    if values[1] <= _PLANE * values[0]:  # on a line
        along = centred @ axes[0]
        return np.array([int(along.argmin()), int(along.argmax())])
    from scipy.spatial import ConvexHull  # a tenth of a second to load

    return np.asarray(ConvexHull(centred @ axes[:2].T / size).vertices, dtype=np.int64)


# -- the path of the loads --------------------------------------------------------------------------------------------
def loss_of_equilibrium(problem: DiscretisedProblem) -> NoEquilibrium | None:
    """The first instant of a static problem whose loads no contact forces can hold, and what moves then; None where
    there is none, or where curved faces have too many points."""
    limit = LimitLoad(problem)
    if not np.abs(limit.path).any() or len(limit.points) > _LARGE:
        return None
    before = 0
    for corner in _states(limit.path):
        if limit.largest(limit.path[before], limit.path[corner])[0] < 1.0 - _EXACT:
            return _located(problem, limit, before, corner)
        before = corner
    return None


def _states(path: Array) -> list[int]:
    """Instants after the first at which the path changes its direction, and the last one; at most ``_MOST``."""
    steps = np.diff(path, axis=0)
    turns = np.abs(np.diff(steps, axis=0)).max(axis=1) > 1e-9 * np.abs(path).max()
    chosen = [*(np.flatnonzero(turns) + 1).tolist(), len(path) - 1]
    if len(chosen) <= _MOST:
        return chosen
    return sorted({chosen[i] for i in np.linspace(0, len(chosen) - 1, _MOST).astype(int).tolist()})


def _located(problem: DiscretisedProblem, limit: LimitLoad, before: int, corner: int) -> NoEquilibrium | None:
    """The increment between two states in which the equilibrium is lost."""
    path = limit.path
    low, high = before, corner
    # what can be held is convex: held up to an instant and not beyond
    while high - low > 1:
        middle = (low + high) // 2
        balanced = limit.largest(path[before], path[middle])[0] >= 1.0 - _EXACT
        if balanced:
            low, high = middle, high
        else:
            low, high = low, middle
    s, motion = limit.largest(path[low], path[high])
    if s >= 1.0 - _EXACT or s < 0.0:
        return None
    time = float(problem.time[low] + s * (problem.time[high] - problem.time[low]))
    return NoEquilibrium(high, time, f"{_mechanism(problem, limit, motion)} at {_share(limit, low, s)}")


def _share(limit: LimitLoad, low: int, s: float) -> str:
    """The loads that change in the increment after the instant ``low``, as shares of their largest amplitudes."""
    if low == 0 and not limit.raised:
        return f"{abs(s):.4g} of the loads of the first increment"
    shares = []
    for name, amplitude in limit.varying.items():
        if amplitude[low + 1] != amplitude[low]:
            now = amplitude[low] + s * (amplitude[low + 1] - amplitude[low])
            shares.append(f"{now / np.abs(amplitude).max():.4g} of load {name}")
    return ", ".join(shares)


def _mechanism(problem: DiscretisedProblem, limit: LimitLoad, motion: Array) -> str:
    """Which bodies move, and how: without the opening that the friction of the mechanism brings with it."""
    closed = np.array([p.pressure for p in limit.points if limit.slides(p, motion)])
    # the part of the motion that opens no point that slides
    if closed.size:
        sliding = motion - np.linalg.pinv(closed, rcond=_PLANE) @ (closed @ motion)
    else:
        sliding = motion
    if np.abs(sliding).max() > 1e-3 * np.abs(motion).max():
        motion = sliding
    moved = {n: (m @ motion[limit.where[n]]).reshape(-1, 3) for n, m in limit.motions.items()}
    speed = {n: float(np.linalg.norm(u, axis=1).max(initial=0.0)) for n, u in moved.items()}
    most = max(speed.values())
    # bodies that move alike stand in the order of the scene, whatever the round-off
    names = sorted((n for n, v in speed.items() if v > _TURNS * most), key=lambda n: -round(speed[n] / most, 6))
    words = [f"{n} {_way(moved[n], problem.bodies[n].mesh.nodes)}" for n in names[:_NAMED]]
    rest = len(names) - _NAMED
    return ", ".join(words) + (f" and {rest} more" if rest > 0 else "")


def _way(moved: Array, nodes: Array) -> str:
    """A rigid motion of nodes in words: along a direction, or about an axis."""
    centred = nodes - nodes.mean(axis=0)
    shift = moved.mean(axis=0)
    crosses = np.stack([np.cross(axis, centred) for axis in np.eye(3)], axis=-1).reshape(-1, 3)
    spin = np.linalg.lstsq(crosses, (moved - shift).ravel(), rcond=None)[0]
    turning = float(np.linalg.norm(moved - shift, axis=1).max())
    if turning > _TURNS * float(np.linalg.norm(moved, axis=1).max()):
        return f"turns about {_axis(spin)}"
    return f"moves along {_axis(shift)}"


def _axis(vector: Array) -> str:
    """A direction: a global axis with its sign, or components of unit length."""
    unit = vector / np.linalg.norm(vector)
    main = int(np.abs(unit).argmax())
    if abs(unit[main]) > 1.0 - 1e-4:
        return ("-" if unit[main] < 0 else "") + "xyz"[main]
    return "(" + ", ".join(f"{v + 0.0:.2g}" for v in np.round(unit, 3)) + ")"


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
        net = np.zeros((1, self.n))
        gross = np.zeros((1, self.n))
        resultant = np.zeros((1, 3))
        widest = np.max([np.linalg.norm(_nodal(m), axis=1).max(axis=0) for m in self.motions.values()], axis=0)
        for name, pattern, amplitude in forces:
            if name in self.motions:
                size = float(np.linalg.norm(pattern.reshape(-1, 3), axis=1).sum())
                # work of this force on the widest motion, whatever its direction: what net is measured by
                net = net + np.outer(amplitude, pattern @ self.motions[name])
                gross = gross + np.outer(np.abs(amplitude), size * widest)
                resultant = resultant + np.outer(amplitude, pattern.reshape(-1, 3).sum(axis=0))
        worst = int(np.abs(net).max(axis=1).argmax())
        largest = np.maximum(gross.max(axis=0), 1e-300)
        motions = next(iter(self.motions.values()))
        # axes that the group cannot follow along have a support: their resultant is no cause
        moves = np.array([float(_contains(motions, axis)) for axis in range(3)])
        rest = moves * resultant[worst]
        return float((np.abs(net) / largest).max()), np.where(np.abs(rest) > 1e-6 * np.abs(rest).max(), rest, 0.0)


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
        # squares of relative motion: their null space is free
        return {n: np.zeros((0, 0)) for n in motions}
    squares = np.zeros((total, total))
    for unit in units:
        relative = np.zeros((unit.geometry.n_point * unit.behaviour.n_component, total))
        for _, side, name in body_sides([unit]):
            trace = unit.geometry.local_trace(side, unit.behaviour.n_component)
            if trace is not None:
                relative[:, where[name]] += (1 - 2 * side) * (trace @ motions[name])
        # a mean: fine faces count no more than coarse ones
        squares += relative.T @ relative / unit.geometry.n_point
    values, vectors = la.eigh(squares)
    # values[-1] is 0 where no interface takes part: all motions are free
    if values[-1] > 0:
        free = vectors[:, values < HELD * max(float(values[-1]), 1e-300)]
    else:
        free = vectors
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
        basis, at = vectors[:, values > 0.5], 0  # eigenvalues of a projection are 0 or 1
        parts = {}
        for name in members:
            size = where[name].stop - where[name].start
            parts[name] = motions[name] @ basis[at : at + size]
            at += size
        groups.append(FreeGroup(parts))
    return groups


def acting(scene: Scene, bodies: Mapping[str, Body], time: Array) -> list[tuple[str, Array, Array]]:
    """Substructure, pattern (3 n_node,), N, and amplitudes (n_row,) of everything that acts on nodes and can move a
    body (temperatures cannot): rows for the instants ``time``, then one for each law that is set from outside, whose
    amplitude is not known."""
    laws = scene.force_laws
    inputs = [name for name, law in laws.items() if isinstance(law, InputLaw)]
    forces = []
    for name, body in bodies.items():
        for term in load_terms(scene, name, body, None, straining=False):
            if term.name in inputs:
                history = np.zeros(len(time))
            else:
                history = laws[term.name].sample(time)
            forces.append((name, term.pattern, np.concatenate([history, [float(term.name == n) for n in inputs]])))
    return forces


def unheld(
    groups: Sequence[FreeGroup],
    forces: Sequence[tuple[str, Array, Array]],
    conditions: Mapping[str, Conditions],
    because: str,
) -> Problems:
    """One problem that lists the substructures of free groups whose loads are not in balance, or which are rigid.

    forces : see ``acting``. because : the key that requests statics.
    """
    found: list[tuple[list[str], str]] = []
    for group in groups:
        share, resultant = group.work(forces)
        if share <= BALANCED and not all(isinstance(conditions[n], RigidConditions) for n in group.motions):
            continue
        # + 0.0: no negative zeros in a sentence
        if resultant.any():
            by = f"by [{', '.join(f'{f:.3g}' for f in resultant + 0.0)}] N"
        else:
            by = "by a couple"
        loads = f", its loads out of balance by {share:.2g} of their sum (at most {BALANCED:g}), {by}"
        for name, motions in group.motions.items():
            found.append(([name], f"can {ways_of(motions)}{loads if share > BALANCED else ''}"))
    if not found:
        return Problems()
    names = [name for part, _ in found for name in part]
    return Problems(
        [
            Problem(
                f"substructure.{names[0]}" if len(names) == 1 else "substructure",
                f"nothing holds {'it' if len(names) == 1 else ', '.join(names)}, so that a static position does not "
                "exist",
                free_list(found),
                remedy="hold it with a boundary (fixed or symmetry with one component is enough), give it an interface "
                f"with friction or a perfect one, balance its loads, or leave {because} out",
            )
        ]
    )


def free_list(parts: Iterable[tuple[Iterable[str], str]]) -> str:
    """Substructures that nothing holds, with what each can do, those that can do the same together.

    >>> free_list([(["a"], "can turn"), (["b"], "can move along x"), (["c"], "can turn")])
    'a, c can turn; b can move along x'
    """
    alike: dict[str, list[str]] = {}
    for names, words in parts:
        alike.setdefault(words, []).extend(names)
    return "; ".join(f"{', '.join(names)} {words}" for words, names in alike.items())


def balanced_parts(groups: Sequence[FreeGroup], place: str) -> list[tuple[list[str], str]]:
    """For ``free_list``: groups whose loads are in balance, and ``place``, what becomes of their position."""
    return [
        (list(group.motions), f"can {ways_of(next(iter(group.motions.values())))}, loads in balance: {place}")
        for group in groups
    ]


def free_remarks(groups: Sequence[FreeGroup]) -> list[str]:
    """One sentence on the groups whose position is chosen, without inertia."""
    number = sum(group.n for group in groups)
    place = f"{number} displacements of nodes are held, without reactions"
    if groups:
        return [f"substructures that nothing holds: {free_list(balanced_parts(groups, place))}"]
    return []


def with_place(
    groups: Sequence[FreeGroup],
    bodies: Mapping[str, Body],
    conditions: Mapping[str, Conditions],
    units: Sequence[InterfaceUnit],
) -> dict[str, Conditions]:
    """The conditions with as many displacements of elastic bodies held as there are free motions."""
    restraints = dict(conditions)
    for group in groups:
        elastic = {n: m for n, m in group.motions.items() if not isinstance(conditions[n], RigidConditions)}
        moved = {n: closest_reduced(conditions[n].expansion, motions) for n, motions in elastic.items()}
        # at nodes of interfaces the held displacement would be part of a law
        inner = {n: _off_interfaces(bodies[n], conditions[n].expansion, units) for n in moved}
        chosen = _pivots({n: (inner[n], m[inner[n]]) for n, m in moved.items()}, group.n, _WELL_HELD)
        if chosen is None:
            everything = {n: (np.arange(len(m)), m) for n, m in moved.items()}
            chosen = _pivots(everything, group.n, _HELD_AT_ALL) or {}
        for name, columns in chosen.items():
            expansion = conditions[name].expansion
            rest = np.setdiff1d(np.arange(expansion.shape[1]), columns)
            restraints[name] = replace(conditions[name], expansion=sp.csr_array(expansion[:, rest]))
    return restraints


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
    # pivoting takes the row that depends least on those before
    triangle, order = la.qr(rows.T, mode="r", pivoting=True)
    if abs(triangle[n - 1, n - 1]) <= least * abs(triangle[0, 0]):
        return None
    chosen, first = {}, 0
    for name, (numbers, values) in moved.items():
        dofs = order[:n][(order[:n] >= first) & (order[:n] < first + len(values))] - first
        chosen[name] = numbers[dofs]
        first += len(values)
    return chosen


def ways_of(motions: Array) -> str:
    """What motions (3 n_node, n) are, in words."""
    along = [f"along {axis}" for i, axis in enumerate("xyz") if _contains(motions, i)]
    turns = motions.shape[1] > len(along) and np.linalg.matrix_rank(motions, tol=1e-6) > len(along)
    moves = f"move {', '.join(along)}"
    if not along:
        return "turn"
    if turns:
        return f"{moves} and turn"
    return moves


def _contains(motions: Array, axis: int) -> bool:
    """Whether a translation along an axis is a combination of the motions (3 n_node, n)."""
    translation = np.tile(np.eye(3)[axis], len(motions) // 3)
    rest = translation - motions @ la.lstsq(motions, translation)[0]
    return bool(np.linalg.norm(rest) < 1e-6 * np.linalg.norm(translation))
