"""What acts at t = 0 on a scene that starts from initial values, and whether it stresses bodies at rest."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import replace

from ..assembly.problem import DiscretisedProblem
from ..errors import SceneError
from ..scene.settings import StaticStart
from .statics import something_acts, start_problems, static_scene


def loaded_at_rest(problem: DiscretisedProblem, amplitudes: Mapping[str, float]) -> DiscretisedProblem | None:
    """The problem of a scene that starts from initial values and asks for the stiffness of stress, with the start
    that stresses its bodies; None where nothing acts at t = 0, or bodies are thrown, or held by nothing."""
    scene = problem.scene
    if scene.effects.prestress != "on" or scene.time.quasi_static:
        return None
    resting = scene.model_copy(update={"time": scene.time.model_copy(update={"start": StaticStart()})})
    conditions = {name: problem.conditions[name] for name in problem.bodies}
    try:
        if any(start_problems(resting, dict(problem.bodies), conditions, list(problem.units))):
            return None
        if not something_acts(static_scene(resting, amplitudes)):
            return None
    except SceneError:  # initial fields, which no static start has
        return None
    return replace(problem, scene=resting)
