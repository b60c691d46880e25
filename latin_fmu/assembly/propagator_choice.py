"""Which propagator marches the substructures of a scene, and whether its step is stable."""

from __future__ import annotations

import numpy as np

from ..errors import Problem
from ..propagator import Propagator
from ..propagator.explicit import ExplicitPropagator
from ..propagator.registry import Kind, PropagatorSettings
from ..scene.propagator_relations import CENTRAL
from ..scene.propagator_settings import AutomaticPropagator, ReducedPropagator
from ..scene.schema import Scene
from .cost import fitting
from .models import ModelClass


def chosen_propagators(scene: Scene, classes: list[ModelClass]) -> tuple[PropagatorSettings, list[str]]:
    """Settings of the propagators, and what is to be said of an automatic choice."""
    asked = propagator_settings(scene)
    if scene.time.quasi_static or not isinstance(scene.solver.propagator, AutomaticPropagator):
        return asked, []
    chosen = fitting(classes, asked)
    if chosen.kind == asked.kind:
        return asked, []
    told = "the factors do not fit in the memory of this machine: conjugate gradients are used, which are slow"
    return chosen, [told]


def propagator_settings(scene: Scene) -> PropagatorSettings:
    """Settings of the propagators."""
    asked = scene.solver.propagator
    if isinstance(asked, AutomaticPropagator):
        kind: Kind = "explicit" if scene.time.scheme.type == CENTRAL else "direct"
        return PropagatorSettings(kind, precision=scene.solver.precision)
    if isinstance(asked, ReducedPropagator):
        return PropagatorSettings("reduced", modes=asked.modes)
    return PropagatorSettings(asked.type, precision=scene.solver.precision)


def unstable_steps(propagators: list[Propagator], scene: Scene, dt: float) -> list[Problem]:
    """The explicit march with a step that is too long."""
    explicit = [p for p in propagators if isinstance(p, ExplicitPropagator)]
    if all(p.stability.allows(dt) for p in explicit):
        return []
    shortest = min(explicit, key=lambda p: p.stability.longest)
    longest = shortest.stability.longest
    return [
        Problem(
            "time.step" if scene.time.step is not None else "time.instants",
            f"the step is longer than the stable one of the explicit propagator (substructure {shortest.names[0]})",
            f"a step of {dt:.6g} s",
            f"at most {longest:.6g} s",
            f"give [time] instants = {int(np.ceil(scene.time.end / longest))} or more, "
            "or choose an implicit propagator",
        )
    ]
