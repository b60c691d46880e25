"""Right-hand side of a reduced model, with regularised contact and friction.

Contact of a patch (P pressure, g gap, s sliding velocity of E' over E; k, d, v_r the regularisation):

    elastic part   p = preload - k g           while closed, 0 while open
    pressure       P = p (1 - d g')            d > 0 takes out what the missing modes would carry away
    friction       tau = mu P s / v_r          while sticking: creep at less than v_r instead of no motion
                   tau = mu P s / |s|          while slipping

Closed or open, sticking or slipping are discrete states that change at events only; between events the right-hand side
is smooth. A state is left a little beyond its bound (hysteresis), so that an event never calls for the next one.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from .amplitudes import Amplitudes
from .system import WORKS, Array, ReducedSystem

Flags = NDArray[np.bool_]
_GAP_MARGIN = 1e-6  # of the penetration under the characteristic pressure
_SLIDING_MARGIN = 1e-3  # of the velocity of regularisation
N_WORK = len(WORKS)


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


@dataclass
class Modes:
    """Discrete states: which patches are closed, which of them stick, and the segment of the time laws."""

    closed: Flags
    sticking: Flags
    segment: int


class Evaluation(NamedTuple):
    """Everything at one instant: patches (n_patch,), shear and sliding (2, n_patch), derivative (n_state,)."""

    derivative: Array
    amplitudes: Array
    gap: Array
    pressure: Array
    elastic: Array
    sliding: Array
    shear: Array
    ground: Array


class Equations:
    """y = (x, x', impulse of every interface, works where asked for); see ``ReducedSystem`` for x."""

    def __init__(self, system: ReducedSystem, energy: bool) -> None:
        self.system, self.energy = system, energy
        self.amplitudes = Amplitudes(system)
        contacts = system.contacts
        self._owner = contacts.owner.astype(np.int64)
        self._normal, self._tangent = contacts.frames[:, 0], contacts.frames[:, 1:].transpose(1, 0, 2)
        self._gather = np.zeros((len(system.interfaces), len(self._owner)))
        self._gather[self._owner, np.arange(len(self._owner))] = 1.0
        self._slides = bool((contacts.friction > 0.0).any())
        self._flat_sliding = contacts.sliding.reshape(-1, system.n)
        self.use(Regularisation(20.0, 0.5, 1e-3 * system.speed))

    def use(self, regularisation: Regularisation) -> None:
        """Set the regularisation."""
        self.regularisation = regularisation
        self._k: Array = regularisation.stiffness * self.system.contacts.stiffness
        self._d = regularisation.damping / self.system.speed
        self.gap_margin = _GAP_MARGIN * self.system.traction / self._k

    @property
    def spring_stiffness(self) -> Array:
        """(n_patch,) of the contacts, Pa m-1."""
        return self._k

    @property
    def n_state(self) -> int:
        """Number of continuous states."""
        return 2 * self.system.n + 3 * len(self.system.interfaces) + N_WORK * self.energy

    def start(self) -> Array:
        """States at the start."""
        rest = np.zeros(self.n_state - 2 * self.system.n)
        return np.concatenate([self.system.displacement, self.system.velocity, rest])

    def nominals(self) -> Array:
        """Expected sizes of the states: an integrator makes its absolute tolerances of them."""
        s = self.system
        rate = np.sqrt(s.stiffness / s.inertia)
        force = s.traction * max(float(s.contacts.area.sum()), 1e-300) if len(s.contacts.area) else 1.0
        work = float(s.inertia[np.unique(np.cumsum([0, *s.sizes[:-1]]))].sum()) * s.speed**2
        return np.concatenate([
            s.speed / np.maximum(rate, 1.0 / s.end), np.full(s.n, s.speed),
            np.full(3 * len(s.interfaces), force * s.end), np.full(N_WORK * self.energy, work),
        ])  # fmt: skip

    # -- patches --------------------------------------------------------------------------------------------------
    def patches(self, t: float, y: Array, modes: Modes) -> tuple[Array, Array, Array, Array]:
        """Gap, its rate, sliding velocity (2, n_patch), velocity of the ground (n_interface, 3)."""
        s, n = self.system, self.system.n
        x, v = y[:n], y[n : 2 * n]
        gap = s.contacts.gap + s.contacts.opening @ x
        rate = s.contacts.opening @ v
        sliding = (self._flat_sliding @ v).reshape(2, -1)
        moved, velocity = self.amplitudes.ground(t, modes.segment)
        if self.amplitudes.moves:
            gap = gap + np.einsum("pi,pi->p", self._normal, moved[self._owner])
            rate = rate + np.einsum("pi,pi->p", self._normal, velocity[self._owner])
            slides = s.contacts.friction > 0.0
            sliding = sliding + slides * np.einsum("cpi,pi->cp", self._tangent, velocity[self._owner])
        return gap, rate, sliding, velocity

    def indicators(self, t: float, y: Array, modes: Modes) -> Array:
        """(2 n_patch,) positive while the discrete state holds: gaps (m), then sliding velocities (m s-1)."""
        gap, _, sliding, _ = self.patches(t, y, modes)
        g = gap - self.system.contacts.preload / self._k
        normal = np.where(modes.closed, self.gap_margin - g, self.gap_margin + g)
        speed, bound = np.hypot(sliding[0], sliding[1]), self.regularisation.sliding
        margin = _SLIDING_MARGIN * bound
        tangential = np.where(modes.sticking, bound + margin - speed, speed - bound + margin)
        watched = modes.closed & (self.system.contacts.friction > 0.0)
        return np.concatenate([normal, np.where(watched, tangential, bound)])

    def switch(self, t: float, y: Array, modes: Modes) -> tuple[Modes, int]:
        """Discrete states after an event, and how many of them changed."""
        segment = max(self.amplitudes.segment(t), modes.segment)
        here = Modes(modes.closed, modes.sticking, segment)
        n = len(modes.closed)
        due = self.indicators(t, y, here)[:n] <= 0.1 * self.gap_margin
        closed = modes.closed ^ due
        here = Modes(closed, modes.sticking, segment)
        slack = 0.1 * _SLIDING_MARGIN * self.regularisation.sliding
        turned = self.indicators(t, y, here)[n:] <= slack
        sticking = np.where(closed, modes.sticking ^ turned, True)
        return Modes(closed, sticking, segment), int(due.sum() + turned.sum())

    def modes_at(self, t: float, y: Array) -> Modes:
        """Discrete states that the states alone call for."""
        n = len(self._owner)
        here = Modes(np.zeros(n, dtype=bool), np.ones(n, dtype=bool), self.amplitudes.segment(t))
        gap, _, sliding, _ = self.patches(t, y, here)
        here.closed = self.system.contacts.preload - self._k * gap > 0.0
        here.sticking = ~here.closed | (np.hypot(sliding[0], sliding[1]) <= self.regularisation.sliding)
        return here

    # -- right-hand side --------------------------------------------------------------------------------------------
    def evaluate(
        self, t: float, y: Array, modes: Modes, given: dict[str, tuple[float, float, float]]
    ) -> Evaluation:
        """Derivative and everything outputs need; ``given`` as in ``Amplitudes.at``."""
        s, n = self.system, self.system.n
        c = s.contacts
        x, v = y[:n], y[n : 2 * n]
        gap, rate, sliding, ground = self.patches(t, y, modes)
        elastic = np.where(modes.closed, c.preload - self._k * gap, 0.0)
        pressure = elastic * np.maximum(0.0, 1.0 - self._d * rate)
        speed, bound = np.hypot(sliding[0], sliding[1]), self.regularisation.sliding
        reach = np.where(modes.sticking, bound, np.maximum(speed, 0.5 * bound))
        shear = c.friction * np.maximum(pressure, 0.0) * sliding / reach
        amplitudes = self.amplitudes.at(t, modes.segment, given)
        pushed, rubbed = c.area * pressure, c.area * shear
        interface = c.opening.T @ pushed
        if self._slides:
            interface -= self._flat_sliding.T @ rubbed.ravel()
        load = s.loads @ amplitudes
        damped = np.zeros(n) if s.damping is None else s.damping @ v
        acceleration = (load + interface - damped - s.stiffness * x) / s.inertia
        force = self.forces(x, v, acceleration, amplitudes, pushed, rubbed)
        works = [
            v @ load, v @ interface, np.sum(rubbed * sliding), self._d * np.sum(c.area * elastic * rate**2), v @ damped,
        ]  # fmt: skip
        derivative = np.concatenate([v, acceleration, force.ravel(), works[: N_WORK * self.energy]])
        return Evaluation(derivative, amplitudes, gap, pressure, elastic, sliding, shear, ground)

    def forces(
        self, x: Array, v: Array, acceleration: Array, amplitudes: Array, pushed: Array, rubbed: Array
    ) -> Array:
        """(n_interface, 3) resultants on side E."""
        on_patch = -pushed[:, None] * self._normal
        if self._slides:
            on_patch = on_patch + np.einsum("cp,cpi->pi", rubbed, self._tangent)
        force: Array = self._gather @ on_patch
        for bond in self.system.bonds:
            force[bond.interface] = (
                bond.inertia @ acceleration + bond.damping @ v + bond.stiffness @ x - bond.loads @ amplitudes
                - bond.pressure @ pushed + np.einsum("cip,cp->i", bond.shear, rubbed)
            )  # fmt: skip
        return force
