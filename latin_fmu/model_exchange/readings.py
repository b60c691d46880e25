"""Outputs of a reduced model, in the order of its table."""

from __future__ import annotations

import numpy as np

from .contact_law import Modes
from .equations import N_WORK, Equations, Evaluation
from .system import ENERGY_NAMES, WORKS, Array


class Readings:
    """Turns an evaluation into outputs."""

    def __init__(self, equations: Equations) -> None:
        system = equations.system
        self._equations, self._system = equations, system
        owner = system.contacts.owner.astype(np.int64)
        self._patches = [np.flatnonzero(owner == i) for i in range(len(system.interfaces))]
        self._bonds = {bond.interface: bond.normal for bond in system.bonds}

    def row(self, y: Array, modes: Modes, now: Evaluation, events: int) -> Array:
        """(n_output,) at one instant."""
        s = self._system
        x, v = y[: s.n], y[s.n : 2 * s.n]
        impulses = y[2 * s.n : 2 * s.n + 3 * len(s.interfaces)].reshape(-1, 3)
        forces = now.derivative[2 * s.n : 2 * s.n + impulses.size].reshape(-1, 3)
        velocities = s.sides @ v
        velocities[:, 1] += now.ground
        parts = []
        for i in range(len(s.interfaces)):
            first, second = velocities[i]
            parts += [forces[i], impulses[i], first, second, second - first]
            parts.append(self._contact(i, modes, now) if i not in self._bonds else [-forces[i] @ self._bonds[i]])
        for place in s.places:
            parts += [place @ x, place @ v]
        if self._equations.energy:
            parts.append(self._energies(x, v, y[-N_WORK:], now))
        parts.append([float(events)])
        return np.concatenate(parts)

    def _contact(self, interface: int, modes: Modes, now: Evaluation) -> list[float]:
        here = self._patches[interface]
        contacts = self._system.contacts
        area = contacts.area[here]
        share = area / area.sum()
        closed, sticking = modes.closed[here], modes.sticking[here] & (contacts.friction[here] > 0.0)
        gap = now.motion.gap[here]
        shares = [float(share @ flags) for flags in (closed, closed & sticking, closed & ~sticking)]
        return [float(area @ now.traction.pressure[here]) + 0.0, float(share @ gap), float(gap.min()), *shares]

    def _energies(self, x: Array, v: Array, works: Array, now: Evaluation) -> list[float]:
        s, equations = self._system, self._equations
        found = dict(zip(WORKS, works.tolist(), strict=True))
        found["kinetic"] = 0.5 * float(s.inertia @ v**2)
        found["elastic"] = 0.5 * float(s.stiffness @ x**2)
        spring = equations.law.stiffness
        found["contact"] = 0.5 * float(np.sum(s.contacts.area * now.traction.elastic**2 / spring))
        start = 0.5 * float(s.inertia @ s.velocity**2 + s.stiffness @ s.displacement**2)
        found["balance"] = (
            found["kinetic"]
            + found["elastic"]
            - start
            + found["damping_dissipation"]
            - found["work_of_loads"]
            - found["interface_work"]
        )
        return [found[name] for name in ENERGY_NAMES]
