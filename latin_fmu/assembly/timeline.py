"""What drives the substructures of a scene at the instants of a run."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from copy import copy
from types import MappingProxyType
from typing import Final

import numpy as np

from ..latin.assembly import Array, Assembly, GroundState, InterfaceUnit
from ..propagator import Histories, SubstructureModel
from ..scene.laws import sampled
from ..scene.schema import Scene
from .bolts import load_name
from .conditions import Conditions

NO_ELONGATION: Final[Mapping[str, Array]] = MappingProxyType({})
NO_RAMPS: Final[Mapping[str, tuple[float, float]]] = MappingProxyType({})


class Timeline:
    """Samples the laws of a scene; histories given from outside replace those laws.

    They are given by the name of a force (``Scene.force_laws``), ``boundary.NAME`` (``PrescribedMotion.velocity``), or
    ``ground.INTERFACE`` (amplitude of its velocity). ``bolts`` : first and last amplitude of the load term of each
    bolt, linear in between over the interval of the scene. ``elongation`` : plastic (n_step + 1,) of bolts at the
    instants of the scene, m, by which their shanks are shortened less.
    histories : (n_time,) of load terms that no law of the scene has, at the instants of ``begin``.
    """

    def __init__(
        self,
        scene: Scene,
        conditions: dict[str, Conditions],
        bolts: Mapping[str, tuple[float, float]] = NO_RAMPS,
        elongation: Mapping[str, Array] = NO_ELONGATION,
        histories: Mapping[str, Array] = NO_ELONGATION,
    ) -> None:
        self._scene = scene
        self._conditions = conditions
        self._laws = scene.force_laws
        self._bolts = {load_name(name): ramp for name, ramp in bolts.items()}
        self._elongation = {load_name(name): q for name, q in elongation.items()}
        self._histories = histories

    def of(self, scene: Scene) -> Timeline:
        """That of a scene with other laws of loads and driven faces, and nothing else."""
        made = copy(self)
        made._scene, made._laws = scene, scene.force_laws
        made._conditions = {name: of.with_laws_of(scene.boundary) for name, of in self._conditions.items()}
        return made

    def begin(
        self,
        assembly: Assembly,
        time: Array,
        amplitudes: Mapping[str, Array],
        ground_start: Mapping[int, GroundState],
        dt: float | None = None,
    ) -> None:
        """Set the instants of an assembly and of its propagators.

        Parameters
        ----------
        time : (n_time,), s. amplitudes : histories (n_time,) from outside by name. ground_start : see
            ``Assembly.begin``. dt : step of the operators, s; that of ``time`` where None (they may differ by
            round-off).
        """
        if dt is None:
            dt = float(time[1] - time[0])
        for propagator in assembly.propagators:
            propagator.begin([self.histories(member, time, amplitudes) for member in propagator.members], dt)
        assembly.begin(time, dt, self.ground(assembly.interfaces, time, amplitudes), ground_start)

    def histories(
        self, model: SubstructureModel, time: Array, prescribed: Mapping[str, Array] | None = None
    ) -> Histories:
        """Histories that drive one substructure at the instants; ``prescribed`` as the amplitudes for ``begin``."""
        amplitudes = [self._amplitude(load.name, time, prescribed or {}) for load in model.loads]
        clock = self._scene.time
        conditions = self._conditions[model.name]
        motion = conditions.driving(time, clock.quasi_static, prescribed or {}, clock.end)
        return Histories(time, amplitudes, motion, conditions.motion_kinds)

    def _amplitude(self, name: str, time: Array, prescribed: Mapping[str, Array]) -> Array:
        if not name:
            return np.ones(len(time))
        if name in self._histories:
            return self._histories[name]
        if name in self._bolts:
            first, last = self._bolts[name]
            ramp: Array = first + (last - first) * time / self._scene.time.end
            if name in self._elongation:
                q = self._elongation[name]
                ramp = ramp - np.interp(time, np.linspace(0.0, self._scene.time.end, len(q)), q)
            return ramp
        if name in prescribed:
            return prescribed[name]
        return sampled(self._laws[name], time)

    def ground(
        self, interfaces: Sequence[InterfaceUnit], time: Array, amplitudes: Mapping[str, Array] = NO_ELONGATION
    ) -> dict[int, Array]:
        """Velocities (n_time, 3) of the ground by interface, m s-1; ``amplitudes`` as for ``begin``."""
        ground = {}
        for i, unit in enumerate(interfaces):
            if not unit.against_ground:
                continue
            moving = self._scene.joints[unit.name].ground_velocity
            ground[i] = np.zeros((len(time), 3))
            if moving is not None:
                amplitude = amplitudes.get(f"ground.{unit.name}", moving.law.sample(time))
                ground[i] = amplitude[:, None] * np.asarray(moving.vector)
            if self._scene.time.quasi_static:  # over the step that ends at each instant
                ground[i][1:] = 0.5 * (ground[i][1:] + ground[i][:-1])
        return ground
