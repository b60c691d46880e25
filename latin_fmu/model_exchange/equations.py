"""Equations of a reduced model: its arrays, bytes in an FMU, laws over time, regularised contact and friction,
right-hand side, outputs.

A time law is smooth between its knots. The integrator stops at each knot (a time event); inside a segment a law is
evaluated strictly after its first knot and not beyond its last, so that the right-hand side is continuous.

Contact of a patch (P pressure, g gap, s sliding velocity of E' over E; k, d, v_r the regularisation):

    elastic part   p = preload - k g           while closed, 0 while open
    pressure       P = p max(0, 1 - d g')      d > 0 takes out what the missing modes would carry away
    friction       tau = mu P s / v_r          while sticking: creep at less than v_r instead of no motion
                   tau = mu P s / |s|          while slipping

Closed or open, sticking or slipping are discrete states that change at events only; between events the right-hand side
is smooth. A state is left a little beyond its bound (hysteresis), so that an event never triggers the next one.
"""

from __future__ import annotations

import json
from bisect import bisect_right
from collections.abc import Iterator
from dataclasses import asdict, dataclass
from math import isfinite, nextafter
from typing import Any, Final, NamedTuple

import numpy as np
from numpy.typing import NDArray
from pydantic import TypeAdapter

from ..cosim.variable import Variable, table_from, table_text
from ..latin.state_serialization import decode, encode
from ..scene.laws import CsvLaw, HalfSineLaw, InputLaw, Law, RectangularPulseLaw, SrsLaw, StepLaw, TableLaw, TimeLaw

Array = NDArray[np.float64]
STIFFNESS = "contactStiffness"
DAMPING = "contactDamping"
SLIDING = "slidingVelocity"
EVENTS = "model.events"
WORKS: Final = ("work_of_loads", "interface_work", "friction_dissipation", "contact_dissipation", "damping_dissipation")
"""Energies that are states, in the order of the states."""
OUTPUTS: Final = {
    "interface": (
        *("force", "impulse", "velocityE", "velocityEp", "relativeVelocity", "normalForce"),
        *("gap", "smallestGap", "closed", "sticking", "slipping"),
    ),
    "sensor": ("displacement", "velocity"),
}
"""Outputs of ``cosim.output_table`` that a reduced model has, in the order of ``Outputs.row``."""
ENERGY_NAMES: Final = ("kinetic", "elastic", "contact", *WORKS, "balance")
_KIND = "reduced system 2"


@dataclass(frozen=True)
class Contacts:
    """Interfaces that may open, on patches of uniform pressure; local axes N, t1, t2, N from side E to side E'.

    Attributes
    ----------
    owner : (n_patch,) number of the interface. area : (n_patch,), m2.
    opening : (n_patch, n) and sliding : (2, n_patch, n) motion of E' relative to E from the coordinates.
    frames : (n_patch, 3, 3) rows N, t1, t2, means over the patch.
    gap : (n_patch,) at the start, m. preload : (n_patch,), Pa. friction : (n_patch,) Coulomb's coefficient.
    stiffness : (n_patch,) static stiffness of the two bodies under uniform pressure on the interface, Pa m-1.
    """

    owner: Array
    area: Array
    opening: Array
    sliding: Array
    frames: Array
    gap: Array
    preload: Array
    friction: Array
    stiffness: Array


@dataclass(frozen=True)
class Bond:
    """Force that a perfect interface exerts on side E: what its nodes need on that side to move as they do.

        force = inertia @ x'' + damping @ x' + stiffness @ x - loads @ a - pressure @ (A P) + shear @ (A tau)

    and what Maxwell branches of side E add to it (``Branch``).

    Attributes
    ----------
    interface : its number. inertia, damping, stiffness : (3, n). loads : (3, n_load).
    pressure : (3, n_patch), shear : (2, 3, n_patch): contacts that share nodes with it. normal : (3,) mean N.
    """

    interface: int
    inertia: Array
    damping: Array
    stiffness: Array
    loads: Array
    pressure: Array
    shear: Array
    normal: Array


@dataclass(frozen=True)
class Branch:
    """Maxwell branch of the bodies of a material: e' = x' - e / time on their coordinates, with the forces G e.

    Attributes
    ----------
    time : relaxation time, s. places : (k,) coordinates. stiffness : G (k, k), N m-1. bonds : (n_bond, 3, k) forces on
        side E of the bonds.
    """

    time: float
    places: Array
    stiffness: Array
    bonds: Array


@dataclass(frozen=True)
class ReducedSystem:
    """A reduced model in n coordinates x, scaled so that x is of the size of a displacement, m.

        inertia x'' + damping x' + stiffness x + sum_j G_j e_j = loads a(t) + opening^T (A P) - sliding^T (A tau)

    with the elongations e_j of the Maxwell branches (``Branch``).

    Attributes
    ----------
    bodies : names, sizes : numbers of coordinates. interfaces : names. inertia, stiffness : (n,), kg, N m-1.
    damping : (n, n) N s m-1, None where there is none. branches : of the damping by strain. loads : (n, n_load), N.
    load_names : of the columns of ``loads``, "" for a constant one. laws : of these loads, as tables of the scene.
    displacement, velocity : (n,) at the start, m, m s-1.
    sides : (n_interface, 2, 3, n) mean velocities of both sides from x'; 0 for the ground.
    ground : interfaces against moving ground: number, velocity (3,) where the law is 1, m s-1, law.
    sensors : names. places : (n_sensor, 3, n).
    traction, speed : sizes that loads and initial values can bring, Pa, m s-1. end : of the scene, s.
    """

    bodies: list[str]
    sizes: list[int]
    interfaces: list[str]
    inertia: Array
    stiffness: Array
    damping: Array | None
    branches: list[Branch]
    loads: Array
    load_names: list[str]
    laws: dict[str, dict[str, Any]]
    displacement: Array
    velocity: Array
    contacts: Contacts
    bonds: list[Bond]
    sides: Array
    ground: list[tuple[int, Array, dict[str, Any]]]
    sensors: list[str]
    places: Array
    traction: float
    speed: float
    end: float

    @property
    def n(self) -> int:
        """Number of coordinates."""
        return len(self.inertia)

    @property
    def n_elongation(self) -> int:
        """Number of elongations of all branches."""
        return sum(len(branch.places) for branch in self.branches)

    @property
    def n_motion(self) -> int:
        """Number of states of the motion: coordinates, velocities, elongations."""
        return 2 * self.n + self.n_elongation

    def to_bytes(self) -> bytes:
        """Write the system as bytes, bit for bit."""
        return encode(asdict(self), _KIND)

    @classmethod
    def from_bytes(cls, blob: bytes) -> ReducedSystem:
        """Read the system that ``to_bytes`` wrote. Raises InputError for other bytes."""
        tree = decode(blob, _KIND)
        tree["contacts"] = Contacts(**tree["contacts"])
        tree["bonds"] = [Bond(**bond) for bond in tree["bonds"]]
        tree["branches"] = [Branch(**branch) for branch in tree["branches"]]
        tree["ground"] = [tuple(item) for item in tree["ground"]]
        return cls(**tree)


@dataclass(frozen=True)
class Local:
    """A state, the derivative of one, or an event indicator.

    start, nominal : of a state. derivative_of : reference of the state.
    """

    name: str
    unit: str
    description: str
    start: float | None = None
    nominal: float | None = None
    derivative_of: int | None = None


@dataclass(frozen=True)
class Names:
    """All variables; their place is the value reference, those of ``table`` first.

    states : references in the order of the states. derivatives, indicators : first of consecutive references.
    """

    table: tuple[Variable, ...]
    locals: tuple[Local, ...]
    states: tuple[int, ...]
    derivatives: int
    indicators: int

    @property
    def count(self) -> int:
        """Number of all variables."""
        return len(self.table) + len(self.locals)

    @property
    def n_state(self) -> int:
        """Number of continuous states."""
        return len(self.states)

    @property
    def n_indicator(self) -> int:
        """Number of event indicators."""
        return self.count - self.indicators

    def to_text(self) -> str:
        """Write the names as JSON."""
        rest = [asdict(local) for local in self.locals]
        places = [list(self.states), self.derivatives, self.indicators]
        return "\n".join([json.dumps(places), json.dumps(rest), table_text(self.table)])

    @classmethod
    def from_text(cls, text: str) -> Names:
        """Read the names that ``to_text`` wrote."""
        places, rest, table = text.split("\n", 2)
        states, derivatives, indicators = json.loads(places)
        rows = tuple(Local(**row) for row in json.loads(rest))
        return cls(table_from(table), rows, tuple(states), derivatives, indicators)


N_WORK = len(WORKS)

GivenLoads = dict[str, tuple[float, float, float]]
"""Value, rate (1/s) and the time they were set at, s, of the loads set from outside, by name."""
Flags = NDArray[np.bool_]
GAP_MARGIN = 1e-6  # of the penetration under the characteristic pressure
SLIDING_MARGIN = 1e-3  # of the velocity of regularisation
_DUE = 0.1  # of the margin: an event is due here, whatever side of the root a host stops at


class Evaluation(NamedTuple):
    """At one instant: derivative (n_state,), patches, velocity of the ground (n_interface, 3)."""

    derivative: Array
    motion: ContactMotion
    traction: Traction
    ground: Array


class Equations:
    """y = (x, x', e of every branch, impulse of every interface, works where requested); see ``ReducedSystem``."""

    def __init__(self, system: ReducedSystem, energy: bool) -> None:
        self.system, self.energy = system, energy
        self.amplitudes = Amplitudes(system)
        contacts = system.contacts
        self._owner = contacts.owner.astype(np.int64)
        self._normal, self._tangent = contacts.frames[:, 0], contacts.frames[:, 1:].transpose(1, 0, 2)
        # means of unit normals: shorter than 1 where a face is curved, as the resultant of a uniform pressure on it is
        self._gather = np.zeros((len(system.interfaces), len(self._owner)))
        # (n_interface, n_patch), sums forces of patches over their interface
        self._gather[self._owner, np.arange(len(self._owner))] = 1.0
        self._slides = bool((contacts.friction > 0.0).any())
        # coordinate of every elongation
        self._of_branch = np.concatenate([np.zeros(0, np.int64), *(b.places.astype(np.int64) for b in system.branches)])
        self._flat_sliding = contacts.sliding.reshape(-1, system.n)
        self.law = ContactLaw(system, Regularisation.of(system))

    def use(self, regularisation: Regularisation) -> None:
        """Set the regularisation of contact and friction."""
        self.law = ContactLaw(self.system, regularisation)

    @property
    def n_state(self) -> int:
        """Number of continuous states."""
        return self.system.n_motion + 3 * len(self.system.interfaces) + N_WORK * self.energy

    def start(self) -> Array:
        """Values of the states at the start."""
        rest = np.zeros(self.n_state - 2 * self.system.n)
        return np.concatenate([self.system.displacement, self.system.velocity, rest])

    def nominals(self) -> Array:
        """Nominal values of the states: absolute tolerances of an integrator follow from them."""
        s = self.system
        rate = np.sqrt(s.stiffness / s.inertia)
        # one size for all impulses, that of the characteristic traction on all contacts until the end of the scene
        if len(s.contacts.area):
            force = s.traction * max(float(s.contacts.area.sum()), 1e-300)
        else:
            force = 1.0
        # every coordinate of a body has the inertia of the whole body: the first of each is taken;
        # unique, as a body without coordinates begins where the next one does
        work = float(s.inertia[np.unique(np.cumsum([0, *s.sizes[:-1]]))].sum()) * s.speed**2
        return np.concatenate(
            [
                # of a vibration with this velocity, of a rigid motion over the whole scene
                s.speed / np.maximum(rate, 1.0 / s.end),
                np.full(s.n, s.speed),
                np.concatenate([s.speed / np.maximum(rate, 1.0 / s.end)[self._of_branch], np.zeros(0)]),
                np.full(3 * len(s.interfaces), force * s.end),
                np.full(N_WORK * self.energy, work),
            ]
        )

    # -- patches --------------------------------------------------------------------------------------------------
    def motion(self, t: float, y: Array, segment: int) -> tuple[ContactMotion, Array]:
        """Motion of the patches, and velocity of the ground (n_interface, 3)."""
        s, n = self.system, self.system.n
        x, v = y[:n], y[n : 2 * n]
        gap = s.contacts.gap + s.contacts.opening @ x
        rate = s.contacts.opening @ v
        sliding = (self._flat_sliding @ v).reshape(2, -1)
        moved, velocity = self.amplitudes.ground(t, segment)
        # the ground is always side E', so that its motion counts with a positive sign
        if self.amplitudes.moves:
            gap = gap + np.einsum("pi,pi->p", self._normal, moved[self._owner])
            rate = rate + np.einsum("pi,pi->p", self._normal, velocity[self._owner])
            # rows of patches without friction are 0 in ``sliding``: the ground does not slide over them, either
            slides = s.contacts.friction > 0.0
            sliding = sliding + slides * np.einsum("cpi,pi->cp", self._tangent, velocity[self._owner])
        return ContactMotion(gap, rate, sliding), velocity

    def indicators(self, t: float, y: Array, modes: ContactModes) -> Array:
        """(2 n_patch,) positive while the discrete state holds: of the gaps, then of stick and slip."""
        return np.concatenate(self.law.indicators(self.motion(t, y, modes.segment)[0], modes))

    def switch(self, t: float, y: Array, modes: ContactModes) -> tuple[ContactModes, int]:
        """Discrete states after an event, and how many of them changed."""
        # an event next to a knot: round-off in t must not lead back to the segment before it
        segment = max(self.amplitudes.segment(t), modes.segment)
        here = ContactModes(modes.closed, modes.sticking, segment)
        return self.law.switched(self.motion(t, y, segment)[0], here)

    def modes_at(self, t: float, y: Array) -> ContactModes:
        """Discrete states that follow from the continuous states alone."""
        segment = self.amplitudes.segment(t)
        return self.law.called_for(self.motion(t, y, segment)[0], segment)

    # -- right-hand side --------------------------------------------------------------------------------------------
    def evaluate(self, t: float, y: Array, modes: ContactModes, loads: GivenLoads) -> Evaluation:
        """Derivative of the states and what the outputs need of it; ``loads`` as in ``Amplitudes.at``."""
        s, n = self.system, self.system.n
        x = y[:n]
        v = y[n : 2 * n]
        area = s.contacts.area
        motion, ground = self.motion(t, y, modes.segment)
        traction = self.law.traction(motion, modes)
        amplitudes = self.amplitudes.at(t, modes.segment, loads)
        pushed, rubbed = area * traction.pressure, area * traction.shear
        interface = s.contacts.opening.T @ pushed
        if self._slides:
            # friction on E acts along the sliding of E' over E, on E' against it
            interface -= self._flat_sliding.T @ rubbed.ravel()
        load = s.loads @ amplitudes
        if s.damping is None:
            damped = np.zeros(n)
        else:
            damped = s.damping @ v
        elongations = y[2 * n : s.n_motion]
        strained, stretching, relaxing = self._branches(v, elongations)
        acceleration = (load + interface - damped - s.stiffness * x - strained) / s.inertia
        force = self.forces((x, v, acceleration, elongations), amplitudes, pushed, rubbed)
        # P g' = p g' - p g' min(d g', 1): the last term is what the damping of the contact takes
        share = np.minimum(self.law.damping * motion.rate, 1.0)
        lost = np.sum(area * traction.elastic * motion.rate * share)
        works = [v @ load, v @ interface, np.sum(rubbed * motion.sliding), lost, v @ damped + relaxing]
        derivative = np.concatenate([v, acceleration, stretching, force.ravel(), works[: N_WORK * self.energy]])
        return Evaluation(derivative, motion, traction, ground)

    def _branches(self, v: Array, elongations: Array) -> tuple[Array, Array, float]:
        """Forces of the branches (n,), rates of their elongations, and the power that they dissipate."""
        forces = np.zeros(self.system.n)
        rates = v[self._of_branch]
        power = 0.0
        for branch, part in self._parts(elongations):
            elongation, places = elongations[part], self._of_branch[part]
            pulled = branch.stiffness @ elongation
            np.add.at(forces, places, pulled)
            rates[part] -= elongation / branch.time
            power += float(elongation @ pulled) / branch.time
        return forces, rates, power

    def _parts(self, elongations: Array) -> Iterator[tuple[Branch, slice]]:
        """Branches, and where their elongations are."""
        at = 0
        for branch in self.system.branches:
            yield branch, slice(at, at + len(branch.places))
            at += len(branch.places)
        assert at == len(elongations)

    def stretched(self, elongations: Array) -> float:
        """Energy stored in the branches, J."""
        parts = self._parts(elongations)
        return sum(0.5 * float(elongations[part] @ branch.stiffness @ elongations[part]) for branch, part in parts)

    def forces(
        self, motion: tuple[Array, Array, Array, Array], amplitudes: Array, pushed: Array, rubbed: Array
    ) -> Array:
        """Resultant forces on side E, (n_interface, 3), N; ``motion`` : x, x', x'' and elongations."""
        x, v, acceleration, elongations = motion
        # N points from E to E': the pressure pushes side E back
        on_patch = -pushed[:, None] * self._normal
        # the same sign as in ``evaluate`` seen from E
        if self._slides:
            on_patch = on_patch + np.einsum("cp,cpi->pi", rubbed, self._tangent)
        force: Array = self._gather @ on_patch
        for number, bond in enumerate(self.system.bonds):
            # inertia and internal force of side E less what loads and contacts at its nodes give: the rest comes
            # through the bond
            force[bond.interface] = (
                bond.inertia @ acceleration
                + bond.damping @ v
                + bond.stiffness @ x
                - bond.loads @ amplitudes
                - bond.pressure @ pushed
                + np.einsum("cip,cp->i", bond.shear, rubbed)
            )
            for branch, part in self._parts(elongations):
                force[bond.interface] += branch.bonds[number] @ elongations[part]
        return force


# -- laws over time ----------------------------------------------------------------------------------------------
_AFTER = 4e-9  # of the instant: laws count instants closer to a jump than 1e-9 as before it
_MOST_KNOTS = 100  # of one law: the step control of the integrator resolves more points


class Amplitudes:
    """Amplitudes of the loads and motion of the ground from their laws."""

    def __init__(self, system: ReducedSystem) -> None:
        read: TypeAdapter[TimeLaw] = TypeAdapter(Law)
        self._laws = [read.validate_python(system.laws[n]) if n else None for n in system.load_names]
        self._names = system.load_names
        self._ground = [(i, v, read.validate_python(law)) for i, v, law in system.ground]
        self._n_interface = len(system.interfaces)
        laws = [law for law in (*self._laws, *(g[2] for g in self._ground)) if law is not None]
        self.knots = sorted({knot for law in laws for knot in _knots(law) if knot >= 0.0})
        self.inputs = [n for n, law in zip(self._names, self._laws, strict=True) if isinstance(law, InputLaw)]
        self.moves = bool(self._ground)

    def segment(self, t: float) -> int:
        """Number of the segment that starts at or before t."""
        # a host reaches a knot up to round-off: it counts as reached
        return bisect_right(self.knots, t * (1.0 + 1e-12))

    def next_knot(self, segment: int) -> float | None:
        """Time at which a segment ends, s; None for the last one."""
        if segment < len(self.knots):
            return self.knots[segment]
        return None

    def _inside(self, t: float, segment: int) -> float:
        if segment > 0:
            start = self.knots[segment - 1]
            # the next number as well: at a knot in 0 the relative shift is 0
            t = max(t, nextafter(start * (1.0 + _AFTER), np.inf))
        # a jump at the end belongs to the next segment
        if segment < len(self.knots):
            return min(t, self.knots[segment])
        return t

    def at(self, t: float, segment: int, loads: GivenLoads) -> Array:
        """Amplitudes of the loads, (n_load,); ``loads`` : those set from outside."""
        inside = self._inside(t, segment)
        amplitudes = np.ones(len(self._laws))  # a constant load has no law
        for i, (name, law) in enumerate(zip(self._names, self._laws, strict=True)):
            if name in loads:
                value, rate, since = loads[name]
                amplitudes[i] = value + rate * (t - since)
            elif law is not None:
                amplitudes[i] = law.sample(inside)
        return amplitudes

    def ground(self, t: float, segment: int) -> tuple[Array, Array]:
        """Displacement and velocity (n_interface, 3) of the ground of every interface."""
        moved, velocity = np.zeros((2, self._n_interface, 3))
        if isfinite(t):
            for i, vector, law in self._ground:
                # the way from 0 in closed form: continuous over knots, so no segment is needed
                moved[i] += law.impulse(0.0, max(t, 0.0)) * vector
                velocity[i] += float(law.sample(self._inside(t, segment))) * vector
        return moved, velocity


def _knots(law: TimeLaw) -> Iterator[float]:
    if isinstance(law, StepLaw):
        yield law.start
    elif isinstance(law, RectangularPulseLaw | HalfSineLaw):
        yield from (law.start, law.start + law.duration)
    elif isinstance(law, TableLaw | CsvLaw | SrsLaw):
        # every k-th point, k rounded up
        yield from law.times[:: -(-len(law.times) // _MOST_KNOTS)]


class Outputs:
    """Outputs of a reduced model from an evaluation, in the order of its table."""

    def __init__(self, equations: Equations) -> None:
        system = equations.system
        self._equations, self._system = equations, system
        owner = system.contacts.owner.astype(np.int64)
        self._patches = [np.flatnonzero(owner == i) for i in range(len(system.interfaces))]
        self._bonds = {bond.interface: bond.normal for bond in system.bonds}

    def row(self, y: Array, modes: ContactModes, now: Evaluation, events: int) -> Array:
        """Outputs at one instant, (n_output,)."""
        s = self._system
        x, v = y[: s.n], y[s.n : 2 * s.n]
        impulses = y[s.n_motion : s.n_motion + 3 * len(s.interfaces)].reshape(-1, 3)
        forces = now.derivative[s.n_motion : s.n_motion + impulses.size].reshape(-1, 3)
        velocities = s.sides @ v
        # ``sides`` is 0 for the ground, whose velocity comes from its law alone
        velocities[:, 1] += now.ground
        parts = []
        for i in range(len(s.interfaces)):
            first, second = velocities[i]
            parts += [forces[i], impulses[i], first, second, second - first]
            # compression positive, as of contacts
            parts.append(self._contact(i, modes, now) if i not in self._bonds else [-forces[i] @ self._bonds[i]])
        for place in s.places:
            parts += [place @ x, place @ v]
        if self._equations.energy:
            parts.append(self._energies(y, now))
        parts.append([float(events)])
        return np.concatenate(parts)

    def _contact(self, interface: int, modes: ContactModes, now: Evaluation) -> list[float]:
        here = self._patches[interface]
        contacts = self._system.contacts
        area = contacts.area[here]
        share = area / area.sum()
        # open patches keep the flag ``sticking``, and a closed one without friction slips
        closed, sticking = modes.closed[here], modes.sticking[here] & (contacts.friction[here] > 0.0)
        gap = now.motion.gap[here]
        shares = [float(share @ flags) for flags in (closed, closed & sticking, closed & ~sticking)]
        # no -0.0
        return [float(area @ now.traction.pressure[here]) + 0.0, float(share @ gap), float(gap.min()), *shares]

    def _energies(self, y: Array, now: Evaluation) -> list[float]:
        s, equations = self._system, self._equations
        x, v = y[: s.n], y[s.n : 2 * s.n]
        energies = dict(zip(WORKS, y[-N_WORK:].tolist(), strict=True))
        energies["kinetic"] = 0.5 * float(s.inertia @ v**2)
        energies["elastic"] = 0.5 * float(s.stiffness @ x**2) + equations.stretched(y[2 * s.n : s.n_motion])
        spring = equations.law.stiffness
        energies["contact"] = 0.5 * float(np.sum(s.contacts.area * now.traction.elastic**2 / spring))
        start = 0.5 * float(s.inertia @ s.velocity**2 + s.stiffness @ s.displacement**2)
        stored = energies["kinetic"] + energies["elastic"] - start + energies["damping_dissipation"]
        # 0 but for the error of the integrator: the springs of contacts are part of interface_work
        energies["balance"] = stored - energies["work_of_loads"] - energies["interface_work"]
        return [energies[name] for name in ENERGY_NAMES]


@dataclass(frozen=True)
class Regularisation:
    """What replaces the laws of contact and friction.

    Attributes
    ----------
    stiffness : contact stiffness over the static stiffness of the two bodies. damping : d in units of 1 / the
        characteristic velocity. sliding : v_r, m s-1.
    """

    stiffness: float
    damping: float
    sliding: float

    @classmethod
    def of(cls, system: ReducedSystem) -> Regularisation:
        """Default regularisation of a system."""
        return cls(20.0, 0.5, 1e-3 * system.speed)


@dataclass
class ContactModes:
    """Discrete states: which patches are closed, which of them stick, and the segment of the time laws."""

    closed: Flags
    sticking: Flags
    segment: int


class ContactMotion(NamedTuple):
    """Of the patches: gap and its rate (n_patch,), sliding velocity (2, n_patch)."""

    gap: Array
    rate: Array
    sliding: Array


class Traction(NamedTuple):
    """Of the patches: pressure and its elastic part (n_patch,), friction on E (2, n_patch), Pa."""

    pressure: Array
    elastic: Array
    shear: Array


class ContactLaw:
    """Tractions, indicators and discrete states from the motion of the patches."""

    def __init__(self, system: ReducedSystem, regularisation: Regularisation) -> None:
        contacts = system.contacts
        self.regularisation = regularisation
        self.stiffness: Array = regularisation.stiffness * contacts.stiffness
        self.damping = regularisation.damping / system.speed
        self._friction, self._preload = contacts.friction, contacts.preload
        self.penetration: Array = system.traction / self.stiffness  # under the characteristic pressure

    def traction(self, motion: ContactMotion, modes: ContactModes) -> Traction:
        """Tractions while the discrete states hold."""
        # not bounded below: just before it opens a patch may pull within the margin of its event
        elastic = np.where(modes.closed, self._preload - self.stiffness * motion.gap, 0.0)
        pressure = elastic * np.maximum(0.0, 1.0 - self.damping * motion.rate)
        speed, bound = np.hypot(*motion.sliding), self.regularisation.sliding
        # slip ends a margin below v_r only; the half bounds the division where an implicit step tries less
        reach = np.where(modes.sticking, bound, np.maximum(speed, 0.5 * bound))
        return Traction(pressure, elastic, self._friction * np.maximum(pressure, 0.0) * motion.sliding / reach)

    def indicators(self, motion: ContactMotion, modes: ContactModes) -> tuple[Array, Array]:
        """Positive while the discrete states hold, (n_patch,) each, of the size 1 whatever the scene.

        For the gaps, in penetrations under the characteristic pressure, and for stick and slip, in v_r.
        """
        # the gap at which p = 0, in units of the penetration
        beyond = (motion.gap - self._preload / self.stiffness) / self.penetration
        normal = GAP_MARGIN + np.where(modes.closed, -beyond, beyond)
        beyond = np.hypot(*motion.sliding) / self.regularisation.sliding - 1.0
        tangential = SLIDING_MARGIN + np.where(modes.sticking, -beyond, beyond)
        # an open patch, or one without friction, has no event of its sliding
        return normal, np.where(modes.closed & (self._friction > 0.0), tangential, 1.0)

    def switched(self, motion: ContactMotion, modes: ContactModes) -> tuple[ContactModes, int]:
        """Discrete states after an event, and how many of them changed."""
        opens = self.indicators(motion, modes)[0] <= _DUE * GAP_MARGIN
        closed = modes.closed ^ opens  # those that are due change over
        # sliding is judged with the new contacts: what has just closed may slip at once
        here = ContactModes(closed, modes.sticking, modes.segment)
        turns = self.indicators(motion, here)[1] <= _DUE * SLIDING_MARGIN
        sticking = np.where(closed, modes.sticking ^ turns, True)  # how the next contact begins
        return ContactModes(closed, sticking, modes.segment), int(opens.sum() + turns.sum())

    def called_for(self, motion: ContactMotion, segment: int) -> ContactModes:
        """Discrete states that follow from the motion alone."""
        closed = self._preload - self.stiffness * motion.gap > 0.0
        sticking = ~closed | (np.hypot(*motion.sliding) <= self.regularisation.sliding)
        return ContactModes(closed, sticking, segment)
