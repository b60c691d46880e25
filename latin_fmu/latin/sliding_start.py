"""First guess of an increment without inertia in which bodies slide far, by Newton's method on all relative motions.

Where points slip much farther than the bodies strain, the springs k of the search direction are far stiffer than what
friction lets through: the direction of slip turns little in an iteration, and bodies between two sliding faces find
their place in thousands of them. Tangential springs of the size of the friction,

    k_t = |F_t| / |slip|        at points that slip,

make the residual of the laws as a function of q nearly linear there. With the response of the assembly to q = F + k W
at its contact points,

    w = w_0 + R q,    R = T (K + T^T a k T)^-1 T^T a    (velocities, per traction)

one matrix for all of them, Newton's method on F_hat - F = 0 takes the derivatives of the laws by differences
(semismooth: Alart and Curnier, Comput. Methods Appl. Mech. Engrg. 92, 1991, for laws of contact). Rounds of a few
accelerated iterations, Newton steps and new springs are made until the laws are met. What is found is a first guess:
the iteration with its own springs certifies it.
"""

from __future__ import annotations

from typing import Any, Final

import numpy as np
import scipy.linalg as la

from ..laws.maxwell_joint import MaxwellJoint
from ..propagator.interface_sweeps import applied
from .assembly import Array, Index
from .run_image import Stages

LARGEST: Final = 1500
"""Relative motions up to which it is made: the matrix is dense."""
_ROUNDS: Final = 40
# of a round
_ITERATIONS = 150
_DEPTHS: Final = (8, 5, 12)  # of the acceleration, in turn where rounds end without an answer
_STEPS = 25
_CLOSER: Final = 1e-2  # than the tolerance of the run
_ROUND_OFF: Final = 1e-12
_SOFTEST: Final = 1e-5  # of the springs of the search direction
_LEAST: Final = 1e-3  # of the largest shear, which counts at points that open
_SHORTEST: Final = 1e-2  # share of a Newton step
_DIFFERENCE: Final = 1e-7  # of the largest velocity: step of the derivatives of the laws


def suits(stages: Stages) -> bool:
    """Whether the increment is one of a whole assembly whose relative motions have a matrix."""
    assembly = stages.direction.assembly
    if not all(p.joined for p in assembly.propagators) or len(assembly.propagators) != 1:
        return False
    relaxing = any(isinstance(g.behaviour, MaxwellJoint) for g in assembly.layout.groups)
    return not relaxing and 0 < assembly.propagators[0].n_channel <= LARGEST


class SlidingStart:
    """The increment that begins at the state of ``stages``, after an iteration that has not converged.

    Attributes
    ----------
    q : (n,) of the relative motions. k : (n,) springs of the present round, Pa s m-1.
    """

    def __init__(self, stages: Stages, f_hat: Array) -> None:
        stages.free_motion()
        direction = stages.direction
        assembly, image = direction.assembly, stages.image
        (propagator,) = assembly.propagators
        self._channels: Index = assembly.channels[0][:, 0]
        number = np.full(image.n_flat, -1)
        number[self._channels] = np.arange(len(self._channels))
        self._groups = assembly.layout.groups
        self._numbers = [
            number[g.start : g.start + g.n_point * g.n_component].reshape(g.n_point, -1) for g in self._groups
        ]
        self._reach = [stages.reach(g) for g in range(len(self._groups))]
        rates = stages.rates()
        self._rates = [rates[int(g.behaviour.elastic)] for g in self._groups]
        w = image.field("w", image.n_flat).copy()
        self._far = [g.block(w + stages.made_up())[1] for g in self._groups]
        ops = propagator.operators
        area = ops.area
        self._free, self._area = w[self._channels], area
        if propagator.swept:
            response = applied(ops.factor, ops.trace, ops.compliance.gain, np.diag(area))
        else:
            response = ops.admittance
        self._response: Array = response
        # of the run, one for both tangents
        self._springs: Array = direction.k[self._channels]
        self._metric = np.sqrt(area / np.maximum(self._springs, np.finfo(float).tiny))
        self.q: Array = f_hat[self._channels].copy()
        self._bind(self._springs.copy())

    # -- a round ---------------------------------------------------------------------------------------------------
    def _bind(self, k: Array) -> None:
        """Take springs k: w = (1 + Y (k - k_0))^-1 (w_0 + Y q), Y the response on k_0."""
        self.k, self._z = k, np.divide(1.0, k, out=np.zeros_like(k), where=k > 0.0)
        system = np.eye(len(k)) + self._response * (k - self._springs)
        both = la.solve(system, np.column_stack([self._free, self._response]), check_finite=False)
        self._w0, self._r = both[:, 0], np.ascontiguousarray(both[:, 1:])

    def _laws(self, jump: Array) -> Array:
        """Tractions (n,) by the laws, from velocities s' - s (n,)."""
        out = np.empty_like(jump)
        for group, channels, reach, rate in zip(self._groups, self._numbers, self._reach, self._rates, strict=True):
            z = self._z[channels[:, [0, min(1, channels.shape[1] - 1)]]]
            if group.behaviour.elastic:
                distance = reach
            else:
                distance = reach[:, 0]
            out[channels] = group.behaviour.local(
                jump[channels], np.ascontiguousarray(z), distance, rate, group.parameters
            )
        return out

    def _jump(self, free: Array) -> Array:
        """s' - s (n,)."""
        jump = np.empty_like(free)
        for channels, far in zip(self._numbers, self._far, strict=True):
            jump[channels] = far - free[channels]
        return jump

    def _tangents(self, jump: Array, base: Array) -> Array:
        """Derivatives (n, n) of the tractions by the velocities s of side E; blocks of points."""
        tangents, step = np.zeros((len(jump), len(jump))), _DIFFERENCE * float(np.abs(jump).max(initial=0.0))
        if step == 0.0:
            return tangents
        for c in range(3):
            moved = jump.copy()
            parts = [channels[:, c] for channels in self._numbers if channels.shape[1] > c]
            for part in parts:
                moved[part] += step
            change = (self._laws(moved) - base) / step
            for channels in self._numbers:
                if channels.shape[1] <= c:
                    continue
                for a in range(channels.shape[1]):
                    tangents[channels[:, a], channels[:, c]] = -change[channels[:, a]]
        return tangents

    def _look(self, q: Array) -> tuple[Array, Array, Array, float]:
        """s, F_hat, F_hat - F, and its size over that of F_hat, for q."""
        w = self._w0 + self._r @ q
        f = q - self.k * w
        free = w - self._z * f
        f_hat = self._laws(self._jump(free))
        size = float(np.linalg.norm(self._metric * f_hat))
        apart = float(np.linalg.norm(self._metric * (f_hat - f)))
        if size > 0.0:
            return free, f_hat, f_hat - f, apart / size
        return free, f_hat, f_hat - f, np.inf * (apart > 0.0)

    def _iterated(self, enough: float, depth: int) -> float:
        """A few iterations with acceleration of this depth; the residual at their end."""
        scale = np.sqrt(self._area * self._z)
        qs = list[Array]()
        rests = list[Array]()
        error = np.inf
        for _ in range(_ITERATIONS):
            _, _, apart, error = self._look(self.q)
            if not error > enough:
                break
            qs.append(scale * self.q)
            # F_hat + k W_hat - q
            rests.append(2.0 * scale * apart)
            del qs[: -depth - 1], rests[: -depth - 1]
            new = qs[-1] + rests[-1]
            if len(qs) > 1:
                changes, steps = np.diff(np.stack(rests, axis=1)), np.diff(np.stack(qs, axis=1))
                new = new - (steps + changes) @ np.linalg.lstsq(changes, rests[-1], rcond=1e-10)[0]
            self.q = new / scale
        return error

    def _stepped(self, enough: float) -> float:
        """Newton steps from q, which becomes the best of their ends; the residual there."""
        q, best = self.q, np.inf
        for _ in range(_STEPS):
            free, f_hat, apart, error = self._look(q)
            if error < best:
                best, self.q = error, q
            if not best > enough:
                break
            tangents = self._tangents(self._jump(free), f_hat)
            moved = 2.0 * self._r
            moved[np.diag_indices_from(moved)] -= self._z
            matrix = tangents @ moved + self.k[:, None] * self._r
            matrix[np.diag_indices_from(matrix)] -= 1.0
            step, share = self._solved(matrix, -apart), 1.0
            while share > _SHORTEST and not self._look(q + share * step)[3] <= (1.0 - 1e-4 * share) * error:
                share *= 0.5
            q = q + share * step
        return best

    def _solved(self, matrix: Array, rest: Array) -> Array:
        """Solution in the norm of the residual; the smallest one where there are many."""
        scaled = self._metric[:, None] * matrix / self._metric
        solution: Array = np.linalg.lstsq(scaled, self._metric * rest, rcond=1e-13)[0] / self._metric
        return solution

    def _adapt(self) -> None:
        """Springs of the size of the friction, with q of the same fields."""
        free, f_hat, _, _ = self._look(self.q)
        moved, k = free + self._z * f_hat, self._springs.copy()
        for channels, far in zip(self._numbers, self._far, strict=True):
            if channels.shape[1] < 3:
                continue
            shear = np.linalg.norm(f_hat[channels[:, 1:]], axis=1)
            slip = np.linalg.norm(moved[channels[:, 1:]] - far[:, 1:], axis=1)
            shear = np.maximum(shear, _LEAST * float(shear.max(initial=0.0)))
            first = self._springs[channels[:, 1]]
            soft = np.divide(shear, slip, out=first.copy(), where=slip * first > shear)
            k[channels[:, 1:]] = np.clip(soft, _SOFTEST * first, first)[:, None]
        self._bind(k)
        self.q = f_hat + self.k * moved

    def solved(self, tolerance: float) -> tuple[Array, Array] | None:
        """Tractions F_hat and velocities W_hat (n,) of the relative motions that meet the laws, None where none are
        found; ``tolerance`` of the run."""
        enough = max(_CLOSER * tolerance, _ROUND_OFF)
        start = self.q
        # which rounds end in the answer depends on round-off: those of another depth take another way
        for depth in _DEPTHS:
            self.q = start.copy()
            self._bind(self._springs.copy())
            for _ in range(_ROUNDS):
                if self._iterated(enough, depth) <= enough or self._stepped(enough) <= enough:
                    free, f_hat, _, _ = self._look(self.q)
                    return f_hat, free + self._z * f_hat
                self._adapt()
                if not np.isfinite(self.q).all():
                    break
        return None


def sliding_start(stages: Stages, f_hat: Array, tolerance: float) -> Array | None:
    """First guess q (n_flat,) of an increment by the laws alone; None where none is found.

    f_hat : tractions (n_flat,) at its start. tolerance : of the run.
    """
    try:
        found = SlidingStart(stages, f_hat).solved(tolerance)
    except la.LinAlgError:
        found = None
    if found is None:
        return None
    direction = stages.direction
    assembly, q = direction.assembly, np.zeros(stages.image.n_flat)
    channels: Any = assembly.channels[0][:, 0]
    q[channels] = found[0] + direction.k[channels] * found[1]
    traction = np.zeros(stages.image.n_flat)
    traction[channels] = found[0]
    for group in assembly.layout.groups:
        group.block(q)[1] = -group.block(traction)[0]
    return q
