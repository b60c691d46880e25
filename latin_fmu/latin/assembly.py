"""The assembly of a run: propagators, interfaces, and the flat vector of interface quantities that joins them.

Interfaces of one class of behaviour and number of components form a group, stored as a block (side, point, component)
of the flat vector so that their local stage is one vectorised call. Substructures use the same numbers by index arrays:
gather to (channel, member), scatter back. A channel is one interface degree of freedom in the local frame.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from ..interface import Behaviour, InterfaceGeometry
from ..propagator import Propagator
from ..propagator.base import channel_displacement, channel_velocity
from ..propagator.interface_probing import Points
from ..time_scheme import QuasiStatic, TimeScheme

Array = NDArray[np.float64]
Index = NDArray[np.int64]


@dataclass(frozen=True)
class InterfaceUnit:
    """One interface, ready to be solved.

    Attributes
    ----------
    name : name in the scene. sides : faces, the second may be "ground". behaviour, geometry : see ``interface``.
    preload : contact pressure at the start, Pa. attached : key of the table in the scene, e.g. ``spring.NAME``, of what
    joins points or mean motions of faces; "" for an interface of faces. note : how its gap was found, where that is
    worth a word.
    """

    name: str
    sides: tuple[str, str]
    behaviour: Behaviour
    geometry: InterfaceGeometry
    preload: float
    attached: str = ""
    note: str = ""

    @property
    def against_ground(self) -> bool:
        """Whether side E' is the rigid ground."""
        return self.geometry.traces[1] is None


@dataclass(frozen=True)
class Group:
    """Interfaces of one kind, their points concatenated.

    Attributes
    ----------
    behaviour : a member's behaviour (its static methods serve all).
    start : offset in the flat vector. n_point, n_component : block shape (2, n_point, n_component).
    parameters : (n_point, n_parameter). gap : (n_point,), m. preload : (n_point,), Pa.
    members : interface index -> its points.
    """

    behaviour: Behaviour
    start: int
    n_point: int
    n_component: int
    parameters: Array
    gap: Array
    preload: Array
    members: dict[int, slice]

    @property
    def stop(self) -> int:
        """End of the block in the flat vector."""
        return self.start + 2 * self.n_point * self.n_component

    def block(self, flat: Array) -> Array:
        """View (..., 2, n_point, n_component) of flat vectors (..., n_flat)."""
        view: Array = flat[..., self.start : self.stop].reshape(*flat.shape[:-1], 2, self.n_point, self.n_component)
        return view


class Layout:
    """Flat layout of all channels; see the module docstring."""

    def __init__(self, interfaces: Sequence[InterfaceUnit]) -> None:
        kinds: dict[tuple[type, int], list[int]] = {}
        # contact with friction and without are two groups: they have unlike numbers of components
        for i, unit in enumerate(interfaces):
            kinds.setdefault((type(unit.behaviour), unit.behaviour.n_component), []).append(i)
        self.groups: list[Group] = []
        self._group_of: dict[int, Group] = {}
        start = 0
        for (_, n_component), members in kinds.items():
            units = [interfaces[i] for i in members]
            counts = [u.geometry.n_point for u in units]
            ends = np.cumsum(counts)
            group = Group(
                units[0].behaviour,
                start,
                int(ends[-1]),
                n_component,
                np.concatenate([u.behaviour.point_parameters(n) for u, n in zip(units, counts, strict=True)]),
                np.concatenate([u.geometry.gap for u in units]),
                np.concatenate([np.full(n, u.preload) for u, n in zip(units, counts, strict=True)]),
                {i: slice(int(e) - n, int(e)) for i, n, e in zip(members, counts, ends, strict=True)},
            )
            self.groups.append(group)
            self._group_of.update(dict.fromkeys(members, group))
            start = group.stop
        self.n_flat = start
        self.area = np.zeros(start)
        self.normal = np.zeros(start, dtype=bool)
        self.interface = np.zeros(start, dtype=np.int64)  # the interface that each channel belongs to
        for group in self.groups:
            normal = group.block(self.normal)
            normal[..., 0] = True  # N comes first
            for i, points in group.members.items():
                group.block(self.area)[:, points] = interfaces[i].geometry.areas[:, None]
                self.interface[self.channels(i, 0)] = self.interface[self.channels(i, 1)] = i

    def group(self, interface: int) -> Group:
        """The group to which an interface belongs."""
        return self._group_of[interface]

    def channels(self, interface: int, side: int) -> Index:
        """Flat indices (n_point, n_component) of one side of an interface."""
        group = self._group_of[interface]
        points, width = group.members[interface], group.n_component
        first = group.start + (side * group.n_point + points.start) * width
        picked: Index = np.arange(first, first + (points.stop - points.start) * width).reshape(-1, width)
        return picked


def class_points(layout: Layout, interfaces: Sequence[InterfaceUnit], channels: Index) -> Points:
    """Points of the interfaces of a class with channels (n_channel, n_member); channels of its first member."""
    row = np.full(layout.n_flat, -1)
    row[channels[:, 0]] = np.arange(len(channels))
    positions, at = list[Array](), list[Index]()
    for i, unit in enumerate(interfaces):
        for side in (0, 1):
            places = row[layout.channels(i, side)]
            # a side belongs to one substructure: its first channel is enough
            if places[0, 0] >= 0:
                positions.append(unit.geometry.points)
                # of a frictionless interface N alone
                at.append(np.pad(places, ((0, 0), (0, 3 - places.shape[1])), constant_values=-1))
    # a class that nothing touches
    if not at:
        return Points(np.zeros((0, 3)), np.zeros((0, 3), dtype=row.dtype), np.zeros(0, dtype=row.dtype))
    return Points(np.concatenate(positions), np.concatenate(at), np.repeat(np.arange(len(at)), list(map(len, at))))


class GroundState(NamedTuple):
    """State of the ground of an interface: displacement (3,), m, and acceleration (3,), m s-2 (None at t = 0)."""

    displacement: Array
    acceleration: Array | None


class Ground:
    """The rigid ground that some interfaces meet, and its prescribed motion.

    Parameters
    ----------
    layout, interfaces : of the assembly. static : whether there is no inertia.

    Attributes
    ----------
    start : of each interface against ground, the state at the first instant.
    velocity : likewise (n_time, 3), m s-1. travel : displacement since the first instant, (n_time, 3), m, the integral
        of the velocity by trapezoids, without inertia by the increments.
    """

    def __init__(self, layout: Layout, interfaces: Sequence[InterfaceUnit], static: bool) -> None:
        self._frames = {
            i: (layout.channels(i, 1), unit.geometry.frames[:, : unit.behaviour.n_component])
            for i, unit in enumerate(interfaces)
            if unit.against_ground
        }
        self._n_flat = layout.n_flat
        self._static = static
        self._dt = 0.0
        self.start = {i: GroundState(np.zeros(3), None) for i in self._frames}
        self.velocity, self.travel = dict[int, Array](), dict[int, Array]()

    def take(self, whole: Ground, numbers: Mapping[int, int]) -> None:
        """Take over the motion of the ground of some interfaces of a ``whole`` assembly; their numbers here."""
        self._dt = whole._dt
        for name in ("start", "velocity", "travel"):
            setattr(self, name, {numbers[i]: values for i, values in getattr(whole, name).items() if i in numbers})

    def begin(self, dt: float, velocity: Mapping[int, Array], start: Mapping[int, GroundState]) -> None:
        """Set the motion in a segment; see ``Assembly.begin``."""
        self._dt, self.velocity, self.start = dt, dict(velocity), dict(start)
        # of a ground that does not move the velocity, zeros, is the travel too
        self.travel = dict(velocity)
        for i, v in velocity.items():
            if v.any():
                self.travel[i] = np.concatenate([np.zeros((1, 3)), np.cumsum(dt * self._mean(v), axis=0)])

    def _mean(self, velocity: Array) -> Array:
        """Velocity over each step: mean of both ends, without inertia that of the increment."""
        if self._static:
            return velocity[1:]
        return 0.5 * (velocity[1:] + velocity[:-1])

    @property
    def channels(self) -> Index:
        """Channels of the ground (n,)."""
        return np.concatenate([np.zeros(0, dtype=np.int64), *(where.ravel() for where, _ in self._frames.values())])

    @property
    def rests(self) -> bool:
        """Whether the ground has not moved and does not move."""
        starts = (field for state in self.start.values() for field in state if field is not None)
        return not any(field.any() for field in (*self.velocity.values(), *starts))

    def write(self, flat: Array, of: Callable[[int], Array]) -> None:
        """Write vectors of the ground, ``of(interface)`` (3,), into the channels of a flat vector."""
        for i, (channels, frames) in self._frames.items():
            # rows of the frames are N, t1, t2
            flat[channels] = frames @ of(i)

    def displacement(self, interface: int, instant: int) -> Array:
        """Displacement (3,) of the ground at an instant, m."""
        total: Array = self.start[interface].displacement + self.travel[interface][instant]
        return total

    def acceleration(self, interface: int, instant: int) -> Array:
        """Acceleration (3,) of the ground at an instant, m s-2: backward difference, at t = 0 that of the start."""
        start, velocity = self.start[interface], self.velocity[interface]
        if instant == 0 and start.acceleration is not None:
            return start.acceleration
        # without a known acceleration at t = 0 that of the first step
        i = max(instant, 1)
        slope: Array = (velocity[i] - velocity[i - 1]) / self._dt
        return slope

    def initial_acceleration(self) -> Array:
        """Flat vector with the accelerations of the ground at the first instant, 0 elsewhere."""
        flat = np.zeros(self._n_flat)
        self.write(flat, lambda i: self.acceleration(i, 0))
        return flat

    def tables(self, scheme: TimeScheme, n_time: int) -> tuple[Array, Array, Array]:
        """Velocities, displacements and accelerations (n_time, n) of the channels of the ground at all instants."""
        tables = [[np.zeros((n_time, 0))] for _ in range(3)]
        for i, (_, frames) in self._frames.items():
            displacement = self.start[i].displacement + self.travel[i]
            v = self.velocity[i]
            acceleration = np.concatenate([[self.acceleration(i, 0)], (v[1:] - v[:-1]) / self._dt])
            w = scheme.interface_velocity(displacement[:-1], displacement[1:], v[1:], self._dt)
            velocity = np.concatenate([v[:1], w])
            for table, vectors in zip(tables, (velocity, displacement, acceleration), strict=True):
                table.append(np.einsum("pci,ti->tpc", frames, vectors).reshape(n_time, -1))
        velocity, displacement, acceleration = (np.concatenate(table, axis=1) for table in tables)
        return velocity, displacement, acceleration

    def end(self, instant: int) -> dict[int, GroundState]:
        """State of the ground at an instant, for the next segment."""
        return {i: GroundState(self.displacement(i, instant), self.acceleration(i, instant)) for i in self._frames}


class NoEquilibrium(NamedTuple):
    """Loads that contact and friction cannot hold: the first instant, the time at which the equilibrium is lost, s, and
    which body moves then, how, and at which share of the loads."""

    instant: int
    time: float
    what: str


class Assembly:
    """Substructure classes and interfaces joined by index arrays.

    Parameters
    ----------
    propagators : one per class of identical substructures.
    channels : for each propagator the flat indices (n_channel, n_member).
    interfaces : of the assembly. layout : of their channels.
    impedance : (n_flat,) material impedance of the side, rho c_p or rho c_s, Pa s m-1; 0 for ground;
        of a rigid body the resistance of its face within one step; without inertia the stiffness per area of the
        side, Pa m-1.
    characteristic_traction : size of the tractions the loads can bring, Pa (scale of negligible ones).
    scheme : time scheme.
    """

    def __init__(
        self,
        propagators: Sequence[Propagator],
        channels: Sequence[Index],
        interfaces: Sequence[InterfaceUnit],
        layout: Layout,
        impedance: Array,
        characteristic_traction: float,
        scheme: TimeScheme,
    ) -> None:
        self.propagators, self.channels = list(propagators), list(channels)
        self.interfaces = list(interfaces)
        self.layout = layout
        self.scheme = scheme
        self.quasi_static = isinstance(scheme, QuasiStatic)  # there is no inertia
        self._impedance = impedance
        self.characteristic_traction = characteristic_traction
        self.rest_traction = 0.0  # substructures stay inactive up to this traction, Pa; < 0: always marched
        self.ground = Ground(layout, self.interfaces, self.quasi_static)
        self.start_tractions: dict[int, Array] = {}
        """Tractions (n_point, n_component) on side E at t = 0 where they are known, by interface, Pa; in balance with
        the initial displacements and the loads there, unless ``sets_off``."""
        self.sets_off = False  # whether bodies begin to move at t = 0 although tractions are known
        self.owner = self.part_of = tuple[int, ...]()
        """Of a run distributed over processes: for every class the process that marches it, and the number of the class
        that it is a part of."""
        self.lost: NoEquilibrium | None = None
        """Where the loads of a run without inertia lose their equilibrium, if that is known."""
        self.rigid = self._rigid_channels()

    def take_interfaces(self, whole: Assembly, interfaces: Sequence[int], channels: Index) -> None:
        """Make this copy of an assembly one of these of its interfaces, with these of its channels."""
        numbers = {i: number for number, i in enumerate(interfaces)}
        self._impedance = whole._impedance[channels]
        self.ground = Ground(self.layout, self.interfaces, self.quasi_static)
        self.ground.take(whole.ground, numbers)
        self.start_tractions = {numbers[i]: f for i, f in whole.start_tractions.items() if i in numbers}
        self.sets_off = whole.sets_off
        self.rigid = np.flatnonzero(np.isin(channels, whole.rigid))

    @property
    def swept(self) -> bool:
        """Whether interfaces of a substructure are solved with by substitution (``propagator.interface_sweeps``)."""
        return any(p.swept for p in self.propagators)

    def points_of(self, c: int) -> Points:
        """Points of the interfaces of a class."""
        return class_points(self.layout, self.interfaces, self.channels[c])

    @property
    def impedance(self) -> Array:
        """Impedance of the side of every channel (n_flat,), Pa s m-1: of its material, without inertia of its stiffness
        over an increment."""
        # stiffness per area times an increment: force per velocity over it
        if self.quasi_static:
            return self._impedance * self.dt
        return self._impedance

    def begin(self, time: Array, dt: float, ground: Mapping[int, Array], start: Mapping[int, GroundState]) -> None:
        """Set the instants of the run, or of its next segment.

        Parameters
        ----------
        time : (n_time,), s, equally spaced by dt (but for round-off).
        ground : per interface against ground, its velocity (n_time, 3), m s-1.
        start : state of that ground at the first instant.
        """
        self.time, self.dt = time, dt
        self.ground.begin(dt, ground, start)

    def _rigid_channels(self) -> Index:
        """Channels of points where a side cannot move at all (ground, or every direction held)."""
        moves = np.zeros(self.layout.n_flat, dtype=bool)
        for propagator, channels in zip(self.propagators, self.channels, strict=True):
            moves[channels] = (propagator.operators.compliance.diagonal() > 0)[:, None]
        rigid = np.zeros(self.layout.n_flat, dtype=bool)
        for group in self.layout.groups:
            group.block(rigid)[...] = ~group.block(moves).any(axis=-1, keepdims=True)
        return np.flatnonzero(rigid)

    @property
    def instant(self) -> int:
        """Time index of the present state."""
        return self.propagators[0].instant

    @property
    def n_instant(self) -> int:
        """Number of steps."""
        return len(self.time) - 1

    @property
    def n_substructure(self) -> int:
        """Number of substructures."""
        return sum(len(p.names) for p in self.propagators)

    def gather(self, per_class: Sequence[Array]) -> Array:
        """Flat vector from (n_channel, n_member) arrays of every class; ground entries 0."""
        flat = np.zeros(self.layout.n_flat)
        for channels, values in zip(self.channels, per_class, strict=True):
            flat[channels] = values
        return flat

    def owners(self) -> Index:
        """Of each channel (3, n_flat): number of its substructure, its class, its number among the live channels of the
        class; -1 for ground, and for channels that cannot move."""
        table = np.full((3, self.layout.n_flat), -1, dtype=np.int64)
        first = 0
        for c, (propagator, channels) in enumerate(zip(self.propagators, self.channels, strict=True)):
            live = propagator.operators.compliance.diagonal() != 0
            table[0][channels] = first + np.arange(channels.shape[1])
            table[1][channels] = c
            table[2][channels] = np.where(live, np.cumsum(live) - 1, -1)[:, None]
            first += channels.shape[1]
        return table

    # -- the present state ------------------------------------------------------------------------------------------
    def displacement(self) -> Array:
        """Displacement (n_flat,) of every channel that the gaps of the present state follow from, m."""
        u, instant = self.gather([channel_displacement(p) for p in self.propagators]), self.instant
        self.ground.write(u, lambda i: self.ground.displacement(i, instant))
        offset = self.scheme.gap_offset(self.dt)
        if offset and len(self.ground.channels):  # by which the displacements of the propagators are ahead
            velocity = np.zeros_like(u)
            self.ground.write(velocity, lambda i: self.ground.velocity[i][instant])
            u += offset * velocity
        return u

    def velocity(self) -> Array:
        """Velocity (n_flat,) of every channel in the present state, m s-1."""
        v, instant = self.gather([channel_velocity(p) for p in self.propagators]), self.instant
        self.ground.write(v, lambda i: self.ground.velocity[i][instant])
        return v

    def gaps(self) -> list[Array]:
        """Gap (n_point,) of each group in the present state of the substructures, m."""
        u = self.displacement()
        jumps = [group.block(u) for group in self.layout.groups]
        return [g.gap + j[1, :, 0] - j[0, :, 0] for g, j in zip(self.layout.groups, jumps, strict=True)]
