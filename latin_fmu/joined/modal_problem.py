"""A scene turned into an assembly that is marched by its modes (``reduced_run``)."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import replace

import numpy as np

from ..assembly.body import Body
from ..assembly.body_motions import standing_bodies
from ..assembly.initial_state import InitialState
from ..assembly.problem import DiscretisedProblem, SolverReadyProblem, ready
from ..machine import give_back_memory
from ..remarks import remarks_of
from ..time_scheme import MasslessContact
from .reduced_run import ReducedMarch, reduced_march


def modal_problem(
    discretised: DiscretisedProblem, start: InitialState | None, finer: ReducedMarch | None = None
) -> SolverReadyProblem:
    """The problem with its assembly ready to be marched by modes, from an equilibrium where there is one; ``finer`` : a
    march in shorter steps, of whose modes some are taken.

    Raises
    ------
    TieError : an assembly that cannot be.
    """
    classes, assembly, timeline = standing_bodies(discretised, start, MasslessContact())
    give_back_memory()  # of the static start
    viscosities = viscosities_of(discretised.bodies)
    march = reduced_march(discretised.scene, classes, assembly, start, viscosities, finer, discretised.kept)
    warnings = (*discretised.remarks, *(() if start is None else remarks_of("start", start.remarks)))
    return ready(discretised, assembly, (warnings, timeline, start, march.scheme_in_words, {}), march)


def viscosities_of(bodies: Mapping[str, Body]) -> dict[str, float]:
    """b of the damping b K by strains, s, by body."""
    return {n: 0.0 if body.rigid else body.shape.material.damping.viscosity for n, body in bodies.items()}


def coarser_problem(
    discretised: DiscretisedProblem, start: InitialState | None, march: ReducedMarch
) -> SolverReadyProblem:
    """The problem in steps twice as long and with fewer modes, for the estimate of the error of ``march``; histories of
    contacts, sensors and bolts alone."""
    count = -(-discretised.scene.time.n_step // 2)
    time = np.linspace(0.0, discretised.scene.time.end, count + 1)
    problem = modal_problem(replace(discretised, time=time), start, march)
    output = replace(problem.output, energy=False, fields=False, stress=False, supports={})
    return replace(problem, output=replace(output, contacts_alone=True, bond_resultants=False))
