"""Moreau-Jean time stepping with one factorisation, contact by Siconos, on the matrices of a scene.

    (M + theta^2 h^2 K) (v+ - v) = h [theta f+ + (1 - theta) f - K (u + h theta v)] + H^T p
    u+ = u + h (theta v+ + (1 - theta) v)
    0 <= u_N + gap/h  perp  p_N >= 0,  Coulomb on p,  with u = H v+ the velocities of the points and p impulses, N s

Two solves an instant: the free velocity, and what the impulses add. W = H A^-1 H^T is built once, body by body.
"""

from __future__ import annotations

import ctypes

import numpy as np
import scipy.sparse as sp
from example_tools import Array
from siconos_contact import Contacts

from latin_fmu.assembly.problem import DiscretisedProblem
from latin_fmu.cholesky.factor import interface_factor
from latin_fmu.propagator import SubstructureModel
from latin_fmu.propagator.model import reduced_rank

THETA = 0.5


class MoreauJean:
    """A scene whose interfaces are all frictional contacts, every block a class of its own."""

    def __init__(self, ready: DiscretisedProblem, found: ctypes.CDLL, tolerance: float) -> None:
        self._ready, self._library, self._tolerance = ready, found, tolerance
        self.models: list[SubstructureModel] = [c.members[0] for c in ready.classes]
        n = sum(u.geometry.n_point for u in ready.units)
        row, sign = np.zeros(ready.layout.n_flat, dtype=int), np.zeros(ready.layout.n_flat)
        self.first = np.cumsum([0, *(u.geometry.n_point for u in ready.units)])
        for i in range(len(ready.units)):
            for side in (0, 1):
                flat = ready.layout.channels(i, side)
                row[flat] = 3 * self.first[i] + np.arange(flat.size).reshape(flat.shape)
                sign[flat] = 2 * side - 1
        self.rows = [row[c.channels[:, 0]] for c in ready.classes]
        traces = [
            sp.diags_array(sign[c.channels[:, 0]]) @ m.trace @ m.expansion
            for c, m in zip(ready.classes, self.models, strict=True)
        ]
        self.traces = [sp.csr_array(t) for t in traces]
        spread = [sp.csr_array((np.ones(len(r)), (r, np.arange(len(r)))), shape=(3 * n, len(r))) for r in self.rows]
        self.h = sp.csr_array(sp.hstack([s @ t for s, t in zip(spread, self.traces, strict=True)]))
        self.mass = sp.csr_array(sp.block_diag([m.reduced[0] for m in self.models], format="csr"))
        self.stiffness = sp.csr_array(sp.block_diag([m.reduced[2] for m in self.models], format="csr"))
        self.mu = np.concatenate(
            [np.full(u.geometry.n_point, ready.scene.interface[u.name].friction_coefficient) for u in ready.units]
        )
        self.gap = np.concatenate([u.geometry.gap for u in ready.units])
        self.iterations = 0

    def run(self) -> Array:
        """Factorise and march; normal contact forces (n_time, n_interface), N, over the step that ends there."""
        self.iterations = 0
        solve, contacts = self._factorise()
        h, h_t, dt = self.h, sp.csr_array(self.h.T), self._ready.dt
        pattern, amplitude = self._loads()
        mean = THETA * amplitude[1:] + (1.0 - THETA) * amplitude[:-1]
        u, v = np.zeros((2, self.mass.shape[0]))
        gap, forces = self.gap.copy(), np.zeros((len(mean) + 1, len(self.first) - 1))
        for i, now in enumerate(mean):
            free = v + solve(dt * (pattern @ now - self.stiffness @ (u + dt * THETA * v)))
            contacts.q[:] = h @ free
            contacts.q[::3] += gap / dt
            self.iterations += contacts.solve()
            new = free + solve(h_t @ contacts.impulse)
            u += dt * (THETA * new + (1.0 - THETA) * v)
            v = new
            gap += dt * (h @ v)[::3]
            forces[i + 1] = np.add.reduceat(contacts.impulse[::3], self.first[:-1]) / dt
        return forces

    def _factorise(self) -> tuple[Solve, Contacts]:
        """One factor for all blocks, and W from a factor of each block."""
        dt, n = self._ready.dt, len(self.gap)
        w = np.zeros((3 * n, 3 * n))
        matrix = sp.csr_array(self.mass + (THETA * dt) ** 2 * self.stiffness)
        ranks, start = [], 0.0
        for model in self.models:
            assert model.ordering is not None
            rank = reduced_rank(model.expansion, model.ordering)
            ranks.append(rank + start)
            start += float(rank.max()) + 1.0
        solve = Solve(matrix, np.concatenate(ranks))
        # columns of different blocks do not meet: one right-hand side holds one of each
        offsets = np.cumsum([0, *(t.shape[1] for t in self.traces)])
        sides = np.zeros((matrix.shape[0], max(len(r) for r in self.rows)))
        for trace, begin, end in zip(self.traces, offsets[:-1], offsets[1:], strict=True):
            sides[begin:end, : trace.shape[0]] = trace.T.toarray()
        answers = solve.factor.solve(sides)
        for rows, trace, begin, end in zip(self.rows, self.traces, offsets[:-1], offsets[1:], strict=True):
            w[np.ix_(rows, rows)] += trace @ answers[begin:end, : trace.shape[0]]
        held = np.flatnonzero(w.diagonal() <= 0.0)  # directions of a symmetry plane: nothing happens there
        w[held, held] = w.diagonal().max()
        return solve, Contacts(self._library, 0.5 * (w + w.T), self.mu, self._tolerance)

    def _loads(self) -> tuple[Array, Array]:
        """Reduced patterns (n_dof, n_load) and their amplitudes (n_time, n_load)."""
        ready, columns, amplitudes, start = self._ready, [], [], 0
        total = self.mass.shape[0]
        for model in self.models:
            reduced = [np.asarray(model.expansion.T @ load.pattern) for load in model.loads]
            for pattern, law in zip(reduced, ready.timeline.histories(model, ready.time).amplitudes, strict=True):
                column = np.zeros(total)
                column[start : start + len(pattern)] = pattern
                columns.append(column)
                amplitudes.append(law)
            start += model.expansion.shape[1]
        return np.stack(columns, axis=1), np.stack(amplitudes, axis=1)


class Solve:
    """A^-1 b for vectors, one factor."""

    def __init__(self, matrix: sp.csr_array, rank: Array) -> None:
        self.factor = interface_factor(matrix, np.zeros(0, dtype=np.int64), rank)
        self._none = np.zeros((0, 1))

    def __call__(self, b: Array) -> Array:
        y, _ = self.factor.forward(b[:, None])
        return self.factor.backward(y, self._none)[:, 0]
