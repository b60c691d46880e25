"""What acts at t = 0 on a scene that starts from initial values, and whether its stress may count."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import replace
from typing import Final

import numpy as np

from ..assembly.body import Body
from ..assembly.problem import DiscretisedProblem
from ..scene.fields import ALL_OF_IT
from ..scene.settings import StaticStart
from .statics import something_acts, start_problems, static_scene, static_size

NEGLIGIBLE: Final = 0.01
"""Change of a natural frequency below which stress is left out."""
STOUT: Final = 6.0
"""Strain times square of slenderness over mu: columns that are clamped at one end have less."""


def loaded_at_rest(problem: DiscretisedProblem, amplitudes: Mapping[str, float]) -> DiscretisedProblem | None:
    """The problem of a scene that starts from initial values with the static start that stresses its bodies; None where
    nothing acts at t = 0, where bodies are thrown or held by nothing, where the loads are too small for their stress to
    count, or where the scene leaves it out."""
    scene = problem.scene
    if scene.effects.prestress == "off" or scene.time.quasi_static:
        return None
    resting = scene.model_copy(update={"time": scene.time.model_copy(update={"start": StaticStart()})})
    conditions = {name: problem.conditions[name] for name in problem.bodies}
    if any(start_problems(resting, dict(problem.bodies), conditions, list(problem.units))):
        return None
    if not something_acts(static_scene(resting, amplitudes)):
        return None
    at_rest = replace(problem, scene=resting)
    if scene.effects.prestress == "automatic" and _little(at_rest, amplitudes):
        return None
    return at_rest


def _little(problem: DiscretisedProblem, amplitudes: Mapping[str, float]) -> bool:
    """Whether the loads of t = 0 are too small for their stress to count, bent parts of the size of the assembly
    included; rigid bodies, which have no vibrations, aside."""
    size, strain = static_size(problem, amplitudes), 0.0
    nodes = np.concatenate([body.mesh.nodes for body in problem.bodies.values()])
    length = float(np.linalg.norm(np.ptp(nodes, axis=0)))
    for body in problem.bodies.values():
        if not body.rigid:
            slender = length / thickness(body)
            strain = max(strain, size / body.shape.elasticity.young_moduli[0] * slender**3)
    return STOUT * strain <= 2.0 * NEGLIGIBLE


def thickness(body: Body) -> float:
    """Twice the volume over the surface, m: that of a plate."""
    return 2.0 * float(body.shape.elements.volume.sum()) / float(body.face(ALL_OF_IT).areas.sum())
