"""Direct solution of the interface problem of one instant: perfect interfaces at once, others point by point.

Perfect interfaces: with v = v_free + D lambda on every side, equal velocities and opposite forces of both sides are the
linear system

    S x = v'_free - v_free,    S = D + D' assembled over all interfaces (symmetric, constant),

x the nodal forces on sides E. S is factorised once. Redundant bonds (an edge where four bodies meet) make the system
singular but leave it consistent: a shift of 1e-10 of its diagonal and iterative refinement give a solution of the
original system.

Point by point, block Gauss-Seidel: for instants in which the iteration does not converge (a point held by several
interfaces with large friction, a soft light body under a step far longer than its transit, a search direction far from
the impedances). The condensed problem of the instant,

    v = v_free + sum over points of D_p f_p        D the admittance of one instant, all substructures
    f_p := behaviour(v' - v without the share of f_p), z = D_pp of both sides,

is solved for one point after the other, and v is corrected after each of them: the non-smooth contact dynamics
iteration of Jean and Moreau, with the local stage of the LATIN method as its law. It is slower than the LATIN iteration
and has no parameters; the LATIN iteration continues from its result and decides on convergence.
"""

from __future__ import annotations

from collections.abc import Sequence, Set
from dataclasses import dataclass

import numpy as np
import scipy.linalg as la
import scipy.sparse as sp

from ..cholesky.factor import CholeskyFactor
from ..interface.laws import coulomb_coefficient
from .assembly import Array, Assembly, Group, Index

_SHIFT = 1e-10  # of the diagonal of S
_PRECISE, _REFINEMENTS = 1e-13, 8  # jump left over the largest velocity; steps of the refinement
_CONSISTENT = 1e-8  # jump left for a unit jump, above which redundant bonds need the refinement
_DENSE = 1500  # interface unknowns up to which the solution is one dense operator
_LARGEST = 200_000_000  # entries of S (an upper bound) up to which its factorisation pays


def pays(assembly: Assembly) -> bool:
    """Whether there are interfaces, with dense matrices, and S has at most 2e8 entries."""
    entries = sum(int(c.shape[0]) ** 2 * int(c.shape[1]) for c in assembly.channels)
    return bool(assembly.interfaces) and not assembly.swept and entries <= _LARGEST


class PerfectInterfaceSolve:
    """The perfect interfaces of an assembly as one linear system, for its present time step."""

    def __init__(self, assembly: Assembly) -> None:
        self.assembly = assembly
        every = range(len(assembly.interfaces))
        self._first, self._second = (
            np.concatenate([assembly.layout.channels(i, side).ravel() for i in every]) for side in (0, 1)
        )
        self._area = assembly.layout.area[self._first]
        self._matrix = self._assemble()
        diagonal = self._matrix.diagonal()
        # redundant interfaces stay regular by the shift, which the refinement takes out again; 1 where nothing can move
        shift = np.where(diagonal > 0, _SHIFT * diagonal, 1.0)
        none = np.zeros(0, dtype=np.int64)
        self._factor = CholeskyFactor(sp.csr_array(self._matrix + sp.diags_array(shift)), none)

    def _assemble(self) -> sp.csr_array:
        """S: velocities per nodal force, m s-1 N-1."""
        n_flat, n = self.assembly.layout.n_flat, len(self._first)
        # both sides of a channel are one unknown, the force on E; on E' it has the other sign
        row, sign = np.empty(n_flat, dtype=np.int64), np.ones(n_flat)
        row[self._first] = row[self._second] = np.arange(n)
        sign[self._second] = -1.0
        parts: list[tuple[Array, Array, Array]] = []
        for propagator, channels in zip(self.assembly.propagators, self.assembly.channels, strict=True):
            compliance = propagator.operators.compliance
            for member in channels.T:
                block = compliance * sign[member] * sign[member][:, None]
                parts.append((np.repeat(row[member], len(member)), np.tile(row[member], len(member)), block.ravel()))
        rows, columns, values = (np.concatenate(part) for part in zip(*parts, strict=True))
        return sp.coo_array((values, (rows, columns)), shape=(n, n)).tocsr()

    def tractions(self, free: Array) -> Array:
        """Tractions (n_flat,) that close the jumps of the velocities ``free`` (n_flat,)."""
        jump = free[self._second] - free[self._first]
        force, residual = np.zeros_like(jump), jump
        largest = float(np.abs(free).max(initial=0.0))
        for _ in range(_REFINEMENTS):
            if np.abs(residual).max(initial=0.0) <= _PRECISE * largest:
                break
            force = force + self._factor.solve(residual[:, None])[:, 0]
            residual = jump - self._matrix @ force
        traction = np.zeros_like(free)
        traction[self._first], traction[self._second] = force / self._area, -force / self._area
        return traction

    def incoming(self, k: Array) -> Array | None:
        """Operator (n_flat, n_flat) from the velocities without traction to q = F + k W of the solution, for the
        compiled driver; None where it is too large, or inexact because of redundant bonds."""
        n_flat = len(k)
        if n_flat > _DENSE:
            return None
        jump = np.zeros((len(self._first), n_flat))
        jump[np.arange(len(self._first)), self._second] = 1.0
        jump[np.arange(len(self._first)), self._first] = -1.0
        force = self._factor.solve(jump)
        force += self._factor.solve(jump - self._matrix @ force)
        # written so that NaN is not consistent
        if not np.abs(self._matrix @ force - jump).max(initial=0.0) <= _CONSISTENT:
            return None
        traction = np.zeros((n_flat, n_flat))
        traction[self._first], traction[self._second] = (force / self._area[:, None], -force / self._area[:, None])
        velocity = np.eye(n_flat)
        for propagator, channels in zip(self.assembly.propagators, self.assembly.channels, strict=True):
            for member in channels.T:
                velocity[member] += propagator.operators.admittance @ traction[member]
        return traction + k[:, None] * velocity

    def guess(self, free: Array, k: Array) -> Array:
        """First guess q = F + k W (n_flat,) from the velocities ``free`` without tractions: the solution itself."""
        traction = self.tractions(free)
        velocity = free.copy()
        for propagator, channels in zip(self.assembly.propagators, self.assembly.channels, strict=True):
            velocity[channels] += propagator.operators.admittance @ traction[channels]
        q: Array = traction + k * velocity
        return q


_SWEEPS, _WORK = 300, 100_000  # sweeps, and sweeps x points, at most
_DEPENDENT = 1e-10  # singular values below this share of the largest are round-off
_EXACT = 1e-9  # of the largest traction: what a law may miss
_ENOUGH = 1e-7  # relative change of the tractions in a sweep that ends the iteration


@dataclass(frozen=True)
class _Side:
    """One side of a point: its flat channels, the substructure's channels and the columns of its admittance."""

    channels: Index
    neighbours: Index
    columns: Array


@dataclass(frozen=True)
class _Point:
    """One interface point: its place, its sides and its z."""

    group: Group
    group_index: int
    index: int
    sides: tuple[_Side, _Side]
    z: Array  # (1, 2) normal, tangential


class PointByPoint:
    """Gauss-Seidel over the interface points of an assembly.

    Parameters
    ----------
    admittances : per class, (n_channel, n_channel), instead of those of one instant (of accelerations, say).
    points : groups and numbers of the points to solve, all where None.
    """

    def __init__(
        self, assembly: Assembly, admittances: Sequence[Array] | None = None, points: Set[tuple[int, int]] | None = None
    ) -> None:
        self.assembly = assembly
        if admittances is None:
            admittances = [p.operators.admittance for p in assembly.propagators]
        self._admittances = list(admittances)
        self._owner: dict[int, tuple[int, int, int]] = {}
        for c, channels in enumerate(assembly.channels):
            for (row, member), flat in np.ndenumerate(channels):
                self._owner[int(flat)] = (c, row, member)
        self._points = [
            point
            for g, group in enumerate(assembly.layout.groups)
            for p in range(group.n_point)
            # without z neither side can move, and the traction is not determined
            if (points is None or (g, p) in points) and (point := self._point(g, group, p)).z.any()
        ]

    @property
    def channels(self) -> Index:
        """Flat channels of the points, both sides."""
        sides = [side.channels for point in self._points for side in point.sides]
        return np.concatenate([np.zeros(0, dtype=np.int64), *sides])

    def _side(self, channels: Index) -> _Side:
        """One side of a point with these flat channels; without admittance on the ground."""
        # the ground has no owner, and no admittance
        if int(channels[0]) not in self._owner:
            return _Side(channels, np.zeros(0, dtype=np.int64), np.zeros((0, len(channels))))
        c, _, member = self._owner[int(channels[0])]
        rows = [self._owner[int(flat)][1] for flat in channels]
        columns = self._admittances[c][:, rows]
        return _Side(channels, self.assembly.channels[c][:, member], columns)

    def _point(self, g: int, group: Group, p: int) -> _Point:
        """Point p of a group."""
        numbers = np.arange(group.start, group.stop).reshape(2, group.n_point, group.n_component)
        sides = self._side(numbers[0, p]), self._side(numbers[1, p])
        z = np.zeros(group.n_component)
        for side in sides:
            for component, flat in enumerate(side.channels):
                # the diagonal of both sides: z of one instant
                z[component] += side.columns[side.neighbours == flat, component].sum()
        return _Point(group, g, p, sides, np.array([[z[0], z[1:].max(initial=0.0)]]))

    def solve(self, free: Array, f_hat: Array, gaps: list[Array], rates: tuple[float, float]) -> tuple[Array, Array]:
        """Tractions and velocities (n_flat,) from the velocities ``free`` without tractions and a first guess of the
        tractions; ``gaps`` the normalised gaps per group and ``rates`` (of elastic behaviours the second): see
        ``interface.laws``."""
        f, v = f_hat.copy(), free.copy()
        for admittance, channels in zip(self._admittances, self.assembly.channels, strict=True):
            v[channels] += admittance @ f[channels]
        # a bound on the work, whatever the number of points
        for _ in range(min(_SWEEPS, _WORK // max(len(self._points), 1) + 1)):
            before = f.copy()
            for point in self._points:
                self._solve_point(point, f, v, gaps, rates)
            if np.linalg.norm(f - before) <= _ENOUGH * np.linalg.norm(f):
                break
        return f, v

    def as_it_stands(self, free: Array, f_hat: Array, gaps: list[Array], rates: tuple[float, float]) -> Array | None:
        """Tractions (n_flat,) of ``solve`` where every pressed point of ``f_hat`` stays closed, and sticks where it has
        friction; None where that breaks a law. ``free`` : velocities under the tractions ``f_hat``. A linear function
        of these, which ``solve`` is to the tolerance of its sweeps only."""
        contacts = [(*point.sides, component) for point in self._points for component in self._held(point, f_hat)]
        f, v = f_hat.copy(), free.copy()
        if contacts:
            first = np.array([side.channels[component] for side, _, component in contacts])
            second = np.array([side.channels[component] for _, side, component in contacts])
            moved = np.zeros((len(free), len(contacts)))
            for column, (one, other, component) in zip(moved.T, contacts, strict=True):
                column[one.neighbours] += one.columns[:, component]
                column[other.neighbours] -= other.columns[:, component]
            # points that are held to each other leave it singular, and consistent
            step = la.lstsq(moved[second] - moved[first], v[first] - v[second], cond=_DEPENDENT)[0]
            f[first] += step
            f[second] -= step
            v += moved @ step
        largest = float(np.abs(f).max(initial=0.0))
        for point in self._points:
            off = self._local(point, f, v, gaps, rates) - f[point.sides[0].channels]
            if np.abs(off).max() > _EXACT * largest:
                return None
        return f

    @staticmethod
    def _held(point: _Point, f_hat: Array) -> range:
        """Components of a point along which a pressed one does not move."""
        channels = point.sides[0].channels
        if not f_hat[channels[0]] < 0.0:
            return range(0)
        if coulomb_coefficient(point.group.behaviour) == 0.0:
            return range(1)
        return range(len(channels))

    @staticmethod
    def _local(point: _Point, f: Array, v: Array, gaps: list[Array], rates: tuple[float, float]) -> Array:
        """Traction of the law of one point, that of all others held."""
        first, second = (side.channels for side in point.sides)
        group, old = point.group, f[first]
        z = np.where(np.arange(len(old)) == 0, point.z[0, 0], point.z[0, 1])
        gap = gaps[point.group_index][point.index : point.index + 1]
        elastic = group.behaviour.elastic
        if not elastic:
            gap = gap.reshape(-1)
        new: Array = group.behaviour.local(
            # v has the share of the old traction: z f is taken out again
            (v[second] - v[first] + z * old)[None],
            point.z,
            gap,
            rates[int(elastic)],
            group.parameters[point.index : point.index + 1],
        )[0]
        return new

    def _solve_point(self, point: _Point, f: Array, v: Array, gaps: list[Array], rates: tuple[float, float]) -> None:
        """Solve one point with the tractions of all others held; updates f and v."""
        first, second = (side.channels for side in point.sides)
        new = self._local(point, f, v, gaps, rates)
        step = new - f[first]
        if step.any():
            f[first], f[second] = new, -new
            # f acts on E, -f on E'
            for side, sign in zip(point.sides, (1.0, -1.0), strict=True):
                v[side.neighbours] += sign * (side.columns @ step)
