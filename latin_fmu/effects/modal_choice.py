"""Whether the program marches an assembly by its modes where the scene leaves the choice to it, and the error of that.

It does where that march costs far less than that of the bodies, and its error can be estimated and is small: steps
longer than waves take through an element, few relative motions, faces that neither land nor are hit by a front.

Its error is estimated by a second march in steps twice as long with the modes up to half the frequency. Both leave out
what modes above their cut-off and shorter steps would add; an error of order p is the change from one to the other over
2^p - 1. Exact modes with static responses of those left out are of order two in both; contacts that open and slide are
of less: 2^p - 1 is taken as 2 for spectra and as 1.6 for all else. A change of more than a tenth follows no order, and
is the error. The friction work has the work of the errors of the iteration besides, which both share.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import replace
from typing import Any, Final, cast

import numpy as np

from ..assembly.models import KeptOperators
from ..assembly.problem import DiscretisedProblem, SolverReadyProblem
from ..assembly.propagator_choice import modes_refused
from ..fem.contact_layer import longest_edge
from ..joined.modal_problem import coarser_problem
from ..joined.reduced_run import steps_resolve_spectra
from ..joined.tied_assembly import Joints, TieError
from ..latin.outcome import InterfaceHistory, Outcome
from ..machine import memory_room, one_thread
from ..results.estimates import TruncationError
from ..results.solution import Solution
from ..run_quantities import measure_solution, relative
from ..scene.fields import split_face
from ..scene.quantity_table import definition_of
from ..scene.schema import Scene
from ..scene.settings import AutomaticPropagator, AutomaticScheme, ModalPropagatorTable

MOST_RELATIVE: Final = 4000
"""Relative motions at most: their stiffness is a dense matrix."""
_CHANGE: Final = 1.6  # change of a quantity over its error (module docstring)
_OF_SPECTRUM: Final = 2.0  # the same of a spectrum
_WITHOUT_ORDER: Final = 0.1  # change that no order of an error explains
_HISTORIES: Final = 9  # of a channel, of both marches, at an instant
_TRIED: Final = "the march by modes was tried, and "
_APART: Final = 0.1  # of the size of a body: contacts that move further meet other points


def tries_modes(discretised: DiscretisedProblem) -> bool:
    """Whether the march by modes suits a scene that leaves the choice to the program."""
    scene = discretised.scene
    automatic = isinstance(scene.solver.propagator, AutomaticPropagator) and isinstance(
        scene.time.scheme, AutomaticScheme
    )
    if not automatic or modes_refused(scene, False) or discretised.histories:
        return False
    # else bodies land, or a front reaches their faces
    if discretised.scheme.name != "hht":
        return False
    # the modes that a spectrum asks for take shorter steps
    if not steps_resolve_spectra(scene, discretised.dt):
        return False
    # motions and interfaces are in memory at every instant
    if scene.output.interfaces_every != 1 or not _fits(discretised):
        return False
    return 0 < _relative(discretised) <= MOST_RELATIVE and _long_steps(discretised)


def _fits(discretised: DiscretisedProblem) -> bool:
    """Whether the histories of both marches take less than half of the memory that there is."""
    need = 8.0 * _HISTORIES * len(discretised.time) * discretised.layout.n_flat
    room, limit = memory_room()
    return not limit or need < 0.5 * room


def by_choice(discretised: DiscretisedProblem) -> DiscretisedProblem:
    """The problem of a scene that asks for modes."""
    # not by its text: interfaces that a search has found are in the scene of the problem alone
    solver = discretised.scene.solver.model_copy(update={"propagator": ModalPropagatorTable()})
    return replace(discretised, scene=discretised.scene.model_copy(update={"solver": solver}))


def unfit(discretised: DiscretisedProblem, outcome: Outcome) -> str:
    """Why the march by modes that the program has chosen is given up before its error is estimated; empty where it is
    not."""
    if not outcome.converged:
        return f"{_TRIED}{outcome.status.partition('.')[0]}"
    if name := _apart(discretised, outcome.interfaces):
        return f"{_TRIED}the sides of {name} have moved on each other by more than a tenth of a body"
    return ""


def truncation_of(
    scene: Scene,
    discretised: DiscretisedProblem,
    problem: SolverReadyProblem,
    outcome: Outcome,
    march: Callable[[SolverReadyProblem], Outcome],
) -> tuple[TruncationError | None, str]:
    """Error of a march by modes that the program has chosen, and why it is given up; empty where it is not.

    discretised, problem, outcome : of the march, which is not ``unfit``. march : solves the problem whose march serves
    the estimate of it.
    """
    with one_thread():
        coarser = coarser_problem(discretised, problem.start, cast(Any, problem.reduced))
    other = march(coarser)
    if not other.converged:
        return None, f"{_TRIED}the one for the estimate of its error {other.status.partition('.')[0]}"
    truncation, most = truncation_error(scene, outcome, other), scene.solver.reduction_error
    if truncation.largest[1] <= most:
        return truncation, ""
    return None, f"{_TRIED}its error {truncation.in_words()} is above solver.reduction_error ({100 * most:.3g} %)"


def truncation_error(scene: Scene, fine: Outcome, coarse: Outcome) -> TruncationError:
    """Error of a march by modes, from one in longer steps with fewer modes (module docstring)."""
    first, second = (measure_solution(scene, solution_of(scene, outcome)) for outcome in (fine, coarse))
    asked = [q for q in first.values if not definition_of(q).unlimited]
    errors = {q: _error(relative(q, first, first, second), definition_of(q).distance == "spectrum") for q in asked}
    share = _work_of_errors(fine)
    for quantity in asked:
        if definition_of(quantity).unit == "J":
            errors[quantity] += share
    return TruncationError(errors, coarse)


def _error(change: float, of_spectrum: bool) -> float:
    """Relative error of a quantity from its change; NaN where one march does not have it."""
    if change > _WITHOUT_ORDER:
        return change
    return change / (_OF_SPECTRUM if of_spectrum else _CHANGE)


def solution_of(scene: Scene, outcome: Outcome) -> Solution:
    """What a scene has for a solution, without its fields."""
    return Solution(outcome, scene.text(), scene.name, sensor_tables=scene.sensor, units=scene.unit_system)


def _work_of_errors(outcome: Outcome) -> float:
    """Work of the errors of the iteration over what friction takes; 0 where energies are not followed."""
    energy = outcome.energy
    if energy is None or "drift_work" not in energy:
        return 0.0
    friction = float(np.abs(energy["friction_dissipation"]).max(initial=0.0))
    if friction > 0.0:
        return float(np.abs(energy["drift_work"]).max(initial=0.0)) / friction
    return 0.0


def _apart(discretised: DiscretisedProblem, interfaces: Mapping[str, InterfaceHistory]) -> str:
    """An interface whose sides have moved on each other by more than a share of the smaller body; empty for none."""
    for unit in discretised.units:
        history = interfaces.get(unit.name)
        if history is None or not unit.behaviour.opens:
            continue
        names = [name for name, _ in map(split_face, unit.sides) if name in discretised.bodies]
        size = min(float(np.ptp(discretised.bodies[name].mesh.nodes, axis=0).max()) for name in names)
        moved = np.cumsum(history.velocity[1:, 0] - history.velocity[1:, 1], axis=0) * discretised.dt
        if float(np.linalg.norm(moved, axis=2).max(initial=0.0)) > _APART * size:
            return unit.name
    return ""


def _relative(discretised: DiscretisedProblem) -> int:
    """Number of relative motions of contacts; 0 where a joint cannot be followed."""
    try:
        joints = Joints.of(discretised.units)
    except TieError:
        return 0
    return sum(discretised.layout.channels(i, 0).size for i in joints.relative)


def _long_steps(discretised: DiscretisedProblem) -> bool:
    """Whether waves cross every element of every elastic body within a step."""
    bodies = [body for body in discretised.bodies.values() if not body.rigid]
    meshes = [body.shape.mesh for body in bodies]
    known = discretised.kept or KeptOperators()
    edges = known.again("longest edges", tuple(meshes), lambda: [longest_edge(mesh) for mesh in meshes])
    transits = [edge / b.shape.fast_elasticity.bar_speed for edge, b in zip(edges, bodies, strict=True)]
    return bool(transits) and max(transits) <= discretised.dt
