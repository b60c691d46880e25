"""A scene turned into an assembly that is marched by its modes (``reduced_run``)."""

from __future__ import annotations

from ..machine import give_back_memory
from ..remarks import remarks_of
from ..time_scheme import MasslessContact
from .body_motions import standing_bodies
from .initial_state import InitialState
from .problem import DiscretisedProblem, SolverReadyProblem, ready
from .reduced_run import reduced_march


def modal_problem(discretised: DiscretisedProblem, start: InitialState | None) -> SolverReadyProblem:
    """The problem with its assembly ready to be marched by modes, from an equilibrium where there is one.

    Raises
    ------
    TieError : an assembly that cannot be.
    """
    classes, assembly, timeline = standing_bodies(discretised, start, MasslessContact())
    give_back_memory()  # of the static start
    bodies = discretised.bodies.items()
    viscosities = {n: 0.0 if body.rigid else body.shape.material.damping.viscosity for n, body in bodies}
    march = reduced_march(discretised.scene, classes, assembly, start, viscosities)
    warnings = (*discretised.remarks, *(() if start is None else remarks_of("start", start.remarks)))
    return ready(discretised, assembly, (warnings, timeline, start, march.scheme_in_words, {}), march)
