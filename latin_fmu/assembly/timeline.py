"""Histories of loads and motions of a scene over the instants of a run or of a segment of it."""

from __future__ import annotations

from collections.abc import Mapping

import numpy as np

from ..fem.mesh import Array
from ..latin.assembly import Assembly, GroundState
from ..propagator import Histories, SubstructureModel
from ..scene.schema import Scene
from .conditions import Conditions


class Timeline:
    """Samples the laws of a scene; amplitudes given from outside replace the law of a load."""

    def __init__(self, scene: Scene, conditions: dict[str, Conditions]) -> None:
        self._scene, self._conditions = scene, conditions

    def begin(
        self,
        assembly: Assembly,
        time: Array,
        given: Mapping[str, Array],
        ground_start: Mapping[int, GroundState],
        dt: float | None = None,
    ) -> None:
        """Set the instants of an assembly and of its propagators.

        Parameters
        ----------
        time : (n_time,), s. given : amplitude (n_time,) of loads by name. ground_start : see ``Assembly.begin``.
        dt : step of the operators, s; that of ``time`` where None (they may differ by round-off).
        """
        dt = float(time[1] - time[0]) if dt is None else dt
        for propagator in assembly.propagators:
            propagator.begin([self.histories(member, time, given) for member in propagator.members], dt)
        assembly.begin(time, dt, self._ground(assembly, time), ground_start)

    def histories(self, model: SubstructureModel, time: Array, given: Mapping[str, Array] | None = None) -> Histories:
        """What drives one substructure at the instants; ``given`` as for ``begin``."""
        amplitudes = [self._amplitude(load.name, time, given or {}) for load in model.loads]
        motion = self._conditions[model.name].velocity(time, over_steps=self._scene.time.quasi_static)
        return Histories(time, amplitudes, motion)

    def _amplitude(self, name: str, time: Array, given: Mapping[str, Array]) -> Array:
        if not name:
            return np.ones(len(time))
        return given[name] if name in given else self._scene.load[name].law.sample(time)

    def _ground(self, assembly: Assembly, time: Array) -> dict[int, Array]:
        ground = {}
        for i, unit in enumerate(assembly.interfaces):
            if not unit.against_ground:
                continue
            moving = self._scene.interface[unit.name].ground_velocity
            ground[i] = np.zeros((len(time), 3))
            if moving is not None:
                ground[i] = moving.law.sample(time)[:, None] * np.asarray(moving.vector)
            if self._scene.time.quasi_static:  # over the step that ends at each instant
                ground[i][1:] = 0.5 * (ground[i][1:] + ground[i][:-1])
        return ground
