"""Results of a run as plain arrays: histories of interfaces and substructures, windows, timings, outcome.

Interface fields are those of the local stage (they satisfy the behaviour exactly), substructure fields those of the
linear stage (they satisfy equilibrium exactly); the indicator measures the distance of both.
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, field
from typing import NamedTuple, Protocol

import numpy as np
from numpy.typing import NDArray

from ..interface.laws import SEPARATION, SLIP
from .bolt_sections import ClampedFace, ScrewData, ShankSections

Array = NDArray[np.float64]

SETTLED = 10
"""Instants after which the gap of a point that has closed under way has settled."""
_CLOSED = 1e-2  # of what a point has sunk: a gap before the first pressure up to which it counts as closed


class PointFields(NamedTuple):
    """Fields of one interface over n instants: those of the same name in its ``InterfaceHistory``."""

    traction: Array
    velocity: Array
    gap: Array | None
    contact_status: NDArray[np.int8] | None


@dataclass(frozen=True)
class InterfaceHistory:
    """Local-stage fields of one interface over the run (global axes, SI units).

    Attributes
    ----------
    name, behaviour : as in the scene; behaviour is the registry key ("perfect", "contact", ...).
    sides : the two faces, e.g. ("bar1.zmax", "bar2.zmin"); the second may be "ground".
    points : (n_point, 3) reference coordinates on side E, m.
    areas : (n_point,) area carried by each point, m2.
    normals : (n_point, 3) unit normal N from E to E'.
    initial_gap : (n_point,) open gap at the start, m.
    friction_coefficient : Coulomb's mu, 0 for a frictionless contact, None for a law without mu (perfect, no_slip).
    traction : (n_time, n_point, 3) traction the interface exerts on side E, Pa.
    velocity : (n_time, 2, n_point, 3) velocities of sides E and E', m s-1.
    gap : (n_time, n_point) opening along N from the displacements, m (negative = penetration); None for
        an interface that cannot open.
    contact_status : (n_time, n_point) int8, separation 0, stick 1, slip 2; None as for ``gap``.
    friction_power : (n_time,) power dissipated by friction, W (>= 0); None without friction.
    layer_energy : (n_time,) elastic energy of the layer, J; None where there is none.
    joint_power : (n_time,) power dissipated by a viscous joint, W (>= 0); None elsewhere.
    cells : triangles and quadrilaterals (n_cell, 4) between the points, -1 behind the three of a triangle, or None.
    quasi_static : whether velocities are those over the step that ends at the instant.
    peak_duration : of the mean whose largest value is the peak force, s; None for a share of the contact.
    """

    name: str
    behaviour: str
    sides: tuple[str, str]
    points: Array
    areas: Array
    normals: Array
    initial_gap: Array
    friction_coefficient: float | None
    traction: Array
    velocity: Array
    gap: Array | None
    contact_status: NDArray[np.int8] | None
    friction_power: Array | None
    layer_energy: Array | None = None
    joint_power: Array | None = None
    cells: NDArray[np.int64] | None = None
    quasi_static: bool = False
    peak_duration: float | None = None

    @property
    def mu(self) -> float:
        """Coulomb's coefficient; 0 also for a law without one."""
        return self.friction_coefficient or 0.0

    @property
    def has_friction(self) -> bool:
        """Whether Coulomb friction acts (mu > 0)."""
        return self.mu > 0.0

    @property
    def points_over_time(self) -> PointFields:
        """Fields of the history that are known at every point and instant."""
        return PointFields(self.traction, self.velocity, self.gap, self.contact_status)

    def force(self) -> Array:
        """Resultant force on side E, (n_time, 3), N."""
        force: Array = np.einsum("p,tpc->tc", self.areas, self.traction)
        return force

    def impulse(self, time: Array) -> Array:
        """Running time integral (trapezoid) of ``force``, (n_time, 3), N s."""
        force = self.force()
        step = np.diff(time)[:, None] * 0.5 * (force[1:] + force[:-1])
        return np.concatenate([np.zeros((1, 3)), np.cumsum(step, axis=0)])

    def normal_resultant(self) -> Array:
        """Compressive normal resultant, (n_time,), N, positive in compression."""
        pull: Array = np.einsum("p,tpc,pc->t", self.areas, self.traction, self.normals)
        return -pull

    def pressure(self) -> Array:
        """Normal pressure at the points, (n_time, n_point), Pa, positive in compression."""
        pressure: Array = -np.einsum("tpc,pc->tp", self.traction, self.normals)
        return pressure

    def slip(self, time: Array) -> Array:
        """Distance that side E' has moved along the face of E since the start, (n_time, n_point), m."""
        slip: Array = np.linalg.norm(self.slip_path(time), axis=2)
        return slip

    @property
    def _along(self) -> Array:
        """Velocity of side E' relative to E along the face, (n_time, n_point, 3), m s-1."""
        jump = self.velocity[:, 1] - self.velocity[:, 0]
        along: Array = jump - np.einsum("tpc,pc->tp", jump, self.normals)[:, :, None] * self.normals
        return along

    def slip_path(self, time: Array) -> Array:
        """Displacement of side E' along the face of E since the first of the instants, (n_time, n_point, 3), m: the
        velocities at all instants, integrated (trapezoid; end of the step without inertia)."""
        jump = self._along
        if self.quasi_static:
            mean = jump[1:]
        else:
            mean = 0.5 * (jump[1:] + jump[:-1])
        moved = np.cumsum(np.diff(time)[:, None, None] * mean, axis=0)
        return np.concatenate([np.zeros((1, *jump.shape[1:])), moved])

    def slid(self, time: Array) -> tuple[Array, Array]:
        """Length of the way of side E' along the face of E while it slides, m, and energy dissipated by friction per
        area, J m-2, since the first of the instants, (n_time, n_point) each.

        Both take velocities and tractions of the end of each step, as ``friction_power`` does, whose sum over time is
        that of the energies over the areas; the way counts in steps that end in sliding.
        """
        jump = self._along
        if self.contact_status is None:
            slides = np.ones(jump.shape[:2], dtype=bool)
        else:
            slides = self.contact_status == SLIP
        rates = np.linalg.norm(jump, axis=2) * slides, np.einsum("tpc,tpc->tp", self.traction, jump)
        step = np.diff(time)[:, None]
        start = np.zeros((1, len(self.points)))
        way, energy = (np.concatenate([start, np.cumsum(step * rate[1:], axis=0)]) for rate in rates)
        return way, energy

    @property
    def _penetrable(self) -> bool:
        """Whether a penetration is an error: not where the sides cannot open, nor in an elastic layer."""
        return self.gap is not None and bool(self.gap.size) and self.layer_energy is None

    def penetration(self) -> float:
        """Largest penetration, m (0 where the interface cannot open, or is an elastic layer)."""
        if self.gap is None or not self._penetrable:
            return 0.0
        return float(max(0.0, -self.gap.min()))

    def sunk(self, noise: float = 0.0) -> Array:
        """How far the sides have approached at points that never opened, (n_point,), m: the largest decrease of the gap
        since the start, or since ``SETTLED`` instants after the first pressure; 0 at points that opened or never
        touched.

        The laws keep a closed gap as it is: what it decreases by is the error of the run, where a landing leaves a
        penetration, within some steps. ``noise`` : gap, m, up to which a point between two contacts counts as closed.
        """
        if self.gap is None or self.contact_status is None or not self._penetrable:
            return np.zeros(len(self.points))
        touches = self.closed(noise)
        # argmax of no contact at all is 0: masked by ``stayed``
        first, instants = np.argmax(touches, axis=0), np.arange(len(touches))[:, None]
        stayed = touches.any(axis=0) & (touches | (instants < first)).all(axis=0)
        settled = np.where(first == 0, 0, np.minimum(first + SETTLED, len(touches) - 1))
        at_first = np.take_along_axis(self.gap, settled[None], axis=0)[0]
        depth: Array = at_first - np.where(instants >= settled, self.gap, np.inf).min(axis=0, initial=np.inf)
        # open by more than a hundredth of its depth before it touched: a landing, no closed joint
        before = np.where(instants < first, self.gap, -np.inf).max(axis=0, initial=-np.inf)
        return np.where(stayed & (before <= _CLOSED * depth), depth.clip(min=0.0), 0.0)

    def closed(self, noise: float = 0.0) -> NDArray[np.bool_]:
        """Whether the points touch (n_kept, n_point), openings of up to ``noise``, m, between two contacts counted as
        contact: those of a closed joint whose velocities are exact to the tolerance of the run alone."""
        if self.gap is None or self.contact_status is None:
            return np.ones((len(self.velocity), len(self.points)), dtype=bool)
        touches = np.asarray(self.contact_status != SEPARATION)
        if not (noise > 0.0 and (~touches & (self.gap <= noise)).any()):
            return touches
        return touches | _openings_within(noise, ~touches, self.gap)

    def landed(self) -> float:
        """Largest penetration of a landing, m: without what points that never opened have sunk."""
        if self.gap is None or not self._penetrable:
            return 0.0
        return float(max(0.0, (-self.gap.min(axis=0) - self.sunk()).max(initial=0.0)))


def _openings_within(noise: float, opened: NDArray[np.bool_], gap: Array) -> NDArray[np.bool_]:
    """The openings (n_kept, n_point) whose gap, m, stays within ``noise`` from one contact to the next."""
    kept, points = opened.shape
    # a row of instants for each point, contact before and after; the first and last opening have one neighbour alone
    edges = np.diff(np.pad(opened.T.astype(np.int8), ((0, 0), (1, 1))), axis=1)
    (point, begin), (_, end) = np.nonzero(edges == 1), np.nonzero(edges == -1)
    inner = (begin > 0) & (end < kept)
    first, behind = (point * kept + begin)[inner], (point * kept + end)[inner]
    if not len(first):
        return np.zeros_like(opened)
    # one more value at the end, where an opening of the last point may end
    widest = np.maximum.reduceat(np.append(gap.T, 0.0), np.stack([first, behind], axis=1).ravel())[::2]
    marks = np.zeros(points * kept + 1, dtype=np.int64)
    marks[first[widest <= noise]] += 1
    marks[behind[widest <= noise]] -= 1
    return np.asarray(np.cumsum(marks)[:-1].reshape(points, kept).T > 0)


@dataclass(frozen=True)
class NodeMarks:
    """What is at the nodes of a substructure, (n_node,) each.

    Attributes
    ----------
    support : a boundary fixes or drives it along all axes. contact_edge : it belongs to a cell at the edge of a contact
        or of a support, where the stress has no limit under refinement.
    """

    support: NDArray[np.bool_]
    contact_edge: NDArray[np.bool_]


@dataclass(frozen=True)
class SubstructureHistory:
    """Linear-stage fields of one substructure. Fields that are not requested are None.

    Attributes
    ----------
    nodes : (n_node, 3) coordinates, m. cells : (n_cell, 8 | 4) connectivity in VTK order.
    cell_type : "hexahedron" or "tetra".
    time : (n_stored,) instants at which the fields below are kept, s.
    displacement, velocity : (n_stored, n_node, 3), m and m s-1.
    stress : (n_stored, n_cell, 6) mean stress of each element, Pa, order xx yy zz yz xz xy.
    energy : per instant of the whole run (n_time,), J, keys ``kinetic``, ``elastic`` (of the strains), ``prestress``
        (of the geometric stiffness), ``work_of_loads``, ``interface_work`` (work of the interface tractions on this
        substructure), ``damping_dissipation``, ``landing_dissipation``, ``scheme_dissipation``; work and dissipation
        accumulate from the start.
    marks : of the nodes, where fields are kept.
    """

    name: str
    nodes: Array
    cells: NDArray[np.int64]
    cell_type: str
    time: Array
    displacement: Array | None
    velocity: Array | None
    stress: Array | None
    energy: dict[str, Array] | None
    marks: NodeMarks | None = None


@dataclass(frozen=True)
class SensorHistory:
    """Motion of a sensor at every instant of the run, global axes; the linear-stage fields of its body.

    Attributes
    ----------
    name, substructure : as in the scene. face : the face of a mean over a face, None for a point.
    point : (3,) the point, or the centre of the face, reference configuration, m.
    displacement, velocity : (n_time, 3), m and m s-1. acceleration : (n_time, 3), m s-2; None in quasi-static runs.
    remark : how the acceleration was found, or why there is none; empty where it is that of the time scheme.
    """

    name: str
    substructure: str
    face: str | None
    point: Array
    displacement: Array
    velocity: Array
    acceleration: Array | None
    remark: str = ""


@dataclass(frozen=True)
class ReactionHistory:
    """Force of a support on its body.

    Attributes
    ----------
    boundary, substructure, face : as in the scene. force : (n_time, 3), N, global axes.
    """

    boundary: str
    substructure: str
    face: str
    force: Array


@dataclass(frozen=True)
class BoltHistory:
    """Tension of a bolt over the run, and how it was tightened.

    Attributes
    ----------
    name, substructure : as in the scene. order : when it was tightened. target : tension aimed at, N; None where the
        shortening is given. area : of the cut across the axis, m2. shortening : kept since it was tightened, m.
    force : (n_time,) tension, N. tightening : (n_order,) tension when the bolts of each of ``orders`` were tight, N.
    plastic_elongation : (n_time,) of the shank, m; None where it may not yield.
    thread, thread_area : metric thread, and its tensile stress area, m2; None where the scene names none.
    share : of the whole screw that is modelled; tensions are those of this part.
    sections : of the shank. section_force, section_moment : (n_time, n_section, 3) what the part beyond a section,
        along the axis, exerts on the one before it: axial and two shear forces, N, torsion and two bending moments
        about the centre of the section, N m, along ``sections.directions``.
    clamped : interfaces of the parts around the shank. screw : what margins take; None where the thread has no size.
    """

    name: str
    substructure: str
    order: int
    target: float | None
    area: float
    shortening: float
    force: Array
    orders: tuple[int, ...]
    tightening: tuple[float, ...]
    plastic_elongation: Array | None = None
    thread: str | None = None
    thread_area: float | None = None
    share: float = 1.0
    sections: ShankSections | None = None
    section_force: Array | None = None
    section_moment: Array | None = None
    clamped: tuple[ClampedFace, ...] = ()
    screw: ScrewData | None = None

    @property
    def stress_area(self) -> float:
        """Section of the modelled part whose stress is compared with a yield stress, m2: that of the thread, else of
        the cut."""
        if self.thread_area is None:
            return self.area
        return self.share * self.thread_area

    @property
    def tight(self) -> float:
        """Tension when the bolts of its order were tight, N."""
        return self.tightening[self.orders.index(self.order)]


@dataclass(slots=True)
class WindowRecord:
    """Course of the iteration in one window.

    ``error_indicator[i]`` is the amplitude sqrt(eta) after iteration i+1, ``force_mismatch[i]`` the interface force
    residual (NaN where it was not evaluated). ``accepted`` is the index of the iterate from which the run continues:
    the last one where the window converged, else the best. ``fallbacks`` names the fall-backs used, in order;
    ``newton_steps`` counts the iterations whose q is that of a Newton step. ``disagreement`` : in a window of several
    instants, largest difference of the tractions of both stages over their largest size. ``defect`` : where large
    interfaces are solved with by truncated tables, what the exact velocities under the tractions at the end leave of
    the laws, in the norm of the indicator, after so many ``corrections``; 0 elsewhere. ``imbalance`` : in a window of
    several instants, work of the difference of both stages over the energy put in so far.
    """

    first_instant: int
    last_instant: int
    error_indicator: list[float] = field(default_factory=list)
    force_mismatch: list[float] = field(default_factory=list)
    fallbacks: list[str] = field(default_factory=list)
    converged: bool = False
    accepted: int = -1
    newton_steps: int = 0
    disagreement: float = 0.0
    defect: float = 0.0
    corrections: int = 0
    imbalance: float = 0.0

    @property
    def final_error(self) -> float:
        """sqrt(eta) of the accepted iterate (0 without iteration)."""
        if self.error_indicator:
            return self.error_indicator[self.accepted]
        return 0.0

    @property
    def final_mismatch(self) -> float:
        """Interface force residual of the accepted iterate (NaN where it was not evaluated)."""
        if self.force_mismatch:
            return self.force_mismatch[self.accepted]
        return 0.0

    @property
    def iterations(self) -> int:
        """Number of LATIN iterations."""
        return len(self.error_indicator)


@dataclass
class Timings:
    """Time of the process by part, s, and its peak memory in bytes.

    CPU time: ``setup`` (meshes, matrices, factors, tables of interfaces), ``march`` (all windows, with what is kept of
    them), ``other`` (the rest of the run) and ``output``. ``wall`` : set-up and run by the wall clock. ``predicted`` :
    ``march`` and ``other`` by the cost model; 0 where there is none.
    """

    setup: float = 0.0
    march: float = 0.0
    other: float = 0.0
    output: float = 0.0
    wall: float = 0.0
    peak_memory: int = 0
    predicted: float = 0.0

    @property
    def total(self) -> float:
        """Sum of the CPU times, s."""
        return self.setup + self.march + self.other + self.output


class HistoryBlocks(Protocol):
    """Histories of the interfaces that are read block by block."""

    every: int

    def blocks(self, overlap: int = 1) -> Iterator[tuple[int, Array, dict[str, InterfaceHistory]]]:
        """Number of the first instant, instants (n,), histories by name; a block begins with the last ``overlap``
        instants of the one before."""

    def close(self) -> None:
        """End: they can be read no more."""


@dataclass(frozen=True)
class Resultants:
    """Forces and moments (6,) on a body in equilibrium, N and N m, about its centre: of its loads (with the initial
    stresses that balance a preload), interfaces and supports, and what is left on directions that are free; ``bolt``:
    largest tension of its bolts, N; ``round_off``: force that the products of its stiffness with its displacements may
    leave where they cancel, N; ``course``: largest force of a load or an interface at any instant that was kept, N, of
    an interface with its tractions added up by size: those of opposite faces cancel, and a cycle may end unloaded."""

    loads: Array
    interfaces: Array
    reactions: Array
    unbalanced: Array
    bolt: float = 0.0
    round_off: float = 0.0
    course: float = 0.0

    @property
    def vanishes(self) -> bool:
        """Whether no force is beyond round-off."""
        return self.largest <= self.round_off

    @property
    def parts(self) -> Array:
        """Resultants of the loads, the interfaces and the supports, (3, 6)."""
        return np.stack([self.loads, self.interfaces, self.reactions])

    @property
    def largest(self) -> float:
        """Largest force of the run, N."""
        return max(float(np.abs(self.parts[:, :3]).max()), self.bolt, self.course)


@dataclass(frozen=True)
class Outcome:
    """Results of a whole run.

    ``status`` is a sentence (with a remedy when ``converged`` is False). ``interface_indicator[name]`` is
    sqrt(eta) restricted to one interface, the largest over windows at the last iteration. ``passes`` counts
    substructure-instants marched or solved through a condensed operator, divided by substructures x instants.
    ``marched`` counts the marched ones alone (below 1 where inactive substructures are left out).
    ``energy`` is the assembly's: keys of ``SubstructureHistory.energy`` summed, plus ``friction_dissipation``,
    ``contact_dissipation`` (impacts), ``drift_work`` (against the laws), ``ground_work`` where the ground moves,
    ``layer_energy`` and ``joint_dissipation`` where there are elastic layers and viscous joints,
    and ``balance``; None unless requested. ``warnings`` lists remarks on the scene and the run.
    ``interfaces_every`` : the fields of the interfaces are kept at every so many instants. ``stream`` : those at more
    instants than are in ``interfaces``, for the results file; None where these are all.
    ``resultants`` : of every elastic body at the end of a run without inertia, by substructure.
    ``bond_resultants`` : normal resultants (n_time,), N, positive in compression, of bonds without histories.
    ``complete`` : whether the run reached the end of its interval; it does not where it stopped or was interrupted.
    ``interrupted`` : by what, a signal or its limit of CPU time; empty where it was not. ``faults`` : why its end
    is not trustworthy (``checks.run_checks``), none where it is.
    """

    time: Array
    interfaces: dict[str, InterfaceHistory]
    substructures: dict[str, SubstructureHistory]
    windows: Sequence[WindowRecord]
    interface_indicator: dict[str, float]
    converged: bool
    status: str
    passes: float
    energy: dict[str, Array] | None
    timings: Timings
    warnings: tuple[str, ...] = ()
    settings: dict[str, str] = field(default_factory=dict)
    marched: float = float("nan")
    sensors: dict[str, SensorHistory] = field(default_factory=dict)
    interfaces_every: int = 1
    complete: bool = True
    interrupted: str = ""
    faults: tuple[str, ...] = ()
    reactions: dict[str, ReactionHistory] = field(default_factory=dict)
    bolts: dict[str, BoltHistory] = field(default_factory=dict)
    resultants: dict[str, Resultants] = field(default_factory=dict)
    stream: HistoryBlocks | None = None
    bond_resultants: Mapping[str, Array] = field(default_factory=dict)

    @property
    def trustworthy(self) -> bool:
        """Whether the run has converged and nothing at its end speaks against it."""
        return self.converged and not self.faults

    @property
    def interface_time(self) -> Array:
        """Instants at which the fields of the interfaces are kept, s."""
        return self.time[:: self.interfaces_every]

    @property
    def error_indicator(self) -> float:
        """sqrt(eta) of the accepted iterate of each window, the largest of them."""
        return max((w.final_error for w in self.windows), default=0.0)

    def penetration(self) -> float:
        """Largest penetration over all interfaces, m."""
        return max((h.penetration() for h in self.interfaces.values()), default=0.0)

    def landed(self) -> float:
        """Largest penetration of a landing, m."""
        return max((h.landed() for h in self.interfaces.values()), default=0.0)

    def sunk(self) -> float:
        """Largest approach of points that stayed closed, m."""
        return max((float(h.sunk().max(initial=0.0)) for h in self.interfaces.values()), default=0.0)
