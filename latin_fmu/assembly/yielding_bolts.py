"""Bolts that yield: the plastic elongation of their shanks, from run to run.

A shank that yields has a plastic elongation q, and the shortening delta - q (``bolts``). With kinematic hardening the
tension is within F_y of H q,

    |F - H q| <= F_y,    dq/dt (F - H q) = F_y |dq/dt|

q is a history of the whole run, found by repeated runs (``Yielding``). The joint loses at the instant i the tension
kappa_i q_i + sum_(j < i) h_(i-j) q_j; the tension of a run and its loss give the tension without q, and the law gives
the next q. In statics h = 0, and kappa is the tension over the shortening of the tightening, then the slope between two
runs at every instant. In motion both are differences of the response to a step, for which one run is made. A run after
which the elongations would still change is not trustworthy.
Runs that do not yield are not repeated.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Final

import numpy as np

from ..errors import SceneError
from ..fem.mesh import Array
from ..latin.outcome import BoltHistory
from ..scene.schema import Scene

_LEAST: Final = 1e-3  # of the largest change of an elongation: smaller ones give no slope
_BOUNDS: Final = 1e-4, 1e2  # of kappa over that of the tightening: an open joint loses next to nothing
_RUNS: Final = 20  # most runs until the plastic elongations stay
_STAYS: Final = 1e-8  # of the yield force: change of a tension by that of the elongation between two runs
_OF_TOLERANCE: Final = 0.1  # the same as a share of the tolerance of the runs


@dataclass
class TensionLoss:
    """What the tension of a bolt loses by its plastic elongation (module docstring).

    Attributes
    ----------
    kappa : (n_time,) at the same instant, N m-1. memory : (n,) h_1, h_2, ... at later ones, N m-1.
    """

    kappa: Array
    memory: Array

    def of(self, q: Array) -> Array:
        """Loss (n_time,), N, by q (n_time,), m."""
        if len(self.memory):
            past = np.convolve(self.memory, q)[: len(q) - 1]
        else:
            past = np.zeros(len(q) - 1)
        return np.asarray(self.kappa * q + np.concatenate([[0.0], past]))

    def elongation(self, trial: Array, yield_force: float, hardening: float) -> Array:
        """Plastic elongation q (n_time,), m, where the tension without it is ``trial`` (n_time,), N; ``hardening`` H,
        N m-1. The law is rate-independent: q changes where F - H q = +-F_y only."""
        plastic, q = np.zeros(len(trial)), 0.0
        for i, force in enumerate(trial):
            n = min(i, len(self.memory))
            past = float(self.memory[:n] @ plastic[i - n : i][::-1])
            slope = self.kappa[i] + hardening
            over = force - past - slope * q
            if abs(over) > yield_force:
                q = (force - past - np.copysign(yield_force, over)) / slope
            plastic[i] = q
        return plastic


class Yielding:
    """Plastic elongations of the bolts of a scene, from run to run.

    Attributes
    ----------
    tables : of the bolts that may yield. elongation : (n_time,) of each of them, m, at the instants of the next run;
        empty before the first one.
    """

    def __init__(self, scene: Scene) -> None:
        self.tables = {n: b for n, b in scene.bolt.items() if b.hardening is not None}
        materials = {n: scene.material[scene.substructure[b.substructure].material] for n, b in self.tables.items()}
        self._stress = {n: m.yield_stress or 0.0 for n, m in materials.items()}
        self._stays = max(_STAYS, _OF_TOLERANCE * scene.solver.tolerance)
        self._units, self._still = scene.unit_system, scene.time.quasi_static
        self.elongation: dict[str, Array] = {}
        self._before: dict[str, tuple[Array, Array]] = {}  # elongation and tension of the run before
        self._losses: dict[str, TensionLoss] = {}
        self._runs, self._change = 0, 0.0

    def goes_on(self, bolts: Mapping[str, BoltHistory]) -> bool:
        """Take the tensions of a run; whether another one with the new ``elongation`` is needed.

        Raises
        ------
        SceneError : a bolt yields before the motion begins.
        """
        self._runs, self._change = self._runs + 1, 0.0
        new = {}
        for name, table in self.tables.items():
            force, limit = bolts[name].force, self._stress[name] * bolts[name].stress_area
            q, hardening = self.elongation.get(name, np.zeros(len(force))), table.hardening or 0.0
            if not self._still and force[0] > limit:
                raise self._yields_at_once(name, float(force[0]), limit)
            lost = self._loss_of(bolts[name], q)
            new[name] = lost.elongation(force + lost.of(q), limit, hardening)
            self._change = max(self._change, float((lost.kappa * np.abs(new[name] - q)).max() / limit))
            if not self._still and name not in self._before and (yields := np.flatnonzero(new[name])).size:
                # a step, for its loss
                new[name] = np.where(np.arange(len(q)) < yields[0], 0.0, np.abs(new[name]).max())
            self._before[name] = q, force
        if self._change <= self._stays or self._runs == _RUNS:
            return False
        self.elongation = new
        return True

    def _loss_of(self, bolt: BoltHistory, q: Array) -> TensionLoss:
        """The loss by q as far as the runs so far give it."""
        first = bolt.tight / bolt.shortening
        if bolt.name not in self._before:
            return self._losses.setdefault(bolt.name, TensionLoss(np.full(len(q), first), np.zeros(0)))
        step, loss = q - self._before[bolt.name][0], self._before[bolt.name][1] - bolt.force
        lost = self._losses[bolt.name]
        low = _BOUNDS[0] * first
        high = _BOUNDS[1] * first
        if self._still:
            changed = np.abs(step) > _LEAST * np.abs(step).max()
            lost.kappa[changed] = np.clip(loss[changed] / step[changed], low, high)
        elif not len(lost.memory) and step.any():
            begin = int(np.flatnonzero(step)[0])
            to_step = loss[begin:] / step[begin]
            lost.kappa[:], lost.memory = max(to_step[0], low), np.diff(to_step)
        return lost

    def _yields_at_once(self, name: str, force: float, limit: float) -> SceneError:
        n = self._units["N"]
        return SceneError.of(
            "the scene cannot be solved",
            f"bolt.{name}",
            "the shank yields in the static start, before the run follows its plastic elongation",
            f"{force:.6g} {n}",
            f"at most {limit:.6g} {n}",
            "tighten the bolt less, or let loads and temperatures grow from zero in the run",
        )

    def words(self) -> dict[str, str]:
        """Plastic elongations at the end and the number of runs, for the choices of a run; empty where none yielded."""
        parts = [
            f"{name} by {q[-1]:.4g} {self._units['m']}" for name, q in self.elongation.items() if np.abs(q).max() > 0.0
        ]
        if parts:
            return {"bolts that yield": f"{', '.join(parts)}; {self._runs} runs"}
        return {}

    def faults(self) -> tuple[str, ...]:
        """Why the end of the last run is not trustworthy: the elongations still changed in it."""
        if self._change <= self._stays:
            return ()
        return (
            f"plastic elongations of bolts change their tension by {self._change:.2g} of the yield force in the last "
            f"of {self._runs} runs (allowed: {self._stays:.2g})",
        )
