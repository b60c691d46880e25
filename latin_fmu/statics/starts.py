"""The state that a run starts from, where its scene has a static start: bolts tightened, loads of t = 0 applied,
bodies that it leaves free in their places, initial displacements added."""

from __future__ import annotations

import gc
from collections.abc import Mapping
from typing import Final

import numpy as np

from ..assembly.body import Body
from ..assembly.conditions import Conditions
from ..assembly.initial_state import InitialState, state_arrays, state_of
from ..assembly.models import Kept, store_of
from ..assembly.press_fits import fits
from ..assembly.problem import DiscretisedProblem
from ..errors import Problems
from ..latin.assembly import InterfaceUnit
from ..remarks import Remark, remarks_of
from ..scene.schema import Scene
from .free_bodies import acting, free_groups, free_remarks, unheld, with_place
from .places_at_rest import least_displaced
from .statics import (
    Stage,
    fitted,
    start_data,
    start_problems,
    start_remarks,
    static_operator_data,
    static_size,
    static_state,
    tightened,
)

_LARGE: Final = 5000  # nodes from which on what a static start leaves behind is looked for, which takes 0.1 s


def checked_equilibrium(
    scene: Scene,
    bodies: dict[str, Body],
    conditions: dict[str, Conditions],
    units: list[InterfaceUnit],
    problems: Problems,
    remarks: list[Remark],
) -> dict[str, Conditions]:
    """The conditions with a place for bodies that nothing holds, of a scene without inertia or with a static start;
    loads that nothing holds are added to ``problems``."""
    if scene.time.quasi_static:
        groups = free_groups(bodies, conditions, units)
        instants = np.linspace(0.0, scene.time.end, scene.time.n_step + 1)
        problems += unheld(groups, acting(scene, bodies, instants[1:]), conditions, "quasi_static")
        if groups and not problems:
            remarks += remarks_of("free", free_remarks(groups))
            return with_place(groups, bodies, conditions, units)
        return conditions
    problems += start_problems(scene, bodies, conditions, units)
    if not problems:
        remarks += remarks_of("free", start_remarks(scene, bodies, conditions, units))
    return conditions


def undisplaced_equilibrium(
    discretised: DiscretisedProblem, amplitudes: Mapping[str, float], stages: list[Stage] | None = None
) -> InitialState | None:
    """The equilibrium that a scene starts from, its bolts tight, without the initial displacements that are added to
    it and the stiffness of its stress; None where it has none (see ``building.started``). What was solved for it is
    added to ``stages``. It is read from the folder of operators where it is stored there."""
    if discretised.scene.time.start.type != "static":
        return None
    store, known = store_of(discretised.scene), discretised.kept
    # derivatives need what was solved; laws of the caller have no digest
    if stages is not None or not all(map(_own_law, discretised.units)):
        return solved_equilibrium(discretised, amplitudes, stages)
    if store.folder is None:
        if known is None:
            return solved_equilibrium(discretised, amplitudes, stages)
        operators: Kept = known.again("static operators", tuple(static_operator_data(discretised)), dict)
        data = tuple(start_data(discretised, amplitudes))
        return known.again("start", data, lambda: solved_equilibrium(discretised, amplitudes, None, operators))
    name = store.name("start", *start_data(discretised, amplitudes))
    # a state of a few numbers may have taken minutes
    arrays = store.remember(name, lambda: state_arrays(solved_equilibrium(discretised, amplitudes, None)), smallest=0)
    return state_of(arrays)


def _own_law(unit: InterfaceUnit) -> bool:
    """Whether the law of an interface is one of the package."""
    return type(unit.behaviour).__module__.startswith(f"{__name__.partition('.')[0]}.")


def solved_equilibrium(
    discretised: DiscretisedProblem,
    amplitudes: Mapping[str, float],
    stages: list[Stage] | None = None,
    kept: Kept | None = None,
) -> InitialState | None:
    """As ``undisplaced_equilibrium``, solved. kept : operators of static problems, used again and added to."""
    operators: Kept = {}
    if kept is not None:
        operators = kept
    tight = None
    if fits(discretised.units):
        tight = fitted(discretised, operators, stages)
    if discretised.cuts:
        tight = tightened(discretised, operators, stages, tight)
    state = static_state(discretised, amplitudes, tight, operators, stages)
    # without inertia the places follow from increment to increment
    if state is not None and not discretised.scene.time.quasi_static:
        state = least_displaced(discretised, state, static_size(discretised, amplitudes))
    if stages is not None or kept is not None:
        return state
    operators.clear()
    # runs and their images refer to each other: without this the static factors stay beside those of the march
    if sum(body.mesh.n_node for body in discretised.bodies.values()) > _LARGE:
        gc.collect()
    return state
