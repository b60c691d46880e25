"""Right-hand side of a reduced model."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from .amplitudes import Amplitudes
from .contact_law import ContactLaw, Modes, Motion, Regularisation, Traction
from .system import WORKS, Array, ReducedSystem

N_WORK = len(WORKS)


class Evaluation(NamedTuple):
    """At one instant: derivative (n_state,), patches, velocity of the ground (n_interface, 3)."""

    derivative: Array
    motion: Motion
    traction: Traction
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
        self.law = ContactLaw(system, Regularisation.of(system))

    def use(self, regularisation: Regularisation) -> None:
        """Set the regularisation."""
        self.law = ContactLaw(self.system, regularisation)

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
        return np.concatenate(
            [
                s.speed / np.maximum(rate, 1.0 / s.end),
                np.full(s.n, s.speed),
                np.full(3 * len(s.interfaces), force * s.end),
                np.full(N_WORK * self.energy, work),
            ]
        )

    # -- patches --------------------------------------------------------------------------------------------------
    def motion(self, t: float, y: Array, segment: int) -> tuple[Motion, Array]:
        """Motion of the patches, and velocity of the ground (n_interface, 3)."""
        s, n = self.system, self.system.n
        x, v = y[:n], y[n : 2 * n]
        gap = s.contacts.gap + s.contacts.opening @ x
        rate = s.contacts.opening @ v
        sliding = (self._flat_sliding @ v).reshape(2, -1)
        moved, velocity = self.amplitudes.ground(t, segment)
        if self.amplitudes.moves:
            gap = gap + np.einsum("pi,pi->p", self._normal, moved[self._owner])
            rate = rate + np.einsum("pi,pi->p", self._normal, velocity[self._owner])
            slides = s.contacts.friction > 0.0
            sliding = sliding + slides * np.einsum("cpi,pi->cp", self._tangent, velocity[self._owner])
        return Motion(gap, rate, sliding), velocity

    def indicators(self, t: float, y: Array, modes: Modes) -> Array:
        """(2 n_patch,) positive while the discrete state holds: of the gaps, then of stick and slip."""
        return np.concatenate(self.law.indicators(self.motion(t, y, modes.segment)[0], modes))

    def switch(self, t: float, y: Array, modes: Modes) -> tuple[Modes, int]:
        """Discrete states after an event, and how many of them changed."""
        segment = max(self.amplitudes.segment(t), modes.segment)
        here = Modes(modes.closed, modes.sticking, segment)
        return self.law.switched(self.motion(t, y, segment)[0], here)

    def modes_at(self, t: float, y: Array) -> Modes:
        """Discrete states that the states alone call for."""
        segment = self.amplitudes.segment(t)
        return self.law.called_for(self.motion(t, y, segment)[0], segment)

    # -- right-hand side --------------------------------------------------------------------------------------------
    def evaluate(self, t: float, y: Array, modes: Modes, given: dict[str, tuple[float, float, float]]) -> Evaluation:
        """Derivative and everything outputs need; ``given`` as in ``Amplitudes.at``."""
        s, n = self.system, self.system.n
        x, v, area = y[:n], y[n : 2 * n], s.contacts.area
        motion, ground = self.motion(t, y, modes.segment)
        traction = self.law.traction(motion, modes)
        amplitudes = self.amplitudes.at(t, modes.segment, given)
        pushed, rubbed = area * traction.pressure, area * traction.shear
        interface = s.contacts.opening.T @ pushed
        if self._slides:
            interface -= self._flat_sliding.T @ rubbed.ravel()
        load = s.loads @ amplitudes
        damped = np.zeros(n) if s.damping is None else s.damping @ v
        acceleration = (load + interface - damped - s.stiffness * x) / s.inertia
        force = self.forces(x, v, acceleration, amplitudes, pushed, rubbed)
        lost = self.law.damping * np.sum(area * traction.elastic * motion.rate**2)
        works = [v @ load, v @ interface, np.sum(rubbed * motion.sliding), lost, v @ damped]
        derivative = np.concatenate([v, acceleration, force.ravel(), works[: N_WORK * self.energy]])
        return Evaluation(derivative, motion, traction, ground)

    def forces(self, x: Array, v: Array, acceleration: Array, amplitudes: Array, pushed: Array, rubbed: Array) -> Array:
        """(n_interface, 3) resultants on side E."""
        on_patch = -pushed[:, None] * self._normal
        if self._slides:
            on_patch = on_patch + np.einsum("cp,cpi->pi", rubbed, self._tangent)
        force: Array = self._gather @ on_patch
        for bond in self.system.bonds:
            force[bond.interface] = (
                bond.inertia @ acceleration
                + bond.damping @ v
                + bond.stiffness @ x
                - bond.loads @ amplitudes
                - bond.pressure @ pushed
                + np.einsum("cip,cp->i", bond.shear, rubbed)
            )
        return force
