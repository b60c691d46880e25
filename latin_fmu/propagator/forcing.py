"""External forces and prescribed motions of the members of a class, instant by instant."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field
from functools import cached_property
from typing import Final

import numpy as np
import scipy.sparse as sp

from ..time_scheme import TimeScheme
from .model import Array, Histories, Index, SubstructureModel, damping_forces

MotionState = tuple[Array, Array, Array, Array]
"""Displacement, acceleration and velocity of prescribed motions at an instant, (n_motion,) each, and the elongations of
the Maxwell branches there, (n_branch, n_motion)."""
STRAIN: Final = 3
"""Place of what Maxwell branches add behind displacements, velocities and accelerations."""
SUMS: Final = ("force", "inertia", "velocity", "displacement", "acceleration", "work")
"""Sums of patterns times histories that a class may have; ``work`` : loads alone."""
_NONE: Final = np.zeros(0)
_AT_REST: Final = (_NONE, _NONE, _NONE, np.zeros((0, 0)))


@dataclass
class Sum:
    """Sum of patterns times histories: rows (row x members + member), values, and amplitude (n_time,) of each."""

    patterns: list[tuple[Index, Array]] = field(default_factory=list)
    amplitudes: list[Array] = field(default_factory=list)

    @cached_property
    def packed(self) -> tuple[Index, Index, Array]:
        """First entry of each pattern, and rows and values of all patterns; read when there are all of them."""
        starts = np.cumsum([0, *(len(rows) for rows, _ in self.patterns)])
        rows, values = (np.concatenate(parts) for parts in zip(*self.patterns, strict=True))
        return starts, rows, values

    def add(self, pattern: Array, column: int, members: int, amplitude: Array, always: bool = False) -> None:
        """Add a pattern (n,) of one member, unless it stays zero; ``always``: even then."""
        rows = np.flatnonzero(pattern)
        if len(rows) and (always or amplitude.any()):
            self.patterns.append((rows.astype(np.int64) * members + column, pattern[rows]))
            self.amplitudes.append(amplitude)


class Forcing:
    """Reduced nodal forces at each instant, prescribed motions included.

    A prescribed motion enters as known displacement, velocity and acceleration of its dofs. Velocity and acceleration
    satisfy the recursion of the time scheme, and so does the displacement of one given by velocities or accelerations.
    That of a displacement law is where the law says, while its velocity at an instant is the mean of the rates before
    and after it: the recursion for given places would alternate for ever after a corner. The account of energies takes
    the step of the recursion where inertia works (``kernels.energy``), so that it closes all the same.
    """

    def __init__(self, members: Sequence[SubstructureModel], scheme: TimeScheme) -> None:
        self.members = list(members)
        self._scheme = scheme
        self.n_full = members[0].n_full
        self._n = members[0].expansion.shape[1]
        self._reduced = []  # per member and load: the pattern, and its rows and values for the kernels
        for column, member in enumerate(members):
            dofs = [np.flatnonzero(p).astype(np.int64) for p in member.reduced_loads]
            patterns = zip(member.reduced_loads, dofs, strict=True)
            self._reduced.append([(p, (where * len(members) + column, p[where])) for p, where in patterns])
        self._loads: dict[tuple[tuple[int, int], ...], Sum] = {}  # by member and number of the loads that vary
        self._motion = [_Motion(m, scheme) if m.imposed_pattern.shape[1] else None for m in members]
        self.moves = any(m is not None for m in self._motion)
        self._zero = np.zeros((self.n_full, len(members)))
        self.n_time = 0  # instants of the segment
        self.amplitudes: list[list[Array]] = [[] for _ in members]  # (n_time,) of each load of a member
        self.sources: frozenset[str] | None = None
        """Names of the loads that get terms of the sums whatever their histories are, and only they; prescribed motions
        get all of theirs. None: what varies does."""

    def begin(self, histories: Sequence[Histories], dt: float) -> None:
        """Set what drives the members over the instants of a run or segment; motions go on where they are."""
        self.n_time = len(histories[0].time)
        self.amplitudes = [history.amplitudes for history in histories]
        self._constant = np.zeros((self._n, len(self.members)))
        varying: dict[tuple[int, int], Array] = {}
        for column, (loads, history) in enumerate(zip(self._reduced, histories, strict=True)):
            names = [load.name for load in self.members[column].loads]
            for k, ((pattern, (rows, _)), amplitude) in enumerate(zip(loads, history.amplitudes, strict=True)):
                if self.sources is None:
                    constant = (amplitude == amplitude[0]).all()
                else:
                    constant = names[k] not in self.sources
                if constant:
                    self._constant[:, column] += pattern * amplitude[0]
                elif len(rows):
                    varying[column, k] = amplitude
        self._varying_loads = tuple(varying)
        # one sum per choice of varying loads: its patterns are packed once for all segments
        if self._varying_loads not in self._loads:
            self._loads[self._varying_loads] = Sum([self._reduced[column][k][1] for column, k in varying])
        self._varying = self._loads[self._varying_loads]
        self._varying.amplitudes = list(varying.values())
        for motion, history in zip(self._motion, histories, strict=True):
            if motion is not None:
                motion.begin(history.imposed, history.motion_kinds, dt)

    @property
    def kind(self) -> tuple[bool, tuple[tuple[int, int], ...]] | None:
        """Whether there are constant loads, and which loads vary (by member and number); None where more than the
        amplitudes of these at the instants goes into the sums."""
        if self.moves or self._scheme.explicit:
            return None
        return (bool(self._constant.any()), self._varying_loads)

    def loads_over_time(self) -> tuple[Array, Sum]:
        """Constant loads (n, n_member), N, and those that vary."""
        return self._constant, self._varying

    def motion_state(self, instant: int) -> list[MotionState]:
        """State of the prescribed motions of each member at an instant, for the next segment."""
        return [_AT_REST if m is None else m.at(instant) for m in self._motion]

    def set_motion_state(self, motions: Sequence[MotionState | None]) -> None:
        """Where the prescribed motions go on from (``motion_state`` of the segment before); None: from their start."""
        for motion, start in zip(self._motion, motions, strict=True):
            if motion is not None:
                motion.start = start

    def loads(self, instant: int) -> Array:
        """Reduced loads (n, n_member) at an instant, prescribed motions not included, N (a fresh array)."""
        force = self._constant.copy()
        for (rows, values), history in zip(self._varying.patterns, self._varying.amplitudes, strict=True):
            force.reshape(-1)[rows] += history[instant] * values
        return force

    def at(self, instant: int) -> Array:
        """Reduced external forces (n, n_member) at an instant, N (a fresh array).

        Prescribed motions act through C and K here; their inertia (``inertia``) is not a force of the scheme.
        """
        elastic, viscous = self.parts(instant)
        return elastic - viscous

    def parts(self, instant: int) -> tuple[Array, Array]:
        """Loads less what K of prescribed motions exerts on the free dofs, and what C of them does, (n, n_member), N
        (fresh arrays)."""
        elastic = self.loads(instant)
        viscous = np.zeros_like(elastic)
        for column, motion in enumerate(self._motion):
            if motion is not None:
                elastic[:, column] -= motion.reduced_elastic(instant)
                viscous[:, column] = motion.reduced_viscous(instant)
        return elastic, viscous

    def inertia(self, instant: int) -> Array | None:
        """M a of the prescribed motions on the free dofs (n, n_member), N; None when there are none."""
        if not self.moves:
            return None
        zero = np.zeros(self._constant.shape[0])
        return np.stack([zero if m is None else m.reduced_inertia(instant) for m in self._motion], axis=1)

    def sums(self, trace: sp.csr_array, dashpots: sp.csr_array | None = None) -> tuple[Array, dict[str, Sum]]:
        """What ``at``, ``inertia``, ``loads`` and the channels compute, in parts for the kernels.

        Parameters
        ----------
        trace : (n_channel, n_full) of the class. dashpots : lumped damping (n_full, n_full) of an explicit class.

        Returns
        -------
        Constant force (n, n_member), and those of the ``SUMS`` that are not empty. In an explicit scheme the forces
        that drive the step to an instant are the mean of the loads over it, and those of motions in the middle of it.
        """
        members, loads = len(self.members), self._varying
        sums = {"force": loads, "work": loads}
        if self._scheme.explicit:
            sums["force"] = Sum(loads.patterns, [_mean_over_steps(amplitude) for amplitude in loads.amplitudes])
        if not self.moves:
            return self._constant, sums
        sums = {name: sums.get(name, Sum()) for name in SUMS}
        # lists of its own: motions are no loads, while ``work`` goes on with those of the loads
        sums["force"] = Sum(list(sums["force"].patterns), list(sums["force"].amplitudes))
        for column, (motion, member) in enumerate(zip(self._motion, self.members, strict=True)):
            if motion is not None:
                lumped = None
                if dashpots is not None:
                    lumped = member.expansion.T @ (dashpots @ motion.pattern)
                motion.add_to(sums, trace @ motion.pattern, (column, members), lumped, self.sources is not None)
        return self._constant, sums

    def motion_table(self) -> Array:
        """Displacements, velocities, accelerations and elongations of the branches of the prescribed motions,
        (3 + n_branch, n_time, n_motion, n_member)."""
        tables = [np.stack([*m.histories, *m.elongations]) for m in self._motion if m is not None]
        return np.stack(tables, axis=-1)

    def motion_histories(self, member: int) -> tuple[Array, ...] | None:
        """Displacements, velocities and accelerations (n_time, n_motion) of the prescribed motions of a member, with
        Maxwell branches what these add to the displacements; None where it has none."""
        motion = self._motion[member]
        if motion is None or not len(motion.branches):
            if motion is None:
                return None
            return motion.histories
        return *motion.histories, np.tensordot(motion.branches.strengths, motion.elongations, 1)

    def imposed_u(self, instant: int) -> Array:
        """Prescribed displacements, (n_full, n_member), m."""
        return self._imposed(instant, 0)

    def imposed_v(self, instant: int) -> Array:
        """Prescribed velocities, m s-1."""
        return self._imposed(instant, 1)

    def imposed_a(self, instant: int) -> Array:
        """Prescribed accelerations, m s-2."""
        return self._imposed(instant, 2)

    def _imposed(self, instant: int, kind: int) -> Array:
        if not self.moves:
            return self._zero
        columns = [self._zero[:, 0] if m is None else m.full(instant, kind) for m in self._motion]
        return np.stack(columns, axis=1)

    def channel_displacement(self, instant: int) -> Array | None:
        """Part of the channel displacements that prescribed motions bring; None when there are none."""
        if self.moves:
            return self.members[0].trace @ self.imposed_u(instant)
        return None

    def channel_velocity(self, instant: int) -> Array | None:
        """Part of the channel velocities that prescribed motions bring; None when there are none."""
        if self.moves:
            return self.members[0].trace @ self.imposed_v(instant)
        return None


def _mean_over_steps(amplitude: Array) -> Array:
    """Mean over the step that ends at each instant."""
    mean: Array = np.concatenate([amplitude[:1], 0.5 * (amplitude[1:] + amplitude[:-1])])
    return mean


def _numbers(kinds: Sequence[str], kind: str) -> Index:
    """Numbers of the motions of a kind."""
    return np.array([k for k, found in enumerate(kinds) if found == kind], dtype=np.int64)


class _Motion:
    """Prescribed motions of one member: histories consistent with the time scheme."""

    def __init__(self, member: SubstructureModel, scheme: TimeScheme) -> None:
        self.pattern = member.imposed_pattern
        self._scheme = scheme
        self.branches = member.branches.marched(scheme)
        self.start: MotionState | None = None
        self._initial = member.imposed_start
        if member.imposed_speed is None:
            self._speed = np.zeros(len(self._initial))
        else:
            self._speed = member.imposed_speed
        reduce = member.expansion.T
        self._mass, self._unrelaxed = None, None
        if member.mass is not None:
            self._mass = reduce @ (member.mass @ self.pattern)
        self._stiffness = reduce @ (member.stiffness @ self.pattern)
        if member.unrelaxed is not None and len(member.branches):
            self._unrelaxed = reduce @ (member.unrelaxed @ self.pattern)
        self._damping = damping_forces(member, self.pattern)
        if self._damping is not None:
            self._damping = reduce @ self._damping

    def begin(self, drive: Array, kinds: Sequence[str], dt: float) -> None:
        """Histories from what drives the motions, (n_time, n_motion), of these kinds (``Histories``)."""
        forced, placed = (_numbers(kinds, kind) for kind in ("acceleration", "displacement"))
        scheme = self._scheme
        pushed = drive[:, forced]
        rates = drive[:, placed]
        v = drive.copy()
        if scheme.operator(dt)[0] == 0.0:
            # increments of load have the velocity of the step
            v[0, placed], v[1:, placed] = 0.0, rates[:-1]
        else:
            v[1:, placed] = 0.5 * (rates[:-1] + rates[1:])
        u, a = np.zeros_like(v), np.zeros_like(v)
        # a first guess of the acceleration, which only the recursion of the next instant reads
        u[0], a[0] = self._initial, (v[1] - v[0]) / dt
        v[0, forced], a[0, forced] = self._speed[forced], pushed[0]
        if self.start is not None:
            integrated = np.concatenate([forced, placed])
            u[0], a[0], v[0, integrated] = *self.start[:2], self.start[2][integrated]
        for i in range(len(v) - 1):
            u_free, v_free = scheme.predict(u[i], v[i], a[i], dt)
            # from given velocities: a that makes v follow the recursion of the scheme, so that its energy identity
            # holds
            a[i + 1] = scheme.invert_velocity(a[i], v[i + 1] - v[i], dt)
            if len(forced):
                # from given accelerations: those of a free body, whose velocity follows
                a[i + 1, forced] = scheme.free_acceleration(a[i, forced], pushed[i], pushed[i + 1])
                v[i + 1, forced] = v_free[forced] + scheme.velocity_gain(dt) * a[i + 1, forced]
            u[i + 1] = u_free + scheme.displacement_gain(dt) * a[i + 1]
            u[i + 1, placed] = u[i, placed] + dt * rates[i]
        self.histories = (u, v, a)
        self._dt = dt
        self._strain(u, v, dt)

    def _strain(self, u: Array, v: Array, dt: float) -> None:
        """Elongations (n_branch, n_time, n_motion) of the branches, and the displacements (n_time, n_motion) that K
        takes (``kernels.maxwell``); of explicit schemes in the middle of the step that ends at each instant."""
        explicit, branches = self._scheme.explicit, self.branches
        if not explicit:
            middle = u
        else:
            middle = np.concatenate([u[:1], u[:-1] + 0.5 * dt * v[:-1]])
        self.elongations = np.zeros((len(branches), *u.shape))
        if self.start is not None:
            self.elongations[:, 0] = self.start[3]
        strains = np.zeros_like(u)
        strains[0] = np.tensordot(branches.strengths, self.elongations[:, 0], 1)
        weights = branches.weights(self._scheme, dt)[:3]
        for strength, c_e, c_u, elongation in zip(*weights, self.elongations, strict=True):
            for i in range(len(u) - 1):
                reached = c_e * elongation[i] + c_u * (middle[i + 1] - u[i])
                strains[i + 1] += strength * reached
                if explicit:
                    reached = c_e * reached + c_u * (u[i + 1] - middle[i + 1])
                elongation[i + 1] = reached
        self._strained, self._strains = middle + strains, strains

    def at(self, instant: int) -> MotionState:
        u, v, a = self.histories
        return u[instant], a[instant], v[instant], self.elongations[:, instant]

    def reduced_inertia(self, instant: int) -> Array:
        assert self._mass is not None, "a motion without inertia"
        force: Array = self._mass @ self.histories[2][instant]
        return force

    def reduced_elastic(self, instant: int) -> Array:
        force: Array = self._stiffness @ self._strained[instant]
        if self._unrelaxed is not None:
            force = force - self._unrelaxed @ self._strains[instant]
        return force

    def reduced_viscous(self, instant: int) -> Array | float:
        if self._damping is None:
            return 0.0
        force: Array = self._damping @ self.histories[1][instant]
        return force

    def add_to(
        self, sums: dict[str, Sum], at_channels: Array, of: tuple[int, int], lumped: Array | None, always: bool
    ) -> None:
        """Add the parts of this motion; ``at_channels`` (n_channel, n_motion) its shapes at the channels, ``of`` number
        of the member and of all, ``lumped`` (n, n_motion) the lumped damping of an explicit class on them, ``always``
        as for ``Sum.add``."""
        u, v, a = self.histories
        w = np.concatenate([v[:1], self._scheme.interface_velocity(u[:-1], u[1:], v[1:], self._dt)])
        before, step = v, np.zeros_like(v)
        if self._scheme.explicit:
            # leapfrog: K acts on x in the middle of the step, C on v at its start
            before = np.concatenate([v[:1], v[:-1]])
            # C_d acts at the mean velocity of the step: half the change comes on top of C v
            step = 0.5 * (v - before)
        for k in range(self.pattern.shape[1]):
            sums["force"].add(-self._stiffness[:, k], *of, self._strained[:, k], always)
            if self._unrelaxed is not None:
                sums["force"].add(self._unrelaxed[:, k], *of, self._strains[:, k], always)
            if self._damping is not None:
                sums["force"].add(-self._damping[:, k], *of, before[:, k], always)
            if lumped is not None:
                sums["force"].add(-lumped[:, k], *of, step[:, k], always)
            # the lumped mass of driven dofs does not couple with others
            if self._mass is not None and not self._scheme.explicit:
                sums["inertia"].add(self._mass[:, k], *of, a[:, k], always)
            sums["velocity"].add(at_channels[:, k], *of, w[:, k], always)
            sums["displacement"].add(at_channels[:, k], *of, u[:, k], always)
            sums["acceleration"].add(at_channels[:, k], *of, a[:, k], always)

    def full(self, instant: int, kind: int) -> Array:
        moved: Array = self.pattern @ self.histories[kind][instant]
        return moved
