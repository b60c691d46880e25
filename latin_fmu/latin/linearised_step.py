"""A segment of a run linearised about its solution: derivatives of its fields by the histories that drive it.

While no point opens or closes, sticks or begins to slip, the end of a segment of windows of one instant depends
smoothly on its loads and motions. ``Tangents`` keeps the laws of the interfaces about the solution at every instant,

    F_hat = F* + J (jump + g - jump* - g*),        J = dF_hat / djump  (``kernels.laws.tangent``),

with * the solution, jump the free velocities and g the normalised gaps. ``march`` solves the instants of a
segment with these laws in the place of their own. The fields are then affine in the histories that drive the
segment, and energies quadratic: a central difference of any length is the derivative but for round-off. In slip J is
the consistent tangent; the traction keeps to the cone and to the direction of slip.

One instant is a linear system for the incoming quantity, q = F_hat + k W_hat with both stages as an affine map of q. It
is solved by GMRES to round-off.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import scipy.sparse.linalg as spla

from ..errors import SolverError
from ..kernels import entries
from ..kernels.laws import law_tangents
from .assembly import Array
from .record import WindowRecord
from .run_image import Stages
from .windows import Run

_ROUNDS, _SMALL, _ENOUGH = 6, 1e-14, 1e-9
"""Solutions of the system of an instant, each for the residual of the last; residual over q at which they end, and
above which there is no derivative."""
_BASIS, _PART = 200, 1e-8  # directions of GMRES; part of a residual that one solution leaves


@dataclass(frozen=True)
class PointLaws:
    """Laws of the points of a group about a solution.

    Attributes
    ----------
    jump, traction : (p, h). normalised_gap : as the law takes it, (p,) or (p, h). tangent : (p, h, h), Pa s m-1.
    moves : of the shape of ``normalised_gap``: 1 where it changes with the gap, 0 where a penetration stays as it is.
    """

    jump: Array
    normalised_gap: Array
    traction: Array
    tangent: Array
    moves: Array

    def at(self, jump: Array, normalised_gap: Array) -> Array:
        """Tractions (p, h) by the tangent."""
        change = jump - self.jump
        opening = self.moves * (normalised_gap - self.normalised_gap)
        if opening.ndim == 2:
            change = change + opening
        else:
            change[:, 0] += opening
        traction: Array = self.traction + np.einsum("pab,pb->pa", self.tangent, change)
        return traction


class Tangents:
    """A ``WindowMonitor`` that keeps the laws about the solution of each instant, one window after the other.

    Attributes
    ----------
    laws : per instant those of the groups.
    """

    def __init__(self) -> None:
        self.laws: list[list[PointLaws]] = []

    def instants(self, _run: Run) -> int:
        """One instant a call: after it the fields of the local stage are those of the solution."""
        return 1

    def check(self, run: Run) -> bool:
        """Keep the laws about the last solved instant."""
        if run.assembly.instant > len(self.laws):
            stages = Stages(run.image, run.direction(1), 1, run.assembly.instant)
            self.laws.append([_about(stages, g) for g in range(len(run.image.groups))])
        return False

    def stops(self) -> bool:
        """False: the run is never stopped."""
        return False


def _about(stages: Stages, g: int) -> PointLaws:
    """Laws of a group about the last local stage."""
    image, group = stages.image, stages.direction.assembly.layout.groups[g]
    points, h, elastic = group.n_point, group.n_component, group.behaviour.elastic
    width = (points, h) if elastic else (points,)
    jump, traction = (image.group_field(g, name, points, h).copy() for name in ("jump", "traction"))
    normalised_gap, start = image.group_field(g, "reach", *width).copy(), image.group_field(g, "opened", 4, *width)[3]
    z = stages.direction.group_fields()[g]["z_sum"]
    tangent = law_tangents(int(image.groups[g]["law"]), jump, z, normalised_gap, stages.rate(g), group.parameters)
    moves = np.ones(width) if elastic else (start >= image.run[0]["deepest"]).astype(float)
    if elastic and group.behaviour.opens:  # the tractions of friction follow the velocities alone
        moves[:, 1:] = 0.0
    return PointLaws(jump, normalised_gap, traction, tangent, moves)


def march(run: Run, laws: list[list[PointLaws]]) -> None:
    """Solve the segment of a run, which has begun it, with the laws about a solution.

    Raises
    ------
    SolverError : the linear system of an instant cannot be solved: several interfaces hold a point, or nothing does.
    """
    image, kept = run.image, {name: run.image.run[0][name] for name in ("deepest", "rest_traction", "reuse")}
    run.use_single_instants()
    image.set({"deepest": -np.inf, "rest_traction": -1.0, "reuse": -1.0})
    try:
        for at, about in enumerate(laws):
            instant = _Instant(run, at + 1, about)
            instant.solve()
            run.windows.append(instant.end())
    finally:
        image.set(kept)


class _Instant:
    """One instant of a linearised segment."""

    def __init__(self, run: Run, first: int, laws: list[PointLaws]) -> None:
        self._run, self._first, self._laws = run, first, laws
        self._stages = Stages(run.image, run.direction(1), 1, first)
        self._k = self._stages.direction.k

    def solve(self) -> None:
        """Solve for q; raises SolverError."""
        image, n = self._run.image, self._run.image.n_flat
        image.call(entries.OPEN, 1, self._first - 1)
        for c in range(len(image.propagators)):
            image.predict(c, self._first)
        if not n:
            return
        image.call(entries.FIRST_GUESS, self._first)
        q = image.field("q", n).copy()
        residual = self._residual(q)
        for _ in range(_ROUNDS):
            size = float(np.linalg.norm(residual))
            if size <= _SMALL * np.linalg.norm(q):
                break
            base, unit = residual, size  # steps of this length keep the digits of the difference

            def applied(x: Array, q: Array = q, base: Array = base, unit: float = unit) -> Array:
                length = float(np.linalg.norm(x))
                if length == 0.0:
                    return np.zeros_like(x)
                step = unit / length
                return np.asarray((base - self._residual(q + step * x)) / step)

            system = spla.LinearOperator((n, n), applied, dtype=float)
            change, _ = spla.gmres(system, residual, rtol=_PART, atol=0.0, restart=min(n, _BASIS), maxiter=2)
            trial = self._residual(q + change)
            if not np.linalg.norm(trial) < size:
                break
            q, residual = q + change, trial
        left = float(np.linalg.norm(self._residual(q)))
        if not left <= _ENOUGH * np.linalg.norm(q):
            raise SolverError(
                "there is no derivative here: the interfaces about the present solution have no unique solution "
                f"(residual {left:.2g} of {np.linalg.norm(q):.2g})"
            )

    def _residual(self, q: Array) -> Array:
        """F_hat + k W_hat - q of both stages."""
        image, n = self._run.image, self._run.image.n_flat
        image.field("q", n)[:] = q
        image.call(entries.LINEAR_STAGE, 1, self._first, 0)
        image.call(entries.OUTGOING, 0)
        for g, law in enumerate(self._laws):
            image.call(entries.PREPARE, g, 0)
            jump, normalised_gap = (
                image.group_field(g, "jump", *law.jump.shape),
                image.group_field(g, "reach", *law.normalised_gap.shape),
            )
            image.group_field(g, "traction", *law.jump.shape)[...] = law.at(jump, normalised_gap)
            image.call(entries.FINISH, g, 0, 1)
        return np.asarray(image.field("local_f", n) + self._k * image.field("local_w", n) - q)

    def end(self) -> WindowRecord:
        """Move the substructures to the end of the instant and record it; its window."""
        run, image = self._run, self._run.image
        image.set({"first_row": self._first})
        run.end_instant(self._stages)
        return WindowRecord(self._first, self._first, [0.0], [0.0], converged=True)
