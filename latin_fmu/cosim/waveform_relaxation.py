"""Master for waveform relaxation: instances coupled through velocity and force, a step iterated with rollback.

The velocities of the two sides of a coupling give a new force along a search direction k, as in the LATIN iteration:

    F <- F - k (W - W'),      1 / k = 1 / z + 1 / z'

z the impedances of the sides (rho c for a bar), until the velocities agree at the end of the step. Anderson
acceleration reduces the error of k. The force is linear over the step.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Protocol

import numpy as np

from ..errors import InputError, Problem, SolverError
from ..kernels.acceleration import Anderson
from ..latin.outcome import Array
from .settings import StepReport


class Peer(Protocol):
    """Instance of a co-simulation: a ``Session``, or an FMU (``fmu_build.drive.FmuPeer``)."""

    def set_load(self, name: str, value: float, rate: float = 0.0) -> None:
        """Amplitude at the start of the next step and its rate."""
        ...

    def step(self, t: float, h: float) -> StepReport:
        """Advance from t by h, s."""
        ...

    def value(self, name: str) -> float:
        """Value of a scalar output."""
        ...

    def snapshot(self) -> bytes:
        """Get the state as bytes."""
        ...

    def restore(self, blob: bytes) -> None:
        """Set a state that ``snapshot`` returned."""
        ...


@dataclass(frozen=True)
class Side:
    """One side of a coupling: a load of a peer that takes the force, an output that is its velocity.

    impedance : force amplitude per velocity of the side, e.g. rho c (Pa s m-1) for a load of 1 Pa on the end of a bar.
    """

    peer: str
    load: str
    velocity: str
    impedance: float


@dataclass(frozen=True)
class Coupling:
    """Two sides with one velocity; the load is +F on the first and -F on the second."""

    first: Side
    second: Side

    @property
    def search_direction(self) -> float:
        """Search direction k of the two impedances in series."""
        a, b = self.first.impedance, self.second.impedance
        return a * b / (a + b)


@dataclass(frozen=True)
class MasterReport:
    """Iterations of a step, last relative residual of the velocities, forces at its end (n_coupling,)."""

    iterations: int
    residual: float
    force: Array


class WaveformMaster:
    """Advances coupled peers together.

    Parameters
    ----------
    peers : initialized instances by name. couplings : sides with one velocity. max_iterations : of a step.
    tolerance : on k |W - W'| over the largest force so far. depth : of the Anderson acceleration.

    Raises
    ------
    InputError : a coupling names a peer that is not there, or an impedance that is not positive.
    """

    def __init__(
        self,
        peers: Mapping[str, Peer],
        couplings: Sequence[Coupling],
        tolerance: float = 1e-8,
        max_iterations: int = 50,
        depth: int = 5,
    ) -> None:
        self._peers, self._couplings = dict(peers), list(couplings)
        self._tolerance = tolerance
        self._max = max_iterations
        self._depth = depth
        problems = [
            Problem(f"coupling {i}", "no such peer", side.peer, ", ".join(peers))
            for i, c in enumerate(couplings)
            for side in (c.first, c.second)
            if side.peer not in peers
        ]
        problems += [
            Problem(f"coupling {i}", "impedances must be positive", f"{c.first.impedance}, {c.second.impedance}")
            for i, c in enumerate(couplings)
            if not (c.first.impedance > 0.0 and c.second.impedance > 0.0)
        ]
        if problems:
            raise InputError(problems, "the master cannot be made")
        self._k = np.array([c.search_direction for c in couplings])
        self.force: Array = np.zeros(len(couplings))
        self._before = self.force
        self._scale = 0.0

    def step(self, t: float, h: float) -> MasterReport:
        """Iterate all peers from t to t + h until the velocities of their sides agree.

        Raises
        ------
        SolverError : a peer refuses the step, or the velocities do not agree; the state of every peer is that at t.
        """
        states = {name: peer.snapshot() for name, peer in self._peers.items()}
        # residuals are forces, one for each coupling: weights of 1
        accelerator = Anderson(np.ones(len(self._k)), self._depth, 1.0)
        # forces go on as they did over the last step
        force = 2.0 * self.force - self._before
        for iteration in range(1, self._max + 1):
            # the first iteration starts from the state at t, where nothing has to be undone
            if iteration > 1:
                self._rewind(states)
            self._advance(states, force, t, h)
            # k times the jump: a force, as the fixed point of F := F - k (W - W')
            residual = -self._k * self._velocity_jump()
            # the largest so far, not of this step: a force that vanishes does not tighten the tolerance
            self._scale = max(self._scale, float(np.abs(force).max(initial=0.0)))
            relative = float(np.abs(residual).max(initial=0.0)) / (self._scale or 1.0)
            if relative <= self._tolerance:
                self._before, self.force = self.force, force
                return MasterReport(iteration, relative, force)
            force = accelerator.next(force, residual)
        self._rewind(states)
        raise SolverError(f"the step at {t:g} s: velocities differ by {relative:.3g} after {self._max} iterations")

    def _advance(self, states: Mapping[str, bytes], force: Array, t: float, h: float) -> None:
        # from the force at t to that at its end: it is continuous from step to step
        rate = (force - self.force) / h
        for i, coupling in enumerate(self._couplings):
            for side, sign in ((coupling.first, 1.0), (coupling.second, -1.0)):
                self._peers[side.peer].set_load(side.load, sign * float(self.force[i]), sign * float(rate[i]))
        for name, peer in self._peers.items():
            report = peer.step(t, h)
            if not report.accepted:
                # peers that have made the step go back, too
                self._rewind(states)
                raise SolverError(f"{name} refuses the step of {h:g} s at {t:g} s: {report.message}")

    def _velocity_jump(self) -> Array:
        """W - W' at the end of the step, (n_coupling,)."""
        return np.array(
            [
                self._peers[c.first.peer].value(c.first.velocity) - self._peers[c.second.peer].value(c.second.velocity)
                for c in self._couplings
            ]
        )

    def _rewind(self, states: Mapping[str, bytes]) -> None:
        for name, state in states.items():
            self._peers[name].restore(state)
