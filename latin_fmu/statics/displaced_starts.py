"""Static starts of bodies that are pulled back: initial displacements on top of the equilibrium.

A static start finds the displacements u of the equilibrium under what acts at t = 0. Initial displacements d of bodies
at rest are counted from there, and the run starts at u + d, out of balance by the forces of d: layers and springs have
the tractions of their new jump, contacts that d opens have none, and those that stay closed keep theirs.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import replace
from typing import Final

import numpy as np

from ..assembly.body import Body, body_sides
from ..assembly.conditions import Conditions, RigidConditions
from ..assembly.initial_state import InitialState
from ..assembly.problem import DiscretisedProblem
from ..errors import Problems, SceneError
from ..fem.mesh import Array
from ..latin.assembly import InterfaceUnit
from ..propagator.model import resting
from ..scene.schema import Scene
from .falling_bodies import falling_in

_CLOSED: Final = 1e-9  # of the size of the interface and of d: round-off of a gap


def displaced_bodies(scene: Scene) -> list[str]:
    """Bodies at rest that a static start of the scene displaces from the equilibrium."""
    if scene.time.start.type != "static" or scene.time.quasi_static:
        return []
    return [name for name, table in scene.substructure.items() if table.initial_keys and not table.motion_keys]


def displaced_start(problem: DiscretisedProblem, state: InitialState | None) -> InitialState | None:
    """The state from which the run starts, the initial displacements added to the equilibrium ``state``, and whether
    bodies set off from it; None where nothing acts at t = 0, and the scene itself has them.

    Raises
    ------
    SceneError : a contact that the equilibrium has closed overlaps.
    """
    names = [name for name in displaced_bodies(problem.scene) if name in problem.bodies]
    if state is None:
        return None
    if not names:
        return replace(state, sets_off=bool(falling_in(problem)))
    shifts = {name: _shift(problem.bodies[name], problem.conditions[name]) for name in names}
    displacement = dict(state.displacement)
    traction = dict(state.traction)
    problems = Problems()
    for name, shift in shifts.items():
        displacement[name] = displacement[name] + shift
    for unit in problem.units:
        moved = _jump(unit, shifts, problem.conditions)
        if unit.name not in traction or not moved.any():
            continue
        if unit.behaviour.compliant:
            # follows from the displacements, as that of a given start
            del traction[unit.name]
        elif unit.behaviour.opens:
            gap = unit.geometry.gap + _jump(unit, state.displacement, problem.conditions)[:, 0]
            gap = np.where(traction[unit.name][:, 0] < 0.0, 0.0, gap) + moved[:, 0]
            _check_overlap(problem.scene, unit, gap, moved, problems)
            traction[unit.name] = np.where((gap > _round_off(unit, moved))[:, None], 0.0, traction[unit.name])
    if problems:
        raise SceneError(problems, "the scene cannot be built")
    words = f"{state.message}; displaced from there: {', '.join(names)}"
    return replace(state, displacement=displacement, traction=traction, message=words, sets_off=True)


def _shift(body: Body, conditions: Conditions) -> Array:
    """Initial displacement of a body on its full dofs, faces that a motion drives left where they are."""
    if isinstance(conditions, RigidConditions):
        still = np.zeros(len(conditions.motions))
        return conditions.values(np.asarray(body.description.initial_displacement), np.zeros(3), still)
    return body.initial_displacement()


def _jump(unit: InterfaceUnit, fields: Mapping[str, Array], conditions: Mapping[str, Conditions]) -> Array:
    """Jump of displacements on full dofs across an interface, E' less E, along its frames, (n_point, n_component)."""
    n = unit.behaviour.n_component
    jump: Array = np.zeros((unit.geometry.n_point, n))
    for _, side, name in body_sides([unit]):
        trace, support = unit.geometry.local_trace(side, n), conditions[name]
        if name in fields and trace is not None:
            if isinstance(support, RigidConditions):
                nodal = support.nodal @ fields[name]
            else:
                nodal = fields[name]
            jump += (2 * side - 1) * np.asarray(trace @ nodal).reshape(-1, n)
    return jump


def _round_off(unit: InterfaceUnit, moved: Array) -> float:
    size = max(float(np.ptp(unit.geometry.points, axis=0).max()), float(np.sqrt(unit.geometry.areas.sum())))
    return _CLOSED * max(size, float(np.abs(moved).max()))


def _check_overlap(scene: Scene, unit: InterfaceUnit, gap: Array, moved: Array, problems: Problems) -> None:
    """``gap`` (n_point,) of the start, m; ``moved`` the displacements that are added, as of ``_jump``."""
    deepest = -float(gap.min())
    if deepest > _round_off(unit, moved):
        problems.add(
            f"interface.{unit.name}",
            "the initial displacement, which a static start counts from the equilibrium, lets the sides overlap",
            f"by {deepest:.6g} {scene.unit_system['m']} in all",
            remedy="displace the bodies away from each other, or along the face",
        )


def at_rest(problem: DiscretisedProblem) -> DiscretisedProblem:
    """A static problem whose bodies start undisplaced and at rest."""
    if not any(m.displacement.any() or m.velocity.any() for c in problem.classes for m in c.members):
        return problem
    return replace(problem, classes=[replace(c, members=[resting(m) for m in c.members]) for c in problem.classes])
