"""Places of bodies that an equilibrium does not determine.

Tractions of an equilibrium determine the strains of the bodies. A body that only contacts without pressure hold, or
nothing at all, may be moved as a rigid body: every place in which pressed points stay closed, points that stick stay
where they are, and no gap is negative, has the same loads and tractions. Of all these states the one with the least
displacement in the norm of the mass is taken: with the rigid motions R q that the joints leave, and the displacements u
of any of the states,

    min over q of 1/2 (u + R q)^T M (u + R q),      g + N . (R q)_E' - N . (R q)_E >= 0   at points without pressure,

a quadratic program with one solution, since R^T M R is positive. No name, no order, no direction of the axes and no
unit enters it. It is solved as a least distance program by non-negative least squares (C. L. Lawson, R. J. Hanson,
Solving Least Squares Problems, SIAM 1995, chapter 23).
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from typing import Final

import numpy as np
import scipy.linalg as la
from numpy.typing import NDArray

from ..assembly.body import Body, body_sides, consecutive
from ..assembly.conditions import Conditions, RigidConditions
from ..assembly.initial_state import InitialState
from ..assembly.problem import DiscretisedProblem
from ..fem.mesh import Array
from ..interface.laws import NoSlip, bonds, coulomb_coefficient
from ..latin.assembly import InterfaceUnit
from ..propagator.model import closest_reduced
from ..remarks import Remark
from .free_bodies import HELD, allowed_motions

_CLOSED: Final = 1e-9
"""A gap below this share of the largest displacement is none: the places are as exact as the equilibrium."""
TOUCHES: Final = 1e-6
"""The same for points that count as closed in the end: strains of bodies that nothing presses are known to this."""
_MOVES: Final = 1e-5  # motion of a node that counts, for unit motions of bodies
PRESSED: Final = 1e-8
"""A traction above this share of the largest of the state is one; the equilibrium is solved to 1e-9 of it at least."""


@dataclass(frozen=True)
class _Motions:
    """Rigid motions of a body that its conditions allow.

    full : on its full unknowns (n_full, n), those of the state. nodal : of its nodes (3 n_node, n). momentum : M times
    ``full``.
    """

    full: Array
    nodal: Array
    momentum: Array


def least_displaced(problem: DiscretisedProblem, state: InitialState, size: float) -> InitialState:
    """The equilibrium ``state`` of a problem with its bodies in the places of least displacement; itself where the
    tractions determine all places. ``size`` : of the tractions that its loads can bring, Pa."""
    units = [unit for unit in problem.units if unit.name in state.traction]
    motions = {name: _motions(problem.bodies[name], problem.conditions[name]) for name in state.displacement}
    where, total = consecutive({name: m.full.shape[1] for name, m in motions.items()})
    if not total:
        return state
    largest = max((float(np.abs(f).max(initial=0.0)) for f in state.traction.values()), default=0.0)
    least = PRESSED * max(largest, size)
    relative = {unit.name: _relative(unit, motions, where, total) for unit in units}
    fixed = {unit.name: _kept(unit, state.traction[unit.name], least) for unit in units}
    free = _left_free(relative, fixed, total)
    if not free.shape[1]:
        return state
    open_ones = {unit.name: ~fixed[unit.name][:, 0] for unit in units if unit.behaviour.opens}
    gaps = gaps_of(problem, units, state.displacement)
    size = max(float(np.abs(u).max(initial=0.0)) for u in state.displacement.values())
    rooms = np.concatenate([np.zeros(0), *(gaps[name][which] for name, which in open_ones.items())])
    # what the iteration leaves overlapping is not pushed out
    rooms[np.abs(rooms) <= _CLOSED * size] = 0.0
    rows = np.concatenate([np.zeros((0, total)), *(relative[n][which, 0] for n, which in open_ones.items())])
    mass, momentum = np.zeros((total, total)), np.zeros(total)
    for name, part in where.items():
        mass[part, part] = motions[name].full.T @ motions[name].momentum
        momentum[part] = motions[name].momentum.T @ state.displacement[name]
    shift = free @ _nearest(free.T @ mass @ free, free.T @ momentum, rows @ free, rooms)
    displacement = {n: u + motions[n].full @ shift[where[n]] for n, u in state.displacement.items()}
    size = max(float(np.abs(u).max(initial=0.0)) for u in displacement.values())
    # nothing acts: every place is that of the scene
    if size == 0.0:
        return state
    closure = dict(state.closure)
    for name, gap in gaps_of(problem, units, displacement).items():
        # points that this place closes have a gap of round-off
        touches = open_ones[name] & (np.abs(gap) <= TOUCHES * size)
        if name in closure:
            closure[name] = np.where(touches, gap, closure[name])
    # round-off of the iteration is no pressure: a law of the motion would take such points for pressed ones
    traction = {n: np.where(fixed[n], f, 0.0) if n in open_ones else f for n, f in state.traction.items()}
    moved = replace(state, displacement=displacement, closure=closure, traction=traction)
    # what moves with all that it touches is told before the run (``statics.start_remarks``)
    joined = _left_free(relative, {n: k | (n in open_ones) for n, k in fixed.items()}, total)
    apart = free - joined @ (joined.T @ free)
    names = [n for n, part in where.items() if np.abs(motions[n].nodal @ apart[part]).max(initial=0.0) > _MOVES]
    if not names:
        return moved
    said = f"substructure {', '.join(names)}: only contacts without pressure support it at t = 0: of places without "
    said += "overlap the static start uses the one with the least displacement (mean over the mass)"
    return replace(moved, remarks=(*state.remarks, Remark("free", said)))


def _motions(body: Body, conditions: Conditions) -> _Motions:
    if isinstance(conditions, RigidConditions):
        n_free = conditions.expansion.shape[1]
        motions = np.eye(conditions.expansion.shape[0])[:, :n_free]
        mass = np.asarray(conditions.basis.T @ conditions.body.mass @ conditions.basis)
        return _Motions(motions, conditions.nodal @ motions, mass @ motions)
    allowed = allowed_motions(body, conditions)
    # exactly as the supports allow
    motions = np.asarray(conditions.expansion @ closest_reduced(conditions.expansion, allowed))
    return _Motions(motions, motions, np.asarray(body.mass @ motions))


def _relative(unit: InterfaceUnit, motions: Mapping[str, _Motions], where: Mapping[str, slice], total: int) -> Array:
    """Motions (n_point, n_component, total) of side E' less those of side E."""
    n = unit.behaviour.n_component
    motion = np.zeros((unit.geometry.n_point * n, total))
    for _, side, name in body_sides([unit]):
        trace = unit.geometry.local_trace(side, n)
        if trace is not None and name in motions:
            motion[:, where[name]] += (2 * side - 1) * (trace @ motions[name].nodal)
    return motion.reshape(-1, n, total)


def _kept(unit: InterfaceUnit, traction: Array, least: float) -> NDArray[np.bool_]:
    """Directions (n_point, n_component) along which the sides of an interface stay as they are."""
    behaviour, fixed = unit.behaviour, np.zeros(traction.shape, dtype=bool)
    # joints that carry nothing at rest
    if behaviour.compliant and not behaviour.elastic:
        return fixed
    if not behaviour.opens:
        normal, tangential = (getattr(behaviour, f"{d}_stiffness", 1.0) > 0.0 for d in ("normal", "tangential"))
        every = bonds(behaviour)
        fixed[:, 0], fixed[:, 1:] = every or normal, every or tangential
        return fixed
    pressed = traction[:, 0] < -least
    fixed[:, 0] = pressed
    mu = coulomb_coefficient(behaviour)
    if isinstance(behaviour, NoSlip) or mu is None or mu > 0.0:
        sticks = pressed
    else:
        sticks = np.zeros_like(pressed)
    sheared = np.abs(traction[:, 1:]).max(axis=1, initial=0.0) > least
    fixed[:, 1:] = (sticks | sheared)[:, None]
    return fixed


def _left_free(relative: Mapping[str, Array], fixed: Mapping[str, NDArray[np.bool_]], total: int) -> Array:
    """Combinations (total, n) of the rigid motions that move no side of an interface along a direction it keeps."""
    squares = np.zeros((total, total))
    for name, motion in relative.items():
        rows = motion[fixed[name]]
        # a mean: fine faces count no more than coarse ones
        squares += rows.T @ rows / len(motion)
    values, vectors = la.eigh(squares)
    if values[-1] <= 0.0:
        return vectors
    return np.asarray(vectors[:, values < HELD * values[-1]])


def gaps_of(
    problem: DiscretisedProblem, units: Sequence[InterfaceUnit], displacement: Mapping[str, Array]
) -> dict[str, Array]:
    """Gaps (n_point,) of the interfaces that open, under displacements of the bodies on their full unknowns, m."""
    gaps = {unit.name: unit.geometry.gap.copy() for unit in units if unit.behaviour.opens}
    for unit in units:
        for _, side, name in body_sides([unit]) if unit.name in gaps else ():
            trace = unit.geometry.local_trace(side, 1)
            if trace is not None and name in displacement:
                conditions, u = problem.conditions[name], displacement[name]
                if isinstance(conditions, RigidConditions):
                    nodal = conditions.nodal @ u
                else:
                    nodal = u
                gaps[unit.name] += (2 * side - 1) * (trace @ nodal)
    return gaps


def _nearest(mass: Array, momentum: Array, rows: Array, rooms: Array) -> Array:
    """y that makes 1/2 y^T mass y + momentum^T y smallest where rooms + rows y >= 0; 0 where there is no such y."""
    from scipy.optimize import nnls  # few scenes need it

    lower = la.cholesky(mass, lower=True)
    # in z = L^T y: the point nearest to z_0 in the half spaces A z >= -rooms
    start = -la.solve_triangular(lower, momentum, lower=True)
    across = la.solve_triangular(lower, rows.T, lower=True).T
    size = np.linalg.norm(across, axis=1)
    counts = size > 1e-12 * size.max(initial=0.0)
    across, needed = across[counts] / size[counts, None], -rooms[counts] / size[counts]
    needed = needed - across @ start
    if needed.size and needed.max() > 0.0:
        scale = float(needed.max())
        goal = np.zeros(len(start) + 1)
        goal[-1] = 1.0
        weights, _ = nnls(np.vstack([across.T, needed / scale]), goal)
        # the constraints that hold with equality determine the solution
        active = weights > 0.0
        moved = la.lstsq(across[active], needed[active], cond=1e-12)[0]
        # overlaps that no motion opens: the place stays as it is
        if (needed - across @ moved).max() > 1e-6 * scale:
            return np.zeros(len(start))
        start = start + moved
    return np.asarray(la.solve_triangular(lower, start, lower=True, trans="T"))
