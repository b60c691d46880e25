"""Limit loads: where an equilibrium is lost, which body moves then, and how.

An equilibrium needs contact forces that hold every body against its rigid motions q, the elasticity of the bodies
aside. With the pressure P and the friction T of the points and the relative motions w = w_n N + w_t of the sides there,
the balance of virtual power

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
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass
from typing import Any

import numpy as np
import scipy.linalg as la
from scipy.spatial import ConvexHull

from ..fem.elements import rigid_modes
from ..interface.laws import coulomb_coefficient
from ..latin.assembly import Array, Index, InterfaceUnit, NoEquilibrium
from ..propagator import SubstructureModel
from ..propagator.model import closest_reduced
from .body import Body, body_sides, consecutive
from .conditions import Conditions, RigidConditions
from .problem import DiscretisedProblem

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


def allowed_motions(body: Body, held: Conditions, more: Array | None = None) -> Array:
    """Rigid motions of the nodes that the conditions allow, prescribed ones at rest, (3 n_node, 0 ... 6); ``more``:
    motions (3 n_node, n) which the body can make beside."""
    if isinstance(held, RigidConditions):
        return held.nodal[:, : held.expansion.shape[1]]
    nodes, p = body.mesh.nodes, held.expansion
    full = rigid_modes(nodes, nodes.mean(axis=0), body.mesh.size)
    full = full if more is None else np.hstack([full, more])
    against = full - p @ closest_reduced(p, full)  # what held and tied nodes do not allow
    values, vectors = la.eigh(against.T @ against / len(nodes))
    return np.asarray(full @ vectors[:, values < HELD])


@dataclass(frozen=True)
class _Point:
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
        held, own = self._problem.conditions[member.name], self.motions[member.name]
        if isinstance(held, RigidConditions):  # its forces are on its own unknowns
            own = np.eye(held.expansion.shape[0])[:, : held.expansion.shape[1]]
        histories = self._problem.timeline.histories(member, self._problem.time)
        for load, amplitude in zip(member.loads, histories.amplitudes, strict=True):
            self.path[1:, self.where[member.name]] += np.outer(amplitude[1:], load.pattern @ own)
            self.raised &= amplitude[0] == 0.0 or not np.any(load.pattern @ own)
            if load.name:
                self.varying[load.name] = amplitude

    def _points_of(self, unit: InterfaceUnit) -> Iterator[_Point]:
        """Points of an interface that can carry all its resultants; its preload belongs to the first state."""
        geometry, n = unit.geometry, self.path.shape[1]
        relative, places = np.zeros((geometry.n_point, 3, n)), geometry.points
        for _, side, name in body_sides([unit]):
            trace = geometry.local_trace(side, 3)
            if trace is None:
                continue
            moved = (trace @ self.motions[name]).reshape(geometry.n_point, 3, -1)
            relative[:, :, self.where[name]] += (2 * side - 1) * moved
            if side == geometry.owner and not self._problem.bodies[name].rigid:
                nodal = geometry.traces[side]
                assert nodal is not None
                places = (nodal @ self._problem.bodies[name].mesh.nodes.ravel()).reshape(-1, 3)
        if unit.preload:
            self.path[0] -= unit.preload * np.einsum("p,pm->m", geometry.areas, relative[:, 0])
        mu = coulomb_coefficient(unit.behaviour)
        tied = not (unit.behaviour.opens and getattr(unit.behaviour, "compiled", False))  # a law of one's own may pull
        mu = 0.0 if unit.behaviour.n_component == 1 else np.inf if tied or mu is None else mu
        for p in _corners(places, geometry.frames[:, 0]):
            yield _Point(relative[p, 0], -relative[p, 1:], mu, tied)

    # -- the linear program -----------------------------------------------------------------------------------------
    def largest(self, start: Array, end: Array) -> tuple[float, Array]:
        """Largest s <= 1 for which start + s (end - start) can be held, and the motions (n_motion,) of the mechanism
        beyond it; s < 0 where nothing on the way can be held."""
        from scipy.optimize import linprog

        directions = [_directions(point) for point in self.points]
        s, motion = -1.0, np.zeros_like(start)
        for _ in range(_ROUNDS):
            columns, free = self._columns(directions)
            matrix = np.column_stack([(end - start) / self._scale, *columns])
            bounds = [(None, 1.0), *((None, None) if f else (0.0, None) for f in free)]
            cost = np.zeros(matrix.shape[1])
            cost[0] = -1.0
            solved: Any = linprog(cost, A_eq=matrix, b_eq=-start / self._scale, bounds=bounds, method="highs")
            if solved.status != 0:
                return -1.0, motion
            s, motion = float(solved.x[0]), -np.asarray(solved.eqlin["marginals"])
            if s > 1.0 - _EXACT or not self._refined(directions, motion):
                break
        return s, motion

    def _columns(self, directions: list[list[Array]]) -> tuple[list[Array], list[bool]]:
        """Generalised forces of the generators, and whether they may be negative."""
        columns, free = list[Array](), list[bool]()
        for point, chosen in zip(self.points, directions, strict=True):
            own = [(point.pressure, point.tied)] if not chosen else []
            own += [(point.pressure + point.mu * (d @ point.friction), False) for d in chosen]
            if np.isinf(point.mu):
                own = [(point.pressure, point.tied), *((row, True) for row in point.friction)]
            columns += [column for column, _ in own]
            free += [either for _, either in own]
        return columns, free

    def slides(self, point: _Point, motion: Array) -> bool:
        """Whether a point that may open opens no more than the sliding of the mechanism requires."""
        size = max(float(np.abs(p.friction @ motion).max()) for p in self.points)
        sliding = 0.0 if np.isinf(point.mu) else point.mu * float(np.linalg.norm(point.friction @ motion))
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
            if point.pressure @ motion - point.mu * length < -_EXACT * size and length > 0.0:
                chosen.append(-work / length)
                added = True
        return added


def _directions(point: _Point) -> list[Array]:
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
    while high - low > 1:
        middle = (low + high) // 2
        held = limit.largest(path[before], path[middle])[0] >= 1.0 - _EXACT
        low, high = (middle, high) if held else (low, middle)
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
    sliding = motion - np.linalg.pinv(closed, rcond=_PLANE) @ (closed @ motion) if closed.size else motion
    if np.abs(sliding).max() > 1e-3 * np.abs(motion).max():
        motion = sliding
    moved = {n: (m @ motion[limit.where[n]]).reshape(-1, 3) for n, m in limit.motions.items()}
    speed = {n: float(np.linalg.norm(u, axis=1).max(initial=0.0)) for n, u in moved.items()}
    most = max(speed.values())
    names = sorted((n for n, v in speed.items() if v > _TURNS * most), key=lambda n: -speed[n])
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
