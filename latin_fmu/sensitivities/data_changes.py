"""What a parameter changes in the data of a run: loads, motions, initial values, gaps and laws.

Every change is the central difference of two discretised scenes, exact where the data is linear in the parameter.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, replace
from functools import cached_property
from typing import Final

import numpy as np
import scipy.sparse as sp

from ..assembly.bolts import load_name
from ..assembly.problem import DiscretisedProblem
from ..interface.laws import coulomb_coefficient
from ..latin.assembly import Array, Assembly, InterfaceUnit, Layout
from ..latin.probes import BoltPlace
from ..propagator import Histories, LoadTerm, SubstructureModel
from ..statics.statics import Stage
from .copies import MARK, models_of

MATRICES: Final = ("mass", "damping", "stiffness")
"""Of a body."""
_BALANCED: Final = 1e30
"""Traction beside which these forces count as balanced, Pa."""
Ends = tuple[DiscretisedProblem, DiscretisedProblem]
"""The problems of a stage with a parameter a little larger and a little smaller."""


@dataclass(frozen=True)
class VariedParameter:
    """A parameter of a scene, and the problems with it a little larger and a little smaller. span : their difference
    over the value, or over 1 where that is 0. Derivatives are changes for so much, of like size for all."""

    name: str
    value: float
    span: float
    more: DiscretisedProblem
    less: DiscretisedProblem

    def of(self, more: Array, less: Array) -> Array:
        """Derivative of data from its two values."""
        return np.asarray((more - less) / self.span)

    @cached_property
    def changes_bodies(self) -> bool:
        """Whether it changes mass or stiffness of a body."""
        return self._changes("mass") or self._changes("stiffness")

    @cached_property
    def changes_damping(self) -> bool:
        """Whether it changes the damping of a body."""
        less = models_of(self.less)
        relaxing = any(model.branches != less[name].branches for name, model in models_of(self.more).items())
        return relaxing or self._changes("damping")

    def _changes(self, matrix: str) -> bool:
        less = models_of(self.less)
        pairs = ((getattr(model, matrix), getattr(less[name], matrix)) for name, model in models_of(self.more).items())
        return any((a is None) != (b is None) or slope_of(a, b, self.span) is not None for a, b in pairs)


def slope_of(more: sp.csr_array | None, less: sp.csr_array | None, span: float) -> sp.csr_array | None:
    """Derivative of a matrix; None where it does not change."""
    if more is None or less is None or more is less:
        return None
    slope = sp.csr_array((more - less) / span)
    if abs(slope).max() > 0.0:
        return slope
    return None


@dataclass(frozen=True)
class StateChange:
    """Derivative of an initial state, fields as in ``InitialState``; ``tension`` of the bolts, N."""

    displacement: Mapping[str, Array] = field(default_factory=dict)
    traction: Mapping[str, Array] = field(default_factory=dict)
    closure: Mapping[str, Array] = field(default_factory=dict)
    shortening: Mapping[str, float] = field(default_factory=dict)
    tension: Mapping[str, float] = field(default_factory=dict)


def changed_unit(
    unit: InterfaceUnit, parameter: VariedParameter, ends: tuple[InterfaceUnit, InterfaceUnit]
) -> InterfaceUnit:
    """An interface with the derivatives of its gap and preload."""
    more, less = ends
    geometry = replace(unit.geometry, gap=parameter.of(more.geometry.gap, less.geometry.gap))
    return replace(unit, geometry=geometry, preload=(more.preload - less.preload) / parameter.span)


def changed_model(
    model: SubstructureModel,
    time: Array,
    parameter: VariedParameter,
    ends: Ends,
    state: StateChange,
    ramps: Mapping[str, tuple[float, float]],
) -> tuple[SubstructureModel, Histories]:
    """A substructure with the derivatives of its loads, motions and initial values; ``ramps`` of the bolts."""
    more, less = (models_of(end)[model.name] for end in ends)
    driven = [end.timeline.histories(source, time) for end, source in zip(ends, (more, less), strict=True)]
    loads, amplitudes = list[LoadTerm](), list[Array]()
    for source, history, sign in zip((more, less), driven, (1.0, -1.0), strict=True):
        for load, amplitude in zip(source.loads, history.amplitudes, strict=True):
            same = next((k for k, other in enumerate(loads) if np.array_equal(other.pattern, load.pattern)), len(loads))
            if same == len(loads):
                loads.append(replace(load, name=f"{MARK}{load.name}"))
                amplitudes.append(np.zeros(len(time)))
            amplitudes[same] = amplitudes[same] + sign / parameter.span * amplitude
    for load in model.loads:
        first, last = ramps.get(load.name, (0.0, 0.0))
        if first or last:
            loads.append(load)
            amplitudes.append(first + (last - first) * time / time[-1])
    copy = replace(
        model,
        loads=loads,
        displacement=state.displacement.get(model.name, parameter.of(more.displacement, less.displacement)),
        velocity=parameter.of(more.velocity, less.velocity),
        imposed_start=parameter.of(more.imposed_start, less.imposed_start),
        imposed_speed=None
        if more.imposed_speed is None or less.imposed_speed is None
        else parameter.of(more.imposed_speed, less.imposed_speed),
    )
    motion = parameter.of(driven[0].imposed, driven[1].imposed)
    return copy, Histories(time, amplitudes, motion, driven[0].motion_kinds)


def ramp_changes(stage: Stage, parameter: VariedParameter, state: StateChange) -> dict[str, tuple[float, float]]:
    """Derivatives of the first and last amplitude of the load terms of the bolts."""
    changes = {}
    for name, cut in stage.problem.cuts.items():
        locked = state.shortening.get(name, 0.0)
        changes[load_name(name)] = locked, locked
        if name in stage.tightened:
            force, shortening = bolt_changes(parameter, name)
            changes[load_name(name)] = (state.tension.get(name, 0.0), force) if cut.loose else (0.0, shortening)
    return changes


def bolt_changes(parameter: VariedParameter, name: str) -> tuple[float, float]:
    """Derivatives of the force and of the shortening that a bolt is given."""
    more, less = parameter.more.cuts[name], parameter.less.cuts[name]
    force = (more.tension or 0.0) - (less.tension or 0.0)
    shortening = (more.table.shortening or 0.0) - (less.table.shortening or 0.0)
    return force / parameter.span, shortening / parameter.span


def friction_changes(parameter: VariedParameter) -> dict[str, float]:
    """Derivatives of the friction coefficients by interface."""
    pairs = zip(parameter.more.units, parameter.less.units, strict=True)
    return {
        m.name: ((coulomb_coefficient(m.behaviour) or 0.0) - (coulomb_coefficient(s.behaviour) or 0.0)) / parameter.span
        for m, s in pairs
    }


def law_changes(parameter: VariedParameter, more: Layout, less: Layout) -> list[tuple[Array, Array, float] | None]:
    """Parameters of the laws of every group at both ends, None where they are equal."""
    return [
        None if np.array_equal(m.parameters, s.parameters) else (m.parameters, s.parameters, parameter.span)
        for m, s in zip(more.groups, less.groups, strict=True)
    ]


def ground_changes(base: Assembly, parameter: VariedParameter, ends: Ends) -> dict[int, Array]:
    """Derivatives of the velocities of the ground by number of the interface."""
    more, less = (end.timeline.ground(base.interfaces, end.time) for end in ends)
    return {i: parameter.of(more[i], less[i]) for i in more}


def changed_bolt(bolt: BoltPlace) -> BoltPlace:
    """A bolt whose tension is read with the derivatives of loads: a temperature has another name among these."""
    return replace(bolt, terms=dict(bolt.terms) | {f"{MARK}{load}": t for load, t in bolt.terms.items()})


def hand_over(states: Sequence[StateChange], assembly: Assembly) -> None:
    """Give an assembly the derivatives of the tractions that it starts with, and of its gaps, as ``InitialState`` does
    those themselves."""
    for i, unit in enumerate(assembly.interfaces):
        copy, _, name = unit.name.partition(MARK)
        state = states[int(copy)]
        if name in state.traction:
            assembly.start_tractions[i] = state.traction[name]
        if name in state.closure and not assembly.quasi_static:
            group = assembly.layout.group(i)
            group.gap[group.members[i]] = unit.geometry.gap - state.closure[name]


def balance_start(stage: Stage, assembly: Assembly) -> None:
    """Let unbalanced forces of the derivatives of a start in equilibrium, which does not accelerate, count as
    balanced."""
    settled = stage.start is not None and not stage.start.sets_off
    if settled and not any(s.motion_keys for s in stage.problem.scene.substructure.values()):
        assembly.characteristic_traction = _BALANCED
