"""A run without inertia over the whole assembly at once, and what its bodies do in it."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass
from typing import Any, Final

import numpy as np
import scipy.sparse as sp

from ..assembly.body_motions import standing_bodies
from ..assembly.initial_state import InitialState
from ..assembly.problem import DiscretisedProblem, SolverReadyProblem, ready
from ..joined.recovered_fields import RecoveredRecorder
from ..joined.reduced_run import MotionPlace
from ..joined.static_assembly import NAME, StaticAssembly
from ..latin.assembly import Array, Assembly, Index
from ..latin.probes import OutputRequest
from ..latin.recorder import Recorder
from ..latin.settings import SolverSettings
from ..remarks import remarks_of
from ..scene.schema import Scene
from ..time_scheme import QuasiStatic
from .static_run import StaticMarch, static_assembly, static_march

_MOST: Final = 10_000_000
"""Displacements of all instants that are kept at most."""


@dataclass(frozen=True)
class StaticRun:
    """A run without inertia over the whole assembly at once.

    Attributes
    ----------
    march : the assembly as one substructure. bodies : the assembly of all bodies, with ``BodyMotions``.
    start : equilibrium at t = 0, None where there is none.
    """

    march: StaticMarch
    bodies: Assembly
    start: InitialState | None = None
    stored = 0.0
    """Energy beside that of the account, J."""

    @property
    def assembly(self) -> Assembly:
        """That of the one substructure."""
        return self.march.assembly

    @property
    def tied(self) -> StaticAssembly:
        """The assembly as one substructure."""
        return self.march.whole

    @property
    def units(self) -> tuple[int, ...]:
        """Numbers of the interfaces with relative motions."""
        return self.march.whole.relative

    @property
    def in_words(self) -> str:
        """What is solved."""
        if self.tied.bonded:
            bonded = f", {len(self.tied.bonded)} bonds eliminated"
        else:
            bonded = ""
        return f"all bodies at once, {self.tied.model.expansion.shape[1]} displacements{bonded}"

    def settings(self, settings: SolverSettings) -> SolverSettings:
        """The rules of the iteration."""
        return settings

    def recorder(self, energy: bool) -> Recorder:  # noqa: ARG002, runs with energies are solved body by body
        """That of the run: all displacements at every instant, interfaces."""
        motion = MotionPlace(NAME, sp.csr_array(sp.eye_array(self.tied.model.n_full)))
        return Recorder(self.assembly, OutputRequest(faces={NAME: motion}), {})


def static_problem_at_once(discretised: DiscretisedProblem, start: InitialState | None) -> SolverReadyProblem:
    """The problem of a run without inertia over the whole assembly, from an equilibrium where there is one.

    Raises
    ------
    TieError : bonds that cannot be eliminated. SolverError : bodies that nothing holds.
    """
    march = static_march(discretised, start, static_assembly(discretised))
    _, assembly, timeline = standing_bodies(discretised, start, QuasiStatic())
    warnings = tuple(discretised.remarks)
    if start is not None:
        warnings += tuple(remarks_of("start", start.remarks))
    about = warnings, timeline, start, discretised.scheme_in_words, dict[str, str]()
    return ready(discretised, assembly, about, StaticRun(march, assembly, start))


def solved_at_once(scene: Scene, discretised: DiscretisedProblem, restricted: bool) -> bool:
    """Whether a run without inertia takes the whole assembly at once; ``restricted`` : whether the caller takes
    derivatives, several processes, or looks at iterates."""
    size = len(discretised.time) * sum(c.members[0].expansion.shape[1] * len(c.members) for c in discretised.classes)
    automatic = scene.solver.search_direction.type in ("automatic", "static")
    single = scene.solver.window == 1 and scene.output.interfaces_every == 1 and not scene.output.energy
    return scene.time.quasi_static and automatic and single and not restricted and size <= _MOST


@dataclass(frozen=True)
class DisplacementHistories:
    """Motion of all bodies.

    Attributes
    ----------
    march : that made it. histories : displacements, velocities and accelerations (n_time, 3, n_full) of all bodies.
    """

    march: StaticRun
    histories: Array

    def of(self, rows: sp.csr_array | Array, kind: int) -> Array:
        """Displacements (``kind`` 0), velocities (1) or accelerations (2) of rows (k, n_full), (n_time, k)."""
        return np.asarray(sp.csr_array(rows) @ self.histories[:, kind].T).T

    def write(self, rows: sp.csr_array, kind: int, out: Array) -> None:
        """Write those of rows (k, n_full) to ``out`` (n_time, k)."""
        out[:] = self.of(rows, kind)

    def sensed(self, rows: sp.csr_array) -> Array:
        """All three, (3, n_time, k)."""
        return np.stack([self.of(rows, kind) for kind in range(3)])

    def full(self, where: slice, kind: int, instants: Index | slice) -> Array:
        """Those of full dofs at instants, (n_instant, k)."""
        return np.asarray(self.histories[instants, kind, where])

    def whole(self, kind: int, instant: int) -> Array:
        """Displacements or velocities (n_full,) of all dofs at an instant."""
        return np.asarray(self.histories[instant, kind])

    def placed(self, name: str, rows: sp.csr_array | Array) -> sp.csr_array:
        """Rows (k, n) of the full dofs of a body among those of all, (k, n_full)."""
        matrix, where = sp.csr_array(rows), self.march.tied.where[name]
        shape = matrix.shape[0], self.histories.shape[2]
        return sp.csr_array((matrix.data, matrix.indices + where.start, matrix.indptr), shape=shape)

    def bond_tractions(self, others: Callable[[slice], Array]) -> dict[int, Array]:
        """Tractions (n_time, k) on side E of each bond, local frames, Pa; ``others`` : forces (n_full, n_instant) of
        all other interfaces on the bodies at some instants, N."""
        march, n = self.march.march, len(self.histories)
        if not self.march.tied.bonded:
            return {}
        moved = self.full(slice(None), 0, slice(None)).T
        loads = np.stack([march.load(t) for t in range(n)], axis=1)
        tractions = march.bonds.tractions(self.march.tied.model.stiffness @ moved - loads - others(slice(None)))
        start: Mapping[str, Array] = {}
        if self.march.start is not None:
            start = self.march.start.traction
        for i, traction in tractions.items():
            name = march.problem.units[i].name
            # loads come with the first increment
            traction[0] = 0.0
            if name in start:
                traction[0] = start[name].ravel()
        return tractions


class StaticRecorder(RecoveredRecorder):
    """Histories of the bodies and interfaces of a ``StaticRun``; parameters as for ``RecoveredRecorder``."""

    def _motions_of(self, march: Any, histories: Mapping[str, Array]) -> Any:
        return DisplacementHistories(march, histories[NAME])

    def _gaps_of(self, gaps: Array, opening: Array) -> Array:  # noqa: ARG002, gaps are those of the displacements
        return gaps
