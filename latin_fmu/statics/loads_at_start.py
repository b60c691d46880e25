"""What acts at t = 0 on a scene that starts from initial values, and whether it stresses bodies that stand or are held.

Initial values say nothing of what presses a body: a block that is kicked by an initial spin stands under its weight all
the same. The state whose stress has a stiffness is the equilibrium without them. A body that nothing holds at t = 0,
and that no contact that is closed then does, is in flight, and has no stress.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import replace
from typing import Any, Final

import numpy as np

from ..assembly.problem import DiscretisedProblem
from ..errors import SceneError
from ..scene.initial_fields import DISPLACEMENT_FIELDS, VELOCITY_FIELDS
from ..scene.settings import StaticStart
from .free_bodies import BALANCED, acting, free_groups
from .statics import something_acts, start_problems, static_scene

_ZERO = (0.0, 0.0, 0.0)
_AT_REST: Final[dict[str, Any]] = {
    **dict.fromkeys(("initial_velocity", "initial_spin", "initial_displacement"), _ZERO),
    **dict.fromkeys((*VELOCITY_FIELDS, *DISPLACEMENT_FIELDS)),
}
_LEFT_OUT: Final = (0.0, 0.0, 1.0)  # any velocity: a static start leaves out what moves


def loaded_at_rest(problem: DiscretisedProblem, amplitudes: Mapping[str, float]) -> DiscretisedProblem | None:
    """The problem of a scene that starts from initial values and asks for the stiffness of stress, with the start
    that stresses its bodies, and without initial values but of bodies in flight; None where nothing acts on others."""
    scene = problem.scene
    if scene.effects.prestress != "on" or scene.time.quasi_static:
        return None
    flying = in_flight(problem)
    tables = {
        name: table.model_copy(update=_AT_REST | ({"initial_velocity": _LEFT_OUT} if name in flying else {}))
        for name, table in scene.substructure.items()
    }
    start = scene.time.model_copy(update={"start": StaticStart()})
    resting = scene.model_copy(update={"time": start, "substructure": tables})
    conditions = {name: problem.conditions[name] for name in problem.bodies}
    if any(start_problems(resting, dict(problem.bodies), conditions, list(problem.units))):
        return None
    try:
        if not something_acts(static_scene(resting, amplitudes)):
            return None
    except SceneError:  # what no static start has
        return None
    return replace(problem, scene=resting)


def in_flight(problem: DiscretisedProblem) -> list[str]:
    """Bodies whose loads at t = 0 nothing balances that holds them, closed contacts among it."""
    # where bodies start from initial values alone: no need of the assembly in every run
    from ..joined.joined_assembly import touching

    joined = [unit for unit in problem.units if not unit.behaviour.opens or touching(unit).any()]
    forces = acting(problem.scene, problem.bodies, np.zeros(1))
    groups = free_groups(problem.bodies, problem.conditions, joined)
    return [name for group in groups if group.work(forces)[0] > BALANCED for name in group.motions]
