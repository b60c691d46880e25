"""Implicit march of a plain linear system M a + C v + K u = F: the reference for bonded assemblies.

HHT: M a1 + (1 + alpha)(C v1 + K u1 - F1) - alpha (C v0 + K u0 - F0) = 0 with gamma = 1/2 - alpha and
beta = (1 - alpha)^2/4. Newmark: alpha = 0 with its own beta and gamma. Written in accelerations.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from scipy import sparse
from scipy.sparse.linalg import splu

Array = NDArray[np.float64]
Matrix = sparse.csr_matrix


@dataclass(frozen=True)
class Scheme:
    """Constants of the time scheme."""

    alpha: float
    beta: float
    gamma: float

    @classmethod
    def hht(cls, alpha: float = -0.1) -> Scheme:
        return cls(alpha, (1.0 - alpha) ** 2 / 4.0, 0.5 - alpha)

    @classmethod
    def newmark(cls, beta: float = 0.25, gamma: float = 0.5) -> Scheme:
        return cls(0.0, beta, gamma)


@dataclass(frozen=True)
class March:
    """Displacement, velocity, acceleration of every dof at every instant, each (n_time, n_dof)."""

    displacement: Array
    velocity: Array
    acceleration: Array


class LinearSystem:
    """M, C, K with the held dofs taken out, factorised for one step."""

    def __init__(
        self,
        mass: Matrix,
        damping: Matrix | None,
        stiffness: Matrix,
        held: NDArray[np.int64],
        step: float,
        scheme: Scheme,
    ) -> None:
        self.free = np.setdiff1d(np.arange(mass.shape[0]), held)
        self.mass, self.stiffness = self._kept(mass), self._kept(stiffness)
        self.damping = self._kept(damping) if damping is not None else 0.0 * self.mass
        self.step, self.scheme, self.n_dof = step, scheme, mass.shape[0]
        weight = 1.0 + scheme.alpha
        operator = self.mass + weight * (scheme.gamma * step * self.damping + scheme.beta * step**2 * self.stiffness)
        self.factor = splu(sparse.csc_matrix(operator))

    def _kept(self, matrix: Matrix) -> sparse.csc_matrix:
        return sparse.csc_matrix(matrix[self.free][:, self.free])

    def start_acceleration(self, u: Array, v: Array, load: Array) -> Array:
        """Acceleration at t0 from the motion equation there."""
        return splu(self.mass).solve(load - self.damping @ v - self.stiffness @ u)

    def advance(self, u: Array, v: Array, a: Array, old: Array, new: Array) -> tuple[Array, Array, Array]:
        """One step under the loads at its start and at its end."""
        s, h = self.scheme, self.step
        u1 = u + h * v + h * h * (0.5 - s.beta) * a
        v1 = v + h * (1.0 - s.gamma) * a
        force = (1.0 + s.alpha) * (new - self.damping @ v1 - self.stiffness @ u1)
        force -= s.alpha * (old - self.damping @ v - self.stiffness @ u)
        a1 = self.factor.solve(force)
        return u1 + s.beta * h * h * a1, v1 + s.gamma * h * a1, a1


def march(system: LinearSystem, loads: Array) -> March:
    """March under ``loads`` (n_time, n_dof), N, from rest."""
    n_time, free = len(loads), system.free
    u, v, a = (np.zeros((n_time, system.n_dof)) for _ in range(3))
    a[0, free] = system.start_acceleration(u[0, free], v[0, free], loads[0, free])
    for i in range(1, n_time):
        u[i, free], v[i, free], a[i, free] = system.advance(
            u[i - 1, free], v[i - 1, free], a[i - 1, free], loads[i - 1, free], loads[i, free]
        )
    return March(u, v, a)
