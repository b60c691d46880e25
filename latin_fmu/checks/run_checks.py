"""Checks of a finished run: whether its end can be trusted, and remarks on what its assumptions leave out.

The method is one of small perturbations: pairs of points are those of the start, strains are linear in the
displacements, and a rotation enters by its tangent. Beyond a slip of an element, or a rotation of two degrees (whose
cosine differs from 1 by 6e-4, as a strain would), these assumptions do not hold.

In statics every body is in balance by its loads, its supports and its interfaces, to a share of the largest force of
the whole run, preloads included: a cycle may end unloaded. From the displacements u of the run

    g = K u - loads - T^T (area * tractions),

the reactions are the g of held directions, and what is left on free ones is not in balance. The resultants are those of
all nodes; moments are about the centre of the body.

The end of a run is not trustworthy, though its instants have converged, by three measures that no test of an instant
contains, each with the number, the place and a remedy:

    sinking    a point that never opened, but for gaps that velocities exact to the tolerance leave in a step, and has
               sunk (``InterfaceHistory.sunk``) by more than 1 % of the shortening
               of the bolt around whose shank it is, else of the elastic approach p (L/E + L'/E') of both bodies,
               p the largest mean pressure of the interface and L/E as in ``body.side_stiffness``; bodies without
               elasticity have none. Where loads press the joint, as a weight does (``checks.release``), an
               approach s changes its force by k s + m s'' alone: more than 0.1 % of the largest force is a remark,
               more than 5 % is not trustworthy
    energy     the sum of the account of energies (``kernels.energy``) beyond 1 % of its largest term
    rotation   a body that has turned by more than 10 degrees: strains and normals are those of small rotations

The account of energies sums up to round-off; where it does not, the numbers of the run are beyond the precision.
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from typing import TYPE_CHECKING, NamedTuple

import numpy as np

from ..assembly.bolts import Clamp
from ..assembly.problem import SolverReadyProblem
from ..interface.laws import SEPARATION, bonds
from ..latin.assembly import Array, Assembly
from ..latin.outcome import InterfaceHistory, Resultants
from ..latin.recorder import LargestStress, SubstructureInfo
from ..latin.status import Account
from ..propagator import SubstructureModel
from ..propagator.base import full_displacement
from ..remarks import Remark, remarks_of
from ..results.interface_fields import slip_in_contact
from ..scene.readable_numbers import percent, readable
from ..scene.units import SI, UnitSystem
from .lost_stress import lost_stress, rocking

if TYPE_CHECKING:
    from .release import Release

LARGEST_ROTATION = 2.0  # degrees
LARGEST_TURN = 10.0
"""Rotation of a body, degrees, beyond which a run is not trustworthy."""
LARGEST_STRAIN = 0.05
_BEYOND = 5e-3  # 1 - cos of a rotation that is reported where stress has its stiffness: 5.7 degrees
_EDGES = ((0, 1), (1, 2), (0, 3), (0, 4))  # of cells in VTK order: one along each direction at least
_NAMED = 4  # bodies beyond their yield stress that a sentence names beside the worst
_SOME_POINTS = 100  # of a face, whose distances from their neighbours stand for those of all
_DRIFT = 1e-2  # of the largest displacement, reported from there on
_ROUND_OFF = 1e-9  # of the displacement that the loads can bring
_CANCELLED = 16.0 * float(np.finfo(float).eps)  # of the largest forces of the elements, left where they cancel
_UNBALANCED = 10.0  # tolerances on the unbalanced part of the largest resultant
SUNK, OPEN = 0.01, 0.01
"""Share of the shortening of a bolt or of the elastic approach, and of the largest energy, likewise."""
TOLD, STRAYED = 1e-3, 0.05
"""Share of the largest force of a joint that loads press, by which the approach of its sides changes the force: from
which on it is a remark, and beyond which a run is not trustworthy."""
_NOISE = 4.0  # of the error that the tolerance allows a velocity: single instants are worse than the mean
_IMPACT = 0.1  # of the largest force of an interface, of points that close in one step
_PRECISION = 1e-12  # of sizes and displacements: round-off of a gap


def run_remarks(
    problem: SolverReadyProblem,
    histories: Mapping[str, InterfaceHistory],
    time: Array,
    every: int,
    balance: Mapping[str, Resultants],
    ends: Mapping[str, BodyEnd],
    stresses: Mapping[str, LargestStress],
) -> list[Remark]:
    """Remarks on drift, slip, rotations, strains, impacts, faces that never touch, resultants, and bodies
    beyond their yield stress.

    ``time`` : (n_time,) instants of the run, s; ``histories`` are kept at every ``every`` of them. ``ends`` : from
    ``body_ends``. ``stresses`` : of the run.
    """
    moved = [*small_motion_remarks(problem, histories, time, ends), *strain_remarks(problem, ends)]
    strayed = [s.words for s in sinkings(problem, histories, time[::every]) if not s.fault]
    return [
        *remarks_of("sinking", strayed),
        *remarks_of("drift", drift_remarks(problem.assembly, histories, problem.unit_system)),
        *remarks_of("motion", moved),
        *remarks_of("scheme", impact_remarks(problem, histories, time[::every])),
        *remarks_of("never_touched", untouched_remarks(histories, problem.unit_system)),
        *remarks_of("balance", balance_remarks(balance, problem.settings.tolerance, problem.unit_system)),
        *remarks_of("yield", yield_remarks(problem, stresses)),
        *remarks_of("prestress", rocking(problem, histories)),
    ]


class BodyEnd(NamedTuple):
    """A body in the present state: displacements of its nodes (n_node, 3), m, and its rotation as a whole (3,), that of
    the linear motion closest to them."""

    u: Array
    spin: Array

    @property
    def degrees(self) -> float:
        """Size of the rotation."""
        return float(np.degrees(np.linalg.norm(self.spin)))


def body_ends(problem: SolverReadyProblem) -> dict[str, BodyEnd]:
    """Motion of every body in the present state."""
    ends = {}
    for propagator in problem.assembly.propagators:
        for j, name in enumerate(propagator.names):
            u = full_displacement(propagator, j)
            if not np.isfinite(u).all():
                ends[name] = BodyEnd(u, np.full(3, np.inf))  # a fault by ``_turned``
            elif u.any():
                ends[name] = BodyEnd(u, _spin(problem.info[name].nodes, u))
            else:
                ends[name] = BodyEnd(u, np.zeros(3))
    return ends


def small_motion_remarks(
    problem: SolverReadyProblem, histories: Mapping[str, InterfaceHistory], time: Array, ends: Mapping[str, BodyEnd]
) -> list[str]:
    """Sentences on interfaces that slip by more than an element, and on bodies that turn by more than two degrees."""
    remarks, length = [], problem.unit_system["m"]
    for history in histories.values():
        edge = _edge(history)
        slip = _slip_in_contact(history, time, edge)
        if slip > edge:
            remarks.append(
                f"interface {history.name}: its sides slip by {slip:.3g} {length} in contact, more than the element "
                f"size of {edge:.3g} {length}; contact points keep their pairing, so that the pressure does not move "
                "with the sliding face"
            )
    for name, end in ends.items():
        if LARGEST_ROTATION < end.degrees <= LARGEST_TURN:  # beyond, the run is not trustworthy (``faults_of``)
            remarks += _rotation_words(name, end.degrees, problem.prestress is not None)
    return remarks


def _rotation_words(name: str, degrees: float, stressed: bool) -> list[str]:
    """What a linear rotation leaves out: lengths by 1 - cos, and the turn of forces and normals by sin, which the
    stiffness of stress (``stressed``) has for the forces of t = 0."""
    angle = np.radians(degrees)
    lengths, turned = percent(1.0 - float(np.cos(angle))), percent(float(np.sin(angle)))
    if not stressed:
        what = f"lengths and lever arms are off by up to {lengths}, the directions of forces and normals by {turned}"
    elif 1.0 - np.cos(angle) > _BEYOND:
        what = (
            f"lengths and lever arms are off by up to {lengths}, the directions of forces that are not those of t = 0 "
            f"by {turned}"
        )
    else:
        return []
    return [f"substructure {name} has rotated by {degrees:.3g} degrees at the end, and rotations are linear: {what}"]


def strain_remarks(problem: SolverReadyProblem, ends: Mapping[str, BodyEnd]) -> list[str]:
    """Sentences on bodies whose edges have changed by more than ``LARGEST_STRAIN`` of their length at the end."""
    remarks: list[str] = []
    for name, end in ends.items() if problem.unit_system.measurable else ():
        clamps = [clamp for clamp in problem.clamps if clamp.cut.table.substructure == name]
        strain = _largest_strain(problem.info[name], end, clamps)
        if strain > LARGEST_STRAIN:
            remarks.append(
                f"substructure {name} has a strain of {100 * strain:.2g} % at the end: the model assumes small "
                f"strains, up to about {100 * LARGEST_STRAIN:g} %; check the units of loads and materials"
            )
    return remarks


def _largest_strain(info: SubstructureInfo, end: BodyEnd, bolts: Sequence[Clamp]) -> float:
    """Largest change of the length of an edge over the length, without the turn of the body as a whole and the
    shortening of its ``bolts``."""
    if not end.u.any() or not np.isfinite(end.spin).all():
        return 0.0
    u = end.u - _cross(end.spin, info.nodes - info.nodes.mean(axis=0))
    # cells of fewer nodes lack some of the edges, mixed cells are padded with -1
    cells = np.asarray(info.cells)
    moved = u[cells] + sum((clamp.shifts(cells) for clamp in bolts), np.zeros(3))
    first, last = zip(*(edge for edge in _EDGES if edge[1] < cells.shape[1]), strict=True)
    there = cells[:, last] >= 0
    edge = (info.nodes[cells[:, last]] - info.nodes[cells[:, first]])[there]
    change = (moved[:, last] - moved[:, first])[there]
    length = np.einsum("ei,ei->e", edge, edge)
    return float(np.abs(np.einsum("ei,ei->e", edge, change) / length).max(initial=0.0))  # (u . e) / e^2


def yield_remarks(problem: SolverReadyProblem, stresses: Mapping[str, LargestStress]) -> list[str]:
    """A sentence on the bodies whose von Mises stress has exceeded the yield stress of their material; not on shanks
    that may yield: their bolts have a line of their own."""
    yielding = {c.cut.table.substructure for c in problem.clamps if c.cut.table.hardening is not None}
    pascal, limits = problem.unit_system.label("Pa"), {n: problem.info[n].yield_stress or np.inf for n in stresses}
    beyond = [n for n in stresses if n not in yielding and stresses[n].stress > limits[n]]
    over = sorted(beyond, key=lambda n: -stresses[n].stress / limits[n])
    if not over:
        return []
    first, *others = (f"{readable(stresses[n].stress, pascal)} at {readable(stresses[n].time, 's', 3)}" for n in over)
    info, worst = problem.info[over[0]], stresses[over[0]]
    cell = np.asarray(info.cells)[worst.element]
    at = ", ".join(f"{x:.4g}" for x in info.nodes[cell[cell >= 0]].mean(axis=0))
    more = [f"{name} ({words})" for name, words in zip(over[1:], others, strict=True)]
    if len(more) > _NAMED:
        more[_NAMED:] = [f"{len(more) - _NAMED} more"]
    return [
        f"substructure {over[0]} exceeds its yield stress {readable(limits[over[0]], pascal)}: von Mises stress of "
        f"at least {first}, mean of the element at [{at}], {worst.above} of {len(info.cells)} elements above"
        + (f"; also {', '.join(more)}" if more else "")
        + ". The model is elastic: beyond yield it overestimates stresses and forces and has no permanent deformation; "
        "reduce the loads, or use the results there as an estimate only"
    ]


def impact_remarks(problem: SolverReadyProblem, histories: Mapping[str, InterfaceHistory], time: Array) -> list[str]:
    """A sentence on the interface with the hardest impact that the time scheme was not chosen for; ``time`` : (n_time,)
    of the histories, s.

    Points of area A that close in a step with the relative velocity v along N press each other like bars, with
    A v z z' / (z + z') by the impedances z and z' of their sides (A v z on the ground, or a rigid body that is held);
    from ``_IMPACT`` of the largest force of the interface on they make the noise of the scheme.
    """
    found = [
        (size, name, words)
        for i, unit in enumerate(problem.assembly.interfaces)
        if unit.name in problem.unforeseen
        for size, name, words in [_impact(problem, i, histories[unit.name], time)]
        if size > _IMPACT
    ]
    if not found:
        return []
    _, name, words = max(found)
    if len(found) > 1:
        more = f" (and {len(found) - 1} more interfaces)"
    else:
        more = ""
    reason = problem.scheme.partition(" (")[2].partition(":")[0].removesuffix(")")
    if reason:
        before = f", and the time scheme was chosen before the run because {reason}"
    else:
        before = ""
    return [f"interface {name}{more} {words}{before}: {problem.unforeseen[name]}"]


def _impact(problem: SolverReadyProblem, i: int, history: InterfaceHistory, time: Array) -> tuple[float, str, str]:
    """Largest force of points that close in a step of interface ``i`` over the largest of all, its name, and words."""
    status, assembly = np.asarray(history.contact_status), problem.assembly
    largest = float(history.normal_resultant().max(initial=0.0))
    if len(status) < 2 or not largest > 0.0:
        return 0.0, history.name, ""
    first, second = (np.einsum("tpc,pc->tp", history.velocity[:-1, side], history.normals) for side in (0, 1))
    closing = (first - second).clip(min=0.0)
    closing = np.where((status[:-1] == SEPARATION) & (status[1:] != SEPARATION), closing, 0.0)
    force = closing @ (history.areas * _impedances(assembly, i))
    at = int(np.argmax(force))
    hit = closing[at] > 0.5 * closing[at].max()
    speed = readable(float(closing[at].max()), problem.unit_system.label("m s-1"), 3)
    when = readable(float(time[at + 1]), "s", 3)
    share = 100 * history.areas[hit].sum() / history.areas.sum()
    return float(force[at]) / largest, history.name, f"closes by an impact at {when} ({share:.0f} % of it at {speed})"


def _impedances(assembly: Assembly, i: int) -> Array:
    """Traction of the points of interface ``i`` that meet with a unit relative velocity along N, (n_point,), Pa s m-1,
    by the impedances z and z' of their sides: z z' / (z + z')."""
    z, other = (assembly.impedance[assembly.layout.channels(i, side)][:, 0] for side in (0, 1))
    # no impedance: a side that cannot move
    return np.where(z * other > 0.0, z * other / np.maximum(z + other, 1e-300), np.maximum(z, other))


def untouched_remarks(histories: Mapping[str, InterfaceHistory], units: UnitSystem = SI) -> list[str]:
    """Sentences on interfaces that may open and were never closed at an instant that is kept."""
    return [
        f"interface {name}: its sides never touch in this run"
        + ("" if history.gap is None else f" (smallest gap {float(history.gap.min()):.4g} {units['m']})")
        + ": check the gap, the direction of the motion and time.end, or remove the interface to reduce the cost"
        for name, history in histories.items()
        if history.contact_status is not None
        and history.contact_status.size
        and (history.contact_status == SEPARATION).all()
    ]


def _slip_in_contact(history: InterfaceHistory, time: Array, edge: float) -> float:
    """Largest relative displacement along the face of a point in contact, m; 0 where the sides cannot open, and where
    it cannot reach an ``edge``, m."""
    status = history.contact_status
    if status is None or len(time) < 2 or len(time) != len(history.velocity):
        return 0.0
    touching = status != SEPARATION
    if not touching.any():
        return 0.0
    fastest = float(np.abs(history.velocity).max())
    if 4.0 * fastest * float(time[-1] - time[0]) < edge:  # most that velocities can sum up to
        return 0.0
    return float(np.linalg.norm(slip_in_contact(history, time), axis=2).max())


def _edge(history: InterfaceHistory) -> float:
    """Length of an element of the face, m: the median distance of neighbouring points."""
    if len(history.points) < 2:
        return float(np.sqrt(history.areas.sum()))
    # of some points: no need of a tree, which takes a tenth of a second to load
    some = history.points[:: max(1, len(history.points) // _SOME_POINTS)]
    squares = ((some[:, None] - history.points) ** 2).sum(axis=2)
    # the nearest one is the point itself
    return float(np.sqrt(np.median(np.partition(squares, 1, axis=1)[:, 1])))


def _spin(nodes: Array, u: Array) -> Array:
    """Rotation vector (3,) of the linear motion closest to displacements (n, 3): J w = sum x x u."""
    centred, moved = nodes - nodes.mean(axis=0), u - u.mean(axis=0)
    # of points of equal mass; singular for points on a line, hence least squares
    inertia = (centred**2).sum() * np.eye(3) - centred.T @ centred
    spin: Array = np.linalg.lstsq(inertia, _cross(centred, moved).sum(axis=0), rcond=1e-12)[0]
    return spin


def _cross(first: Array, second: Array) -> Array:
    """Vector products (n, 3), in a third of the time of ``np.cross`` for a hundred nodes."""
    (a, b, c), (x, y, z) = first.T, second.T
    return np.stack([b * z - c * y, c * x - a * z, a * y - b * x], axis=1)


def drift_remarks(assembly: Assembly, histories: Mapping[str, InterfaceHistory], units: UnitSystem = SI) -> list[str]:
    """A sentence per bonded interface whose sides are apart by more than 1 % of the largest displacement.

    The iteration ties the velocities of the sides to its tolerance; displacements sum up the differences. The trapezoid
    rule adds half a step of the jump of the initial velocities, which no tolerance removes. Displacements far below
    those that the loads can bring are round-off of bodies that no wave has reached.
    """
    if not any(bonds(unit.behaviour) for unit in assembly.interfaces):
        return []
    u = assembly.displacement()
    moved = float(np.abs(u).max())
    if moved <= _ROUND_OFF * _travel(assembly):
        return []
    remarks = []
    for i, unit in enumerate(assembly.interfaces):
        # without a history its sides are the same dofs
        if not bonds(unit.behaviour) or unit.name not in histories:
            continue
        first, second = (assembly.layout.channels(i, side) for side in (0, 1))
        frames = unit.geometry.frames[:, : unit.behaviour.n_component]
        jump = np.einsum("pc,pjc->pj", np.diff(histories[unit.name].velocity[0], axis=0)[0], frames)
        drift = u[second] - u[first]
        # the trapezoid rule takes half a step of the jump at t = 0
        apart, rest = (_longest(d[:, : jump.shape[1]]) for d in (drift, drift - 0.5 * assembly.dt * jump))
        share = f"{apart:.3g} {units['m']}, {100 * apart / moved:.2g} % of the largest interface displacement"
        if min(apart, rest) > _DRIFT * moved:
            remarks.append(
                f"bonded interface {unit.name}: its sides have drifted apart by {share}: reduce solver.tolerance"
            )
        elif apart > _DRIFT * moved:
            remarks.append(
                f"bonded interface {unit.name}: its sides are apart by {share}: half a step times the jump of their "
                "initial velocities, at any tolerance; use smaller steps, or give both sides the same initial velocity"
            )
    return remarks


def _longest(vectors: Array) -> float:
    """Largest length of vectors (n_point, n_component)."""
    return float(np.linalg.norm(vectors, axis=1).max(initial=0.0))


def _travel(assembly: Assembly) -> float:
    """Distance that the largest tractions of the loads move a face in the run, m."""
    moving = assembly.impedance[assembly.impedance > 0.0]
    duration = float(assembly.time[-1] - assembly.time[0])
    if moving.size:
        return assembly.characteristic_traction * duration / float(moving.min())
    return 0.0


def resultants(
    problem: SolverReadyProblem, tractions: Array, histories: Mapping[str, InterfaceHistory]
) -> dict[str, Resultants]:
    """Resultants of every elastic body of a static problem in its present state; none with inertia.

    tractions : (n_flat,) of the interfaces, Pa. histories : of the interfaces, for the largest forces of the run.
    """
    assembly, by_body = problem.assembly, dict[str, Resultants]()
    if not assembly.quasi_static:
        return by_body
    tensions = dict[str, float]()
    for bolt in problem.output.bolts.values():
        forces = (0.0, *bolt.description.tightening)
        tensions[bolt.substructure] = max(*forces, tensions.get(bolt.substructure, 0.0))
    pressed = _largest_forces(histories)
    for propagator, channels in zip(assembly.propagators, assembly.channels, strict=True):
        for j, member in enumerate(propagator.members):
            if member.nodal is not None:  # a rigid body has no stiffness of its own
                continue
            nodes = problem.info[member.name].nodes
            amplitudes = problem.timeline.histories(member, assembly.time).amplitudes
            loads, course = np.zeros(member.n_full), pressed.get(member.name, 0.0)
            for load, amplitude in zip(member.loads, amplitudes, strict=True):
                if assembly.instant > 0:  # they come with the first increment
                    loads += amplitude[assembly.instant] * load.pattern
                    so_far = float(np.abs(amplitude[: assembly.instant + 1]).max())
                    course = max(course, so_far * _size_of_load(load.pattern))
            faces = member.trace.T @ (member.channel_area * tractions[channels[:, j]])
            # K u - f - faces: what the supports have to give
            rest = member.stiffness @ full_displacement(propagator, j).ravel() - loads - faces
            free = np.diff(member.expansion.indptr) > 0  # rows of held dofs are empty
            tension = tensions.get(member.name, 0.0)
            reactions, unbalanced = np.where(free, 0.0, rest), np.where(free, rest, 0.0)
            wrenches = [_wrench(nodes, part) for part in (loads, faces, reactions, unbalanced)]
            loose = _round_off(member, full_displacement(propagator, j))
            by_body[member.name] = Resultants(
                wrenches[0], wrenches[1], wrenches[2], wrenches[3], tension, loose, course
            )
    return by_body


def _size_of_load(pattern: Array) -> float:
    """Force, N, of the nodal forces of a load (n_full,): their resultant, or half of their sizes added up where they
    are in balance by themselves, as those of a temperature."""
    nodal = pattern.reshape(-1, 3)
    return max(float(np.linalg.norm(nodal.sum(axis=0))), 0.5 * float(np.linalg.norm(nodal, axis=1).sum()))


def _largest_forces(histories: Mapping[str, InterfaceHistory]) -> dict[str, float]:
    """Largest force, N, of an interface of each substructure at any instant, tractions added up by size."""
    forces = dict[str, float]()
    for history in histories.values():
        force = float((np.linalg.norm(history.traction, axis=2) @ history.areas).max(initial=0.0))
        for side in history.sides:
            name = side.split(".")[0]
            forces[name] = max(forces.get(name, 0.0), force)
    return forces


def _round_off(member: SubstructureModel, u: Array) -> float:
    """Force, N, that the products of a stiffness matrix with displacements (n, 3) may leave where they cancel."""
    return float(_CANCELLED * (abs(member.stiffness) @ np.abs(u.ravel())).sum())


def _wrench(nodes: Array, forces: Array) -> Array:
    """Force and moment (6,) of nodal forces (3 n_node,), N and N m."""
    nodal = forces.reshape(-1, 3)
    return np.concatenate([nodal.sum(axis=0), np.cross(nodes - nodes.mean(axis=0), nodal).sum(axis=0)])


def balance_words(by_body: Mapping[str, Resultants]) -> str:
    """How far the forces on every body are in balance, for the status of a run; empty where nothing is known."""
    if by_body and all(r.vanishes for r in by_body.values()):
        return "; forces on all bodies within round-off"
    largest = max((r.largest for r in by_body.values()), default=0.0)
    off = max((float(np.linalg.norm(r.unbalanced[:3])) for r in by_body.values()), default=0.0)
    if largest > 0.0:
        return f"; forces on every body in balance to {off / largest:.1e} of the largest"
    return ""


def balance_remarks(by_body: Mapping[str, Resultants], tolerance: float, units: UnitSystem = SI) -> list[str]:
    """A sentence on bodies whose forces are out of balance by more than ten tolerances of the largest force."""
    largest = max((r.largest for r in by_body.values()), default=0.0)
    return [
        f"substructure {name}: its forces are out of balance by {100 * off / largest:.2g} % of the largest force "
        f"({off:.3g} {units['N']}): reduce solver.tolerance"
        for name, r in by_body.items()
        if (off := float(np.linalg.norm(r.unbalanced[:3]))) > _UNBALANCED * tolerance * largest + r.round_off
    ]


# -- whether the end can be trusted -----------------------------------------------------------------------------------
def faults_of(
    problem: SolverReadyProblem,
    histories: Mapping[str, InterfaceHistory],
    time: Array,
    account: Account | None,
    ends: Mapping[str, BodyEnd],
) -> list[str]:
    """Sentences on what makes a run not trustworthy at its end; none where it is.

    ``time`` : (n_time,) of the histories, s. ``account`` : the energies at the end, None where they are not accounted
    for. ``ends`` from ``body_ends``.
    """
    sunk = [s.words for s in sinkings(problem, histories, time) if s.fault]
    lost = lost_stress(problem, histories, time)
    return [*sunk, *_open(account, problem.unit_system["J"]), *_turned(ends), *lost]


def with_faults(sentence: str, faults: Sequence[str]) -> str:
    """The status of a run with what makes it not trustworthy."""
    if faults:
        return f"not trustworthy: {'; '.join(faults)} ({sentence})"
    return sentence


class Sinking(NamedTuple):
    """A sentence on sides that have sunk into each other while they were closed, and whether it is a fault."""

    words: str
    fault: bool


def sinkings(problem: SolverReadyProblem, histories: Mapping[str, InterfaceHistory], time: Array) -> Iterator[Sinking]:
    """Interfaces whose points have sunk into each other while they were closed; ``time`` : (n_time,) of the histories,
    s."""
    length, clamps = problem.unit_system["m"], problem.clamps
    for name, history in histories.items():
        noise = _noise(problem, history, time)
        sunk, with_noise = history.sunk(), history.sunk(noise)
        if not with_noise.any():
            continue
        approach = problem.flexibility[name] * _mean_pressure(history)
        allowed, whose = np.full(len(sunk), SUNK * approach), np.full(len(sunk), -1)
        for number, clamp in enumerate(clamps):
            # points within the reach of a bolt: by its shortening, which the approach is no measure of
            under_clamp = clamp.holds(history.points) & (SUNK * clamp.shortening > 0.0)
            allowed[under_clamp], whose[under_clamp] = SUNK * clamp.shortening, number
        reach = allowed + _PRECISION * _size(problem, history)
        deep, near = ((allowed > 0.0) & ~(depth <= reach) for depth in (sunk, with_noise))  # NaN is deep, too
        if (near & (whose < 0)).any():
            free = _released(problem, histories, name)
            # what is clamped has no force from points that open, however little
            if free is not None:
                yield from _strayed(problem, history, time, free, noise)
                deep &= whose >= 0
        if not deep.any():
            continue
        worst = int(np.argmax(np.where(deep, sunk / np.maximum(allowed, np.finfo(float).tiny), 0.0)))
        if whose[worst] >= 0:
            of = f"the shortening of bolt {clamps[whose[worst]].cut.name}"
        else:
            of = "the elastic approach"
        at = ", ".join(f"{x:.4g}" for x in history.points[worst])
        words = (
            f"interface {name}: excessive penetration at {int(deep.sum())} of {len(sunk)} points that never opened, at "
            f"[{at}] by {sunk[worst]:.3g} {length}, {percent(SUNK * sunk[worst] / allowed[worst])} "
            f"of {of} (allowed: {percent(SUNK)}); the clamp force is inaccurate: {_finer(problem)}"
        )
        yield Sinking(words, fault=True)


def _noise(problem: SolverReadyProblem, history: InterfaceHistory, time: Array) -> float:
    """Gap, m, that the errors of velocities exact to the tolerance open in a step."""
    if len(time) < 2 or len(history.velocity) < 2:
        return 0.0
    step = float(time[1] - time[0])
    return _NOISE * problem.settings.tolerance * float(np.abs(history.velocity).max(initial=0.0)) * step


def _finer(problem: SolverReadyProblem) -> str:
    """The remedy for errors of the iteration."""
    return f"reduce solver.tolerance, for example to {0.1 * problem.settings.tolerance:g}"


def _released(problem: SolverReadyProblem, histories: Mapping[str, InterfaceHistory], name: str) -> Release | None:
    """The joint as one that loads press, None where bodies are clamped in it."""
    from .release import released

    models = {n: m for p in problem.assembly.propagators for n, m in zip(p.names, p.members, strict=True)}
    nodes = {n: problem.info[n].nodes for n in models}
    opening = {n: h for n, h in histories.items() if h.contact_status is not None}
    pressed = {n: np.asarray((h.pressure() > 0.0).any(axis=0)) for n, h in opening.items()}
    return released(list(models.values()), nodes, problem.assembly.interfaces, pressed, name)


def _strayed(
    problem: SolverReadyProblem, history: InterfaceHistory, time: Array, free: Release, noise: float
) -> Iterator[Sinking]:
    """A sentence on a joint that loads press, where the approach of its sides changes the force; ``time`` : (n_time,),
    s; ``noise`` : gap, m, up to which points count as closed.

    In points that stay closed for two steps the sides have no relative acceleration along the normal: what the gap has
    of it, over the mean of these points, is an error of the iteration, and takes a force by the mass that it moves, or
    that of a wave where it is over before the wave is back.
    """
    depth = float(history.sunk(noise).max())
    force = free.stiffness * depth
    largest = float(history.normal_resultant().max(initial=0.0))
    if history.gap is not None and history.contact_status is not None and len(time) > 2 and not history.quasi_static:
        closed = history.closed(noise)
        areas = (closed[:-2] & closed[1:-1] & closed[2:]) * history.areas
        speed = np.diff(history.gap, axis=0) / np.diff(time)[:, None]
        total = np.maximum(areas.sum(axis=1), np.finfo(float).tiny)
        change = np.abs((areas * np.diff(speed, axis=0)).sum(axis=1)) / total
        inertia = free.mass * change / np.diff(time)[1:]
        i = [unit.name for unit in problem.assembly.interfaces].index(history.name)
        front = np.maximum(np.abs(speed[:-1]), np.abs(speed[1:])) * areas @ _impedances(problem.assembly, i)
        force += float(np.minimum(inertia, front).max(initial=0.0))
    if largest > 0.0:
        share = force / largest
    else:
        share = 0.0
    if not share <= TOLD:  # NaN, too
        fault, approach = not share <= STRAYED, readable(depth, problem.unit_system.label("m"), 3)
        limit = ""
        if fault:
            limit = f" (allowed: {percent(STRAYED)})"
        yield Sinking(
            f"interface {history.name}: its sides, pressed together by loads alone, have approached by {approach} at "
            f"points that stayed closed; the inertia of this motion changes the force between them by {percent(share)} "
            f"of its largest value in the mean over a few steps, at single instants by more{limit}: {_finer(problem)}",
            fault,
        )


def _mean_pressure(history: InterfaceHistory) -> float:
    """Largest pressure over time, mean over the points that touch, Pa."""
    pressed = history.pressure() > 0.0
    force, area = np.maximum(history.pressure(), 0.0) @ history.areas, pressed @ history.areas
    return float(np.divide(force, area, out=np.zeros_like(force), where=area > 0.0).max(initial=0.0))


def _size(problem: SolverReadyProblem, history: InterfaceHistory) -> float:
    """Size of coordinates and displacements at an interface, m."""
    sides = {side.split(".")[0] for side in history.sides}
    moved = [
        float(np.abs(full_displacement(p, j)).max())
        for p in problem.assembly.propagators
        for j, name in enumerate(p.names)
        if name in sides
    ]
    return float(np.ptp(history.points, axis=0).max()) + max(moved, default=0.0)


def _open(account: Account | None, joule: str) -> Iterator[str]:
    """The balance of energies, where it does not close."""
    if account is not None and not abs(account.open) <= OPEN * account.largest + account.negligible:
        if account.largest > 0.0:
            share = abs(account.open) / account.largest
        else:
            share = np.inf
        yield (
            f"energy: the balance of the bodies has a residual of {account.open:.3g} {joule} at the end, "
            f"{percent(share)} of its largest term, {account.largest:.3g} {joule} (allowed: {percent(OPEN)}): the "
            "numbers exceed the floating-point precision; use smaller steps, and check the units of times and loads"
        )


def _turned(ends: Mapping[str, BodyEnd]) -> Iterator[str]:
    """Bodies that have turned too far."""
    far = {name: end.degrees for name, end in ends.items() if not end.degrees <= LARGEST_TURN}  # NaN and infinity, too
    if far:
        worst = max(far, key=lambda name: far[name])
        if len(far) == 1:
            others = ""
        else:
            others = f" (and {len(far) - 1} more bodies by more than {LARGEST_TURN:g})"
        yield (
            f"substructure {worst} has rotated by {far[worst]:.3g} degrees at the end{others}; strains and contact "
            f"normals assume small rotations (allowed: {LARGEST_TURN:g} degrees): end the run earlier by time.end, or "
            "support the rotating body"
        )
